"""Zip files that may be anybody's: nothing is ever unpacked to disk, and no more into memory than was allowed.

What an archive would cost is known before it is paid: the end record says how long the table of contents is, and of a
member no more is unpacked than its reader asks for, whatever the table says.
"""

import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from labctl.errors import DatasetError, one_line

MAX_ARCHIVE_BYTES = 1 << 30
MAX_DIRECTORY_BYTES = 16 << 20

ZIP_ERRORS = (
    OSError,
    EOFError,
    ValueError,
    NotImplementedError,
    LookupError,
    RuntimeError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)
"""What zipfile raises on a file that is not whole, or packed in a way it does not know."""

_END = b"PK\x05\x06"
_END_64 = b"PK\x06\x07"
_END_BYTES, _END_64_BYTES, _MAX_COMMENT = 22, 20, 65535


@contextmanager
def opened(path: Path, what: str = "a whole zip file") -> Iterator[zipfile.ZipFile]:
    """An open zip file whose table of contents is small enough to be read; `what` it should be, for the error.

    Raises:
        DatasetError: It is none, or too large.
    """
    try:
        _check_directory(path, what)
        archive = zipfile.ZipFile(path)
    except ZIP_ERRORS as error:
        raise DatasetError(f"{path}: is not {what} ({one_line(error)[:200]}): get it again") from None
    with archive:
        yield archive


def usual(member: zipfile.ZipInfo) -> bool:
    """Whether a member is packed as others do: only these ways of packing are unpacked piece by piece."""
    return member.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) and not member.flag_bits & 1


def content(archive: zipfile.ZipFile, name: str, limit: int) -> bytes:
    """The unpacked bytes of a `usual` member, at most `limit` + 1 of them; raises `ZIP_ERRORS`."""
    with archive.open(name) as member:
        return member.read(limit + 1)


def _check_directory(path: Path, what: str) -> None:
    """Refuse what would cost memory before a single name is known: the end record says how long the directory is."""
    size = path.stat().st_size
    if size > MAX_ARCHIVE_BYTES:
        raise DatasetError(f"{path}: is {size} bytes, at most {MAX_ARCHIVE_BYTES} are read")
    with path.open("rb") as file:
        file.seek(max(0, size - _END_BYTES - _MAX_COMMENT - _END_64_BYTES))
        tail = file.read()
    end = tail.rfind(_END)
    if end < 0 or len(tail) - end < _END_BYTES:
        raise DatasetError(f"{path}: is not {what} (it has no table of contents): get it again")
    if _END_64 in tail[max(0, end - _END_64_BYTES) : end]:
        raise DatasetError(f"{path}: is a zip file of the 64-bit kind, which data sets of this size do not need")
    (directory,) = struct.unpack_from("<I", tail, end + 12)
    if directory > MAX_DIRECTORY_BYTES:
        raise DatasetError(
            f"{path}: has a table of contents of {directory} bytes: at most {MAX_DIRECTORY_BYTES} are read"
        )
