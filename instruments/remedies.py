"""What can be done about what the operating system refuses: its own words, and the advice that fits just that error."""

import errno
import os
from collections.abc import Mapping
from pathlib import Path

_ADVICE: Mapping[str, tuple[str, ...]] = {
    "make room": ("ENOSPC",),
    "make room, or ask for a larger quota": ("EDQUOT",),
    "use a place that may be written to": ("EROFS",),
    "use a place that is yours, or have its owner open it": ("EACCES", "EPERM"),
    "the disk fails: copy what is on it, and use another one": (
        "EIO",
        "ENXIO",
        "ENODEV",
        "ENOMEDIUM",
        "EUCLEAN",
        "EBADMSG",
    ),
    "the network share is gone: connect it again, or use a local disk": (
        *("ESTALE", "ENOTCONN", "ETIMEDOUT", "EHOSTDOWN", "EHOSTUNREACH", "ENETDOWN", "ENETUNREACH", "ECONNRESET"),
        *("EREMOTEIO", "ENOLINK", "ESHUTDOWN"),
    ),
    "a process may open more files after 'ulimit -n 1024'": ("EMFILE",),
    "end some of the programs on this machine": ("ENFILE", "ENOMEM", "EAGAIN"),
    "files may be larger after 'ulimit -f unlimited', or on another file system": ("EFBIG", "EOVERFLOW"),
    "use a shorter name": ("ENAMETOOLONG",),
    "use a folder that lies on one file system": ("EXDEV",),
    "use a path without links that lead back to themselves": ("ELOOP",),
    "end the program that uses it": ("EBUSY", "ETXTBSY", "ENOLCK", "EDEADLK"),
    "use a file system that can do this": ("EOPNOTSUPP", "ENOTSUP", "ENOSYS"),
    "whoever read it has gone": ("EPIPE",),
}
REMEDIES: Mapping[int, str] = {
    getattr(errno, name): advice for advice, names in _ADVICE.items() for name in names if hasattr(errno, name)
}
"""By errno. What depends on the file asked for (ENOENT, EISDIR, ENOTDIR, EEXIST) is not in it."""
_ACCESS_DENIED, _SHARING_VIOLATION, _LOCK_VIOLATION = 5, 32, 33  # by Windows; EACCES, all of them


def reason(error: OSError) -> str:
    """The system's own words, in one line."""
    return " ".join(str(error.strerror or error).split())


def remedy(error: OSError, otherwise: str) -> str:
    """What can be done about `error`; `otherwise` where that depends on the file."""
    if _in_use(error):
        return "close the program that has it open"
    return REMEDIES.get(error.errno or 0, otherwise)


def _in_use(error: OSError) -> bool:
    """Whether Windows refuses a file since a program has it open; a rename of such a one it calls "access denied"."""
    number = getattr(error, "winerror", None)
    renames = error.filename2 is not None
    return number in (_SHARING_VIOLATION, _LOCK_VIOLATION) or (number == _ACCESS_DENIED and renames)


def unreadable(path: Path | str, error: OSError, otherwise: str) -> str:
    """The one line for a file that cannot be read; one that is too large to be read is so on every file system."""
    what_to_do = otherwise if error.errno == errno.EFBIG else remedy(error, otherwise)
    return f"{path}: cannot be read ({reason(error)}): {what_to_do}"


def unwritable(path: Path | str, error: OSError, otherwise: str) -> str:
    """The one line for a file that cannot be written."""
    return f"{path}: cannot be written ({reason(error)}): {remedy(error, otherwise)}"


def refusal(error: OSError) -> str | None:
    """The one line for what the system refused at a place that has none of its own; None: it is not the system's."""
    if not error.errno or error.errno not in errno.errorcode:
        return None
    where = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, str | bytes) else ""
    return f"{where}{reason(error)}: {remedy(error, 'look at that file or folder')}"
