"""A lock of this machine: a file, locked by the system, with a note of who holds it.

The system lets go of it when the last process that has it open ends, however that ends.
"""

import errno
import os
import re
import stat
import sys
from contextlib import suppress
from hashlib import sha256
from io import FileIO
from pathlib import Path

from instruments.remedies import remedy
from labctl.errors import BenchInUse
from labctl.runs.format.file_lock import lock

PLACES = (Path("/run/lock"), Path("/tmp"))  # noqa: S108  # for all users, who cannot remove each other's files there
LONGEST_NOTE = 1 << 12
FLAGS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
KEPT_FROM_US = (errno.EACCES, errno.EPERM, errno.ELOOP)
"""By another user: no other place would do, as it would for files of one's own."""
SOMEBODYS = "remove it, or ask whose it is"


class LockFile:
    """What `key` stands for, which one process at a time may have."""

    def __init__(self, key: str) -> None:
        """Not locked yet.

        Raises:
            BenchInUse: somebody keeps this user from opening it.
        """
        readable = re.sub(r"\W+", "-", key)[-40:].strip("-")
        self._path = _folder() / f"labctl-{readable}-{sha256(key.encode()).hexdigest()[:12]}.lock"
        self._file = self._opened()

    def lock(self) -> bool:
        """Whether this process has it now."""
        while _locked(self._file):
            with suppress(OSError):
                if os.path.samestat(os.fstat(self._file.fileno()), self._path.lstat()):
                    return True
            self._file.close()  # whoever had it has removed it meanwhile
            self._file = self._opened()
        return False

    @property
    def descriptor(self) -> int:
        """What a process inherits to have it as well."""
        return self._file.fileno()

    @property
    def note(self) -> bytes:
        """What its holder wrote; may be anything."""
        self._file.seek(0)
        return self._file.read(LONGEST_NOTE) or b""

    def write(self, note: bytes) -> None:
        """Say who holds it; a full disk, or that it is another user's, keeps nobody from holding it."""
        with suppress(OSError):
            self._file.truncate(0)
            self._file.seek(0)
            self._file.write(note)

    def close(self) -> None:
        """Let go of it. One that another process has inherited stays; else it is removed."""
        self._file.close()
        with suppress(OSError, BenchInUse):  # another user's
            self._file = self._opened()
            if self.lock():
                if sys.platform == "win32":  # it removes none that is open, be it by somebody who wants to lock it
                    self._file.close()
                self._path.unlink()
        self._file.close()

    def _opened(self) -> FileIO:
        try:
            return _there(self._path)
        except OSError as error:
            advice = SOMEBODYS if error.errno in KEPT_FROM_US else remedy(error, SOMEBODYS)
            raise BenchInUse(f"{self._path}: cannot be locked ({error.strerror}): {advice}") from None


def _locked(file: FileIO) -> bool:
    try:
        lock(file)
    except OSError:
        return False
    return True


def _folder() -> Path:
    if sys.platform == "win32":
        found = Path(os.environ.get("PROGRAMDATA", Path.home())) / "labctl"
        found.mkdir(exist_ok=True)
        return found
    shared = stat.S_ISVTX | stat.S_IRWXO
    return next((place for place in PLACES if place.is_dir() and place.stat().st_mode & shared == shared), PLACES[-1])


def _there(path: Path) -> FileIO:
    """The file, made if it is not there, for every user; nobody is followed elsewhere, or waited for."""
    while True:  # whoever had it may remove it meanwhile
        with suppress(FileNotFoundError):
            return FileIO(path, "r+", opener=_to_lock)
        with suppress(FileExistsError):
            os.close(os.open(path, os.O_RDWR | FLAGS | os.O_CREAT | os.O_EXCL, 0o666))
            with suppress(OSError):
                path.chmod(0o666)  # whatever the umask


def _to_lock(name: str, _: int) -> int:
    """Another user's that is not for every user, as on Windows, is opened to be read: enough to lock it."""
    try:
        return os.open(name, os.O_RDWR | FLAGS)
    except PermissionError:
        return os.open(name, os.O_RDONLY | FLAGS)
