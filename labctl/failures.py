"""Which failures a person meets, and the exit status each one ends in."""

from instruments.errors import InstrumentError, NotConfigured, OutOfRange

DONE, FELL_SHORT, WRONG_USE, INTERRUPTED = 0, 1, 2, 130


class UsageError(Exception):
    """A command was asked for something that cannot be: one line that names the option and what to do."""


def expected() -> tuple[type[Exception], ...]:
    """What is told in one line; anything else is a defect.

    To be called when something has failed: where the errors come from is imported here, and a command that ends well
    needs little of it.
    """
    from pydantic import ValidationError

    from labctl.analysis.errors import AnalysisError
    from labctl.datasets.errors import DatasetError
    from labctl.experiments import ExperimentError
    from labctl.runs.layout import RunError
    from labctl.station import StationError
    from protocols.base import ProtocolError

    return (
        UsageError,
        StationError,
        ProtocolError,
        DatasetError,
        ExperimentError,
        AnalysisError,
        RunError,
        InstrumentError,
        ValidationError,
    )


def exit_status(error: Exception) -> int:
    """1 if an instrument failed, 2 if what was asked for is wrong."""
    failed = isinstance(error, InstrumentError) and not isinstance(error, OutOfRange | NotConfigured)
    return FELL_SHORT if failed else WRONG_USE


def one_line(error: Exception) -> str:
    """The failure as it is printed."""
    from pydantic import ValidationError

    from labctl.station import describe

    text = describe(error) if isinstance(error, ValidationError) else str(error)
    return " ".join(text.split())


def notes(error: BaseException) -> tuple[str, ...]:
    """What failed after it, such as the safe state or the closing of a connection: one line each."""
    return tuple(dict.fromkeys(" ".join(note.split()) for note in getattr(error, "__notes__", ())))
