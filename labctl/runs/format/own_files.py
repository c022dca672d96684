"""The files of a run are opened here and nowhere else: regular files, in the folders of the run itself.

A run directory may be a stranger's. A symbolic link in it would have another file read, or written to; a pipe that
nobody writes to is waited at for ever; a device has no end, or does something as soon as it is opened. So whatever
takes a run looks through its folders first, and opens each file without following a link and without waiting. Windows
has no such ways to open a file: there it is looked at just before. What lies in a store is opened by the store.
"""

import errno
import os
import stat
import sys
from collections.abc import Callable
from contextlib import suppress
from io import FileIO
from pathlib import Path

from labctl.errors import RunError
from labctl.runs.format.store import StoredFile, StorePath

_NO_LINK_NO_WAIT = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_DESCRIPTORS = next((folder for folder in (Path("/proc/self/fd"), Path("/dev/fd")) if folder.is_dir()), None)
_STRANGE: tuple[tuple[Callable[[int], bool], str], ...] = (
    (stat.S_ISLNK, "is a link to another place: put the file itself there"),
    (stat.S_ISDIR, "is a folder where a run has a file: remove it"),
    (stat.S_ISFIFO, "is a pipe, which no run has: remove it"),
    (stat.S_ISSOCK, "is a socket, which no run has: remove it"),
    (stat.S_ISCHR, "is a device, which no run has: remove it"),
    (stat.S_ISBLK, "is a device, which no run has: remove it"),
)


def opened(path: str | Path, flags: int) -> int:
    """Opens for `FileIO`; a file that is made is a new one.

    Raises:
        OSError: it cannot be opened, or is a link, a pipe, a socket or a device.
    """
    _refuse_strange(path)
    descriptor = os.open(path, flags | _NO_LINK_NO_WAIT, 0o666)
    try:
        _refuse(os.fstat(descriptor), path)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def own_file(path: Path, largest: int = sys.maxsize) -> FileIO | StoredFile:
    """Open a file of a run, of at most `largest` bytes, to read it.

    Raises:
        OSError: as of `opened`, or it has more bytes.
    """
    if isinstance(path, StorePath):
        return path.own_file(largest)
    file = FileIO(opened(path, os.O_RDONLY))
    if (size := os.fstat(file.fileno()).st_size) > largest:
        file.close()
        raise OSError(errno.EFBIG, f"has {size} bytes, and no more than {largest} are read", str(path))
    return file


def read_own(path: Path, largest: int) -> bytes:
    """All bytes of a file of a run, `largest` at most.

    Raises:
        OSError: as of `own_file`.
    """
    with own_file(path, largest) as file:
        return file.readall()


def place_of(file: FileIO | StoredFile, path: Path) -> Path | StoredFile:
    """A path to just this open file, for libraries that open by path; on Windows only `path`, which it has.

    What lies in a store has no such path: HDF5 reads from the file itself.
    """
    if isinstance(file, StoredFile):
        return file
    return path if _DESCRIPTORS is None else _DESCRIPTORS / str(file.fileno())


def require_own_files(directory: Path) -> None:
    """Refuse a run whose folders hold anything but files and folders; where there is no folder nothing is refused.

    Raises:
        RunError: it does, or cannot be looked through.
    """
    if isinstance(directory, StorePath):
        directory.require_plain()
        return
    folders = [str(directory)] if os.path.isdir(directory) else []
    try:
        while folders:
            with os.scandir(folders.pop()) as found:
                for entry in found:
                    if entry.is_file(follow_symlinks=False):
                        continue
                    if entry.is_dir(follow_symlinks=False):
                        folders.append(entry.path)
                    else:
                        _refuse_strange(entry.path)
    except OSError as error:
        raise RunError(f"{error.filename}: {error.strerror}") from error


def _refuse_strange(path: str | Path) -> None:
    with suppress(FileNotFoundError):
        _refuse(os.lstat(path), path)


def _refuse(found: os.stat_result, path: str | Path) -> None:
    for is_so, why in _STRANGE:
        if is_so(found.st_mode):
            raise OSError(errno.EINVAL, why, str(path))
