"""HDF5's global heaps: a wrong size in one makes HDF5 walk in circles for ever, and nothing ends that, not even Ctrl-C.

Texts of variable length lie there, which labctl wrote before format 1.2, and so does where a virtual data set has its
data, which HDF5 reads as soon as the data set is opened. So whatever is looked at in a file that may be anybody's is
read through `WalkedFile`. Source: HDF5 File Format Specification 3.0, III.E; `H5HG__cache_heap_deserialize` of HDF5
1.14 for how it walks.
"""

import io
import os
import struct

from labctl.runs.format.store import StoredFile

HEAP = b"GCOL\x01\0\0\0"
FILE = b"\x89HDF\r\n\x1a\n"
LENGTH_BYTES = 8
MOST_OBJECTS = 1 << 16  # of a heap: each has a number of 16 bits

_HEADER = struct.Struct("<8sQ")
_OBJECT = struct.Struct("<HHIQ")
_MARGIN = len(HEAP) - 1


class WalkedFile(io.RawIOBase):
    """A file as HDF5 reads it, each heap walked before HDF5 sees it.

    Raises:
        OSError: at the read of a heap whose objects do not lie one behind the other inside it, or at once where the
            file's lengths have not the eight bytes that nearly all files have.
    """

    def __init__(self, source: io.FileIO | io.BytesIO | StoredFile) -> None:
        """Walk `source`, which is closed with it."""
        self._source = source
        self._place = 0
        begin = self._at(0, 16).ljust(16, b"\0")
        if begin.startswith(FILE) and begin[14 if begin[8] < 2 else 10] != LENGTH_BYTES:
            raise OSError("its lengths have not eight bytes")

    def readable(self) -> bool:
        """Yes."""
        return True

    def seekable(self) -> bool:
        """Yes."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """As of any file."""
        self._place = offset if whence == os.SEEK_SET else self._source.seek(offset, whence)
        return self._place

    def tell(self) -> int:
        """As of any file."""
        return self._place

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """As of any file; the heaps that begin in these bytes have been walked when it returns.

        Raises:
            OSError: see the class, or the place lies beyond the end of any file.
        """
        begin = max(0, self._place - _MARGIN)
        before = self._place - begin
        around = self._at(begin, before + len(buffer) + _MARGIN)
        found = around.find(HEAP)
        while found >= 0:
            self._walk(begin + found)
            found = around.find(HEAP, found + 1)
        content = around[before : before + len(buffer)]
        buffer[: len(content)] = content
        self._place += len(content)
        return len(content)

    def close(self) -> None:
        """Close the file."""
        if not self.closed:
            self._source.close()
            super().close()

    def _at(self, place: int, count: int) -> bytes:
        try:
            self._source.seek(place)
        except OverflowError:
            raise OSError(f"it names place {place}, beyond the end of any file") from None
        return self._source.read(count)

    def _walk(self, heap: int) -> None:
        """Walk over the objects of the heap that begins at `heap`, as HDF5 does."""
        header = self._at(heap, _HEADER.size)
        if len(header) < _HEADER.size:
            return
        place, end = heap + _HEADER.size, heap + _HEADER.unpack(header)[1]
        for _ in range(MOST_OBJECTS):
            text = self._at(place, _OBJECT.size) if place + _OBJECT.size <= end else b""
            if len(text) < _OBJECT.size:
                return
            index, _count, _reserved, size = _OBJECT.unpack(text)
            # Object 0 is the free space, whose size counts its header; the others are filled up to eight bytes.
            needed = size if index == 0 else _OBJECT.size + -(-size // 8) * 8
            if not _OBJECT.size <= needed <= end - place:
                break
            place += needed
        raise OSError("the texts in it do not lie one behind the other")
