"""Putting bytes on a disk: whole or not at all, and mostly so that they are still there after the power fails."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path

from instruments.remedies import reason, remedy
from labctl.errors import LabctlError, RunError

REPLACED_AGAIN_S = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3) if os.name == "nt" else ()
"""Windows replaces no file that somebody has open, if only to look: how long it is waited for before each next try."""
Refused = Callable[[Path, OSError], LabctlError]
"""Makes the one line for a file that could not be written."""


class NotStored(RunError):
    """A run that has begun cannot be stored any further. Arguments: what cannot be written and why, and the remedy."""

    def __str__(self) -> str:
        """The line, of a run that is where it will be."""
        what, remedy = self.args
        return f"{what}; what was stored before is safe: {remedy}, then `labctl resume` the run"


def not_written(path: Path, error: OSError) -> RunError:
    """Of a run that has begun: what it has on disk stays, and it can go on; unless its folder is gone."""
    if gone := [folder for folder in path.parents if not folder.exists()]:
        return taken_away(gone[-1])
    return NotStored(f"{path}: cannot be written: {reason(error)}", remedy(error, "put its folder back"))


def taken_away(folder: Path) -> RunError:
    """Of a run whose folder somebody has moved or removed while it was measured."""
    return RunError(
        f"{folder}: is gone, and with it what was stored: it was moved or removed while the run went on; put it back, "
        f"then `labctl resume` the run, or begin a new one"
    )


def not_made(path: Path, error: OSError) -> RunError:
    """Of anything else."""
    return RunError(
        f"{path}: cannot be written: {reason(error)}; what was there before is as it was: "
        f"{remedy(error, 'name another place')}"
    )


@contextmanager
def _renamed(temporary: Path, path: Path) -> Iterator[FileIO]:
    """A new file `temporary` that is called `path` when the block ends without error, and is gone otherwise."""
    try:
        temporary.unlink(missing_ok=True)  # a killed process left it; or it leads somewhere else
        with FileIO(temporary, "x+") as file:
            yield file
        _replace(temporary, path)
    finally:
        with suppress(OSError):  # whatever is the matter has been said
            temporary.unlink(missing_ok=True)


def _replace(temporary: Path, path: Path) -> None:
    for pause_s in REPLACED_AGAIN_S:
        with suppress(PermissionError):
            os.replace(temporary, path)
            return
        time.sleep(pause_s)
    os.replace(temporary, path)


def show_file(path: Path, data: bytes) -> None:
    """Write `data` to `path` for those who look there now: whole or not at all, and maybe lost with the power.

    Several processes may do so at once: the last one counts.

    Raises:
        OSError: the disk is full or refuses.
    """
    with _renamed(path.with_name(f"{path.name}.{os.getpid()}.tmp"), path) as file:
        write_all(file, data)


@contextmanager
def replacement(path: Path, refused: Refused = not_written) -> Iterator[FileIO]:
    """A new file that takes the place of `path` when the block ends without error.

    It is written under a temporary name in the same folder, fsynced, renamed, and the folder is fsynced: at every
    moment `path` is either what it was or whole. The temporary file never outlives the block.

    Raises:
        LabctlError: the disk is full or refuses: what `refused` makes of it, a `RunError` unless it says otherwise.
    """
    try:
        with _renamed(path.with_name(path.name + ".tmp"), path) as file:
            yield file
            os.fsync(file.fileno())
        sync_folder(path.parent)
    except OSError as error:
        raise refused(path, error) from error


def replace_file(path: Path, data: bytes | memoryview, refused: Refused = not_written) -> None:
    """Write `data` to `path`, all or nothing, as `replacement` does.

    Raises:
        LabctlError: the disk is full or refuses: what `refused` makes of it, a `RunError` unless it says otherwise.
    """
    with replacement(path, refused) as file:
        write_all(file, data)


def write_all(file: FileIO, data: bytes | memoryview) -> None:
    """Write every byte; a raw file may take fewer at a time, most of all when the disk is nearly full."""
    rest = memoryview(data).cast("B")
    while rest:
        rest = rest[file.write(rest) :]


def make_folder(folder: Path) -> None:
    """Make `folder` and those above it that are not there yet, so that all of their names outlive the power."""
    new = [one for one in (folder, *folder.parents) if not one.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for one in new or [folder]:
        sync_folder(one.parent)


def sync_folder(folder: Path) -> None:
    """Make renames in `folder` durable. Windows has no such call and needs none."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
