"""Every failure that a person meets, one class for each kind of thing that can be wrong; all are `LabctlError`.

Those of instruments and protocols are where these are: `instruments.errors`, `protocols.base`.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from instruments.errors import LabctlError
from instruments.remedies import unwritable

__all__ = [
    "IMPORT_FAILURES",
    "AnalysisError",
    "BenchInUse",
    "ClusterError",
    "DatasetError",
    "ExperimentError",
    "LabctlError",
    "NotWritten",
    "RecordingError",
    "RunError",
    "RunExists",
    "RunInUse",
    "ShardLost",
    "StationError",
    "StoppedEarly",
    "TooFewImages",
    "UsageError",
    "WorkerKilled",
    "WrongPlace",
    "clock_ended",
    "noted_on",
    "notes",
    "one_line",
    "writing",
]

IMPORT_FAILURES = (ImportError, OSError, AttributeError, ValueError)
"""How a package that is incomplete, or that does not fit another, ends its import."""


class StoppedEarly(LabctlError):
    """The operator stopped a command, which has nothing to show then: one line that says what is kept."""

    exit_status = 130


class UsageError(LabctlError):
    """A command was asked for something that cannot be: one line that names the option and what to do."""


class StationError(LabctlError):
    """The station file is wrong: one line that names file, key, value and what to do."""


class BenchInUse(LabctlError):
    """Another process has an instrument: one line that says who, which run, since when and how long still.

    Attributes:
        holder: who, in words; empty where that is not known.
    """

    exit_status = 1

    def __init__(self, message: str, holder: str = "") -> None:
        """With the line."""
        super().__init__(message)
        self.holder = holder


class ClusterError(LabctlError):
    """A cluster that cannot be reached, or that cannot do what it is given: one line that says what to do."""


class WorkerKilled(LabctlError):
    """A process that carried out tasks beside others is gone: one line that says what to do."""

    exit_status = 1


class DatasetError(LabctlError):
    """A data set is missing, damaged or asked for something it does not hold; one line that says what to do."""


class RunError(LabctlError):
    """A run cannot be written or read: one line that says what, where and what to do."""


class RunInUse(RunError):
    """Another process is writing the run."""


class WrongPlace(RunError):
    """Another run has the place of a run, or not all see the same folder there: to go on meets the same."""


class ShardLost(RunError):
    """A shard is not there, or not the one that the journal names."""


class RunExists(RunError):
    """The directory asked for already holds something; nothing in it was touched."""


class RecordingError(UsageError):
    """A recording that cannot be written or read: one line with the file, what is wrong and what to do."""


class AnalysisError(LabctlError, ValueError):
    """Data and settings of an analysis do not fit together; one line that says what to do."""


class TooFewImages(AnalysisError):
    """There are too few images to train on some and test on others, or those to train on are of one class."""


class ExperimentError(LabctlError):
    """An experiment that does not exist, or whose file is wrong: one line that says what to do."""


class NotWritten(LabctlError):
    """A file or folder cannot be written: one line that names it and says what can be done about just that."""


@contextmanager
def writing(path: Path, otherwise: str = "name another place") -> Iterator[None]:
    """What the system refuses while `path` is written becomes the one error; `otherwise`: see `remedies.remedy`.

    Raises:
        NotWritten: it refused.
    """
    try:
        yield
    except OSError as error:
        raise NotWritten(unwritable(path, error, otherwise)) from error


@contextmanager
def noted_on(error: BaseException | None) -> Iterator[None]:
    """A `RunError` inside the block becomes a note to `error`, which came first; without one it is raised."""
    try:
        yield
    except RunError as failure:
        if error is None:
            raise
        if failure is not error:
            error.add_note(str(failure))


def notes(error: BaseException) -> tuple[str, ...]:
    """What failed after it, such as the safe state or the closing of a connection: one line each."""
    return tuple(dict.fromkeys(" ".join(note.split()) for note in getattr(error, "__notes__", ())))


def clock_ended(error: Exception) -> bool:
    """Whether the clock of a simulated bench has ended, of which `error` says all."""
    world = sys.modules.get("sim_backends.world.world")  # loaded where one could
    return world is not None and isinstance(error, world.ClockEnded)


def one_line(error: Exception) -> str:
    """The failure as it is printed, in one line whatever it quotes."""
    return " ".join(str(error).split())
