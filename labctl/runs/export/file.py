"""One run, one file or folder, all or nothing: written aside, synced, renamed."""

import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from uuid import uuid4

from instruments.remedies import unwritable
from labctl.errors import RunError
from labctl.runs.export.content import Content
from labctl.runs.format.durable import sync_folder

Write = Callable[[Content, Path], None]
"""Writes all of a content to a path that is not there yet."""

FORMATS: Mapping[str, str] = {"netcdf": ".nc", "zarr": ".zarr", "npz": ".npz", "csv": ".csv"}
"""Formats, and how their files are called."""
LARGER: Mapping[str, float] = {"netcdf": 1.0, "zarr": 0.0, "npz": 1.0, "csv": 2.0}
"""How large a file is at least, in bytes of its arrays; zarr is compressed, and nobody knows beforehand how well."""


def write(content: Content, to: str, path: Path) -> int:
    """Write `content` in the format `to`, one of `FORMATS`; returns the bytes written.

    Args:
        content: What to write.
        to: The format.
        path: File to make, for zarr a folder; it must not be there.

    Raises:
        RunError: the file is there already, there is no room, a package is missing, or the run is damaged.
    """
    if path.exists():
        raise RunError(f"{path}: exists: name another file by --out")
    write_as = _writer(to, path)
    require_room(path, content.size * LARGER[to], "make room, choose some of the --shots")
    with aside(path) as temporary:
        write_as(content, temporary)
    return sum(part.stat().st_size for part in (path, *path.rglob("*")) if part.is_file())


def _writer(to: str, path: Path) -> Write:
    try:
        found: Write = import_module(f"labctl.runs.export.as_{to}").write
        return found
    except ModuleNotFoundError as error:
        if error.name not in ("h5netcdf", "zarr"):
            raise
        raise RunError(f'{path}: needs {error.name} to be written: pip install "photonic-labctl[data]"') from None


def require_room(path: Path, size: float, remedy: str) -> None:
    """Refuse what does not fit where `path` is to be made.

    Raises:
        RunError: it does not; the `remedy`, or another place.
    """
    try:
        free = shutil.disk_usage(path.parent).free
    except OSError as error:
        raise _not_written(path, error) from None
    if size > free:
        raise RunError(
            f"{path}: needs {size / 1e9:.3g} GB, {free / 1e9:.3g} GB are free: {remedy}, or name another place by --out"
        )


@contextmanager
def aside(path: Path) -> Iterator[Path]:
    """A name in the folder of `path` to write to; what is there when the block ends takes its place, or is removed.

    Nobody else has that name, so that several processes may write what is to be called `path`: the first one counts.

    Raises:
        RunError: it cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{uuid4().hex[:8]}.partial")
    try:
        yield temporary
        for part in (temporary, *temporary.rglob("*")):
            if part.is_file():
                _sync(part)
        if path.exists():
            raise RunError(f"{path}: was made by another program meanwhile: name another file by --out")
        temporary.rename(path)
        sync_folder(path.parent)
    except OSError as error:
        raise _not_written(path, error) from error
    finally:
        with suppress(OSError):  # whatever is the matter has been said
            _remove(temporary)


def _sync(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _not_written(path: Path, error: OSError) -> RunError:
    return RunError(
        f"{unwritable(path, error, 'see to the disk')}, or name another place by --out; the run is as it was"
    )
