"""HDF5 files that may be anybody's: what such a file seems to hold must be in it, and its texts have a fixed length.

HDF5 can name other files (external links, external storage, virtual data sets, soft links that lead to them) and
declare arrays that nobody ever stored. The files of labctl use none of this, so a file that does is refused before any
of its data are read. Texts of variable length are in files of formats before 1.2 alone.
"""

import math
from io import BytesIO, FileIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5l, h5o, h5s, h5t
from numpy.typing import NDArray

from labctl.runs.format.global_heaps import WalkedFile
from labctl.runs.format.own_files import own_file
from labctl.runs.format.store import StoredFile, StorePath

LIBVER = ("v108", "v108")  # the same bytes whatever HDF5 release writes them, readable by any HDF5 since 1.8
HDF5_ERRORS = (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, ArithmeticError, MemoryError)
"""What h5py and NumPy raise on a file that is not whole, or that somebody changed."""
NUMBERS = (h5t.INTEGER, h5t.FLOAT, h5t.ENUM)
MOST_OBJECTS = 1000
MOST_UNPACKED = 1100
"""Times its stored bytes: what deflate can make of them at most is 1032."""
SMALLEST_STORAGE = 1 << 16
"""Bytes: below that a declared size costs nothing."""


def walked(source: Path | FileIO | StoredFile | bytes) -> h5py.File:
    """The file at a path, an open one, or one by its bytes, to look at whatever is in it; slow for large arrays.

    Raises:
        OSError: it is not there, or no HDF5 file, or no file at all; later, at a heap in it that HDF5 would never come
            to the end of.
    """
    if isinstance(source, Path | StorePath):
        source = own_file(source)
    return h5py.File(WalkedFile(BytesIO(source) if isinstance(source, bytes) else source), "r")


def set_text(owner: h5py.Group | h5py.Dataset, name: str, text: str) -> None:
    """Give a file, group or data set an attribute in UTF-8, stored as a text of fixed length, however long."""
    stored = text.encode()
    owner.attrs.create(name, np.array(stored), dtype=h5py.string_dtype("utf-8", max(1, len(stored))))


def attribute(owner: h5py.Group, name: str) -> Any:
    """The one value of an attribute of a group or file: a number, or a text.

    Raises:
        KeyError: there is none.
        ValueError: it has several values, or is a text of variable length in a file of format 1.2 or later.
    """
    stored = h5a.open(owner.id, name.encode())
    if stored.shape != ():
        raise ValueError(f"{name!r} has several values")
    if stored.dtype.hasobject and not _is_older(owner.file):
        raise ValueError(f"{name!r} is a text of variable length")
    if stored.dtype.hasobject:
        return owner.attrs[name]
    value = np.empty((), stored.dtype)
    stored.read(value)
    return value.item().decode() if value.dtype.kind == "S" else value.item()


def stored_array(file: h5py.File, name: str) -> NDArray[Any]:
    """A whole data set of a file that is plain.

    Raises:
        OSError, RuntimeError, KeyError: It is damaged, or there is none.
    """
    stored = h5d.open(file.id, name.encode())  # h5py's own object takes longer to make than a small one to read
    found = np.empty(stored.shape, stored.dtype)
    stored.read(h5s.ALL, h5s.ALL, found)
    return found


def check_plain(file: h5py.File, largest: int, *, besides: str = "") -> None:
    """Refuse a file that refers to other files, declares more than it holds, or holds texts of variable length.

    Args:
        file: A file as `walked` opens it; none of its data are read.
        largest: How many bytes all its data sets may have, unpacked.
        besides: Name of a data set that does not count, because it is read piece by piece.

    Raises:
        ValueError: It is such a file; a few words that name the object.
        OSError, RuntimeError, KeyError: It is damaged.
    """
    # h5py's own objects would take several times as long to make, and every run that is opened is looked at so.
    root = file["/"].id
    groups, seen, unpacked = [root], 0, 0
    while groups:
        group = groups.pop()
        for name in group:
            seen += 1
            if seen > MOST_OBJECTS:
                raise ValueError(f"it holds more than {MOST_OBJECTS} objects")
            shown = name.decode(errors="replace")[:80]
            if group.links.get_info(name).type != h5l.TYPE_HARD:
                raise ValueError(f"{shown!r} is a link to another place")
            found = h5o.open(group, name)
            if isinstance(found, h5py.h5g.GroupID):
                groups.append(found)
            elif isinstance(found, h5d.DatasetID):
                size = _size(found, shown, file)
                unpacked += 0 if group is root and shown == besides else size
                if unpacked > largest:
                    raise ValueError(f"its data sets have more than {largest} bytes")


def _size(dataset: h5d.DatasetID, name: str, file: h5py.File) -> int:
    """How many bytes a data set has, unpacked; of text, which lies elsewhere in the file, the most that can be."""
    kind, count = dataset.get_type(), math.prod(dataset.shape)
    size, stored = int(count * kind.get_size()), True
    if dataset.get_offset() is None:  # in chunks, in another file, or nowhere
        properties = dataset.get_create_plist()
        if properties.get_layout() == h5d.VIRTUAL or properties.get_external_count():
            raise ValueError(f"{name!r} keeps its data in other files")
        stored = size <= max(SMALLEST_STORAGE, MOST_UNPACKED * dataset.get_storage_size())
    if kind.get_class() not in NUMBERS and kind.dtype.hasobject:
        if not _is_older(file):
            raise ValueError(f"{name!r} holds texts of variable length")
        return int(count * file.id.get_filesize())
    if not stored:
        raise ValueError(f"{name!r} declares {size} bytes that are not in the file")
    return size


def _is_older(file: h5py.File) -> bool:
    """Whether the format of a file is a text of variable length, as it was before 1.2."""
    return bool(file.attrs.get_id("format_version").dtype.hasobject)
