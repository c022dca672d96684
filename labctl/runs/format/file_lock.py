"""The lock on an open file. Whoever has the file open has it, until he closes the file or ends, however he ends."""

import sys
from io import FileIO

BEHIND = 1 << 30
"""Windows locks bytes, and keeps them from being read: one that no file of labctl has, whoever reads it to its end."""


def lock(file: FileIO) -> None:
    """Lock an open file. On Windows its position is another one then.

    Raises:
        BlockingIOError: another process has the lock, or this one by another opening of the file.
        OSError: the file system has no locks.
    """
    if sys.platform == "win32":
        import msvcrt

        file.seek(BEHIND)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(*error.args) from None
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
