"""Where HDF5 writes a file of any size, so that a full disk is an error like any other."""

from io import FileIO, RawIOBase
from typing import Any

from labctl.runs.format.durable import write_all


class Hdf5Target(RawIOBase):
    """A raw file, opened for writing and reading, as HDF5 writes to it.

    HDF5 cannot close a file whose disk is full, and takes the whole interpreter down with it at exit. So the first
    failure is kept, HDF5 is left to believe that all went well, and `check` raises the failure afterwards.
    """

    def __init__(self, file: FileIO) -> None:
        """`file` stays the caller's, who closes it after HDF5 has closed this."""
        super().__init__()
        self._file = file
        self._failure: OSError | None = None

    def check(self) -> None:
        """Raise the first failure, if there was one."""
        if self._failure is not None:
            raise self._failure

    def write(self, data: Any, /) -> int:
        """Write all of `data`, or note why not."""
        if self._failure is None:
            try:
                write_all(self._file, data)
            except OSError as error:
                self._failure = error
        return len(data)

    def truncate(self, size: int | None = None, /) -> int:
        """Set the length, or note why not."""
        if self._failure is None:
            try:
                self._file.truncate(size)
            except OSError as error:
                self._failure = error
        return size or 0

    def readinto(self, buffer: Any, /) -> int:
        """Read back what was written."""
        return self._file.readinto(buffer)

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """Go to a position."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """The position."""
        return self._file.tell()

    def flush(self) -> None:
        """Nothing is kept back."""
