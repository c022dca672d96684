"""Which process writes a run: needed before a run is signalled, or shown as running."""

import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from io import FileIO
from pathlib import Path

from labctl.runs.format.file_lock import lock
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.own_files import opened
from labctl.runs.live.events import Event, EventReader

_PROCESSES = Path("/proc")


@dataclass(frozen=True)
class Writer:
    """A process of this machine; `heeds_signals`: SIGTERM brings its bench into the safe state."""

    process: int
    heeds_signals: bool


STARTS = ("run started", "run resumed", "live started", "sweep started")
"""The events that say which process writes the run, shows the live view or carries out the sweep, from then on."""
OWNER = "owner"
"""Name of the file that a live view or a sweep has locked, which has no journal."""


@contextmanager
def owned(directory: Path) -> Iterator[None]:
    """This process is the owner of the live view or sweep in `directory` inside the block.

    Raises:
        BlockingIOError: another one is.
        OSError: it cannot be written.
    """
    with FileIO(directory / OWNER, "ab", opener=opened) as file:
        lock(file)
        yield


def writer_of(paths: RunPaths) -> Writer | None:
    """The process that writes a run, according to its events; None where there is none or it has ended."""
    reader, found = EventReader(paths.events), None
    while events := reader.read():
        found = next((event for event in reversed(events) if event.name in STARTS), found)
    return None if found is None else writer_named(found, paths)


def writer_named(started: Event, paths: RunPaths) -> Writer | None:
    """The process that one of `STARTS` names, if it still writes the run."""
    process = started.fields.get("process")
    if not isinstance(process, int) or of_another_machine(started) or not _writes(process, paths):
        return None
    return Writer(process, started.fields.get("heeds_signals") is True)


def of_another_machine(started: Event) -> bool:
    """Whether another machine carries the run out: whether it still does cannot be found out here."""
    return started.fields.get("host") != platform.node()


def _writes(process: int, paths: RunPaths) -> bool:
    """Whether a process of this machine writes the run.

    The lock on the journal, or on `OWNER`, shows it, which the writer holds to its end, so that neither a reader nor
    another process that got the same number is taken for it. Linux shows which process has the lock, other systems only
    whether one has.
    """
    locked = partial(_locks, process) if _PROCESSES.is_dir() else _is_held
    return process > 0 and (locked(paths.journal) or locked(paths.directory / OWNER))


def _is_held(path: Path) -> bool:
    """Whether a process has the lock of a file: it cannot be had here, not even for a moment."""
    try:
        with FileIO(opened(path, os.O_RDONLY)) as file:
            lock(file)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _locks(process: int, journal: Path) -> bool:
    own = _PROCESSES / str(process)
    try:
        wanted = os.lstat(journal)
        descriptors = list((own / "fd").iterdir())
    except OSError:
        return False
    return any(_is_locked(descriptor, own / "fdinfo" / descriptor.name, wanted) for descriptor in descriptors)


def _is_locked(descriptor: Path, about: Path, wanted: os.stat_result) -> bool:
    """Whether a descriptor is the wanted file's and has its lock. Source: proc_pid_fdinfo(5)."""
    try:
        return os.path.samestat(os.stat(descriptor), wanted) and "\nlock:" in about.read_text("ascii")
    except OSError:  # closed meanwhile
        return False
