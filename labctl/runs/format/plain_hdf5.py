"""HDF5 files that may be anybody's: what such a file seems to hold must be in it.

HDF5 can name other files (external links, external storage, virtual data sets, soft links that lead to them) and
declare arrays that nobody ever stored. The files of labctl use none of this, so a file that does is refused before any
of its data are read.
"""

import io
from pathlib import Path

import h5py

from labctl.runs.format.global_heaps import WatchedFile

MOST_OBJECTS = 1000
MOST_UNPACKED = 1100
"""Times its stored bytes: what deflate can make of them at most is 1032."""
SMALLEST_STORAGE = 1 << 16
"""Bytes: below that a declared size costs nothing."""


def opened(path: Path) -> h5py.File:
    """The file at `path`, to read.

    Raises:
        OSError: It is not there, or no HDF5 file; later, at a text in it that HDF5 would never come to the end of.
    """
    return h5py.File(WatchedFile(path.open("rb", buffering=0)), "r")


def opened_image(image: bytes) -> h5py.File:
    """A file by its bytes, to read.

    Raises:
        OSError: As `opened`.
    """
    return h5py.File(WatchedFile(io.BytesIO(image)), "r")


def check_plain(file: h5py.File, largest: int, *, besides: str = "") -> None:
    """Refuse a file that refers to other files, or declares more than it holds.

    Args:
        file: An open file; none of its data are read.
        largest: How many bytes all its data sets may have, unpacked.
        besides: Name of a data set that does not count, because it is read piece by piece.

    Raises:
        ValueError: It is such a file; a few words that name the object.
        OSError, RuntimeError, KeyError: It is damaged.
    """
    groups, seen, unpacked = [file["/"]], 0, 0
    while groups:
        group = groups.pop()
        for name in group:
            seen += 1
            if seen > MOST_OBJECTS:
                raise ValueError(f"it holds more than {MOST_OBJECTS} objects")
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise ValueError(f"{name[:80]!r} is a link to another place")
            found = group[name]
            if isinstance(found, h5py.Group):
                groups.append(found)
            elif isinstance(found, h5py.Dataset):
                unpacked += _size(found, name[:80]) * (found.name != f"/{besides}")
                if unpacked > largest:
                    raise ValueError(f"its data sets have more than {largest} bytes")


def _size(dataset: h5py.Dataset, name: str) -> int:
    """How many bytes a data set has, unpacked; of text, which lies elsewhere in the file, the most that can be."""
    if dataset.is_virtual or dataset.external:
        raise ValueError(f"{name!r} keeps its data in other files")
    size = int(dataset.size or 0) * int(dataset.dtype.itemsize)
    if dataset.dtype.hasobject:
        return int(dataset.size or 0) * int(dataset.file.id.get_filesize())
    if size > max(SMALLEST_STORAGE, MOST_UNPACKED * dataset.id.get_storage_size()):
        raise ValueError(f"{name!r} declares {size} bytes that are not in the file")
    return size
