"""Pictures as they are published: one JPEG file each, in a folder for each class, unpacked or in a zip file.

The files may be anybody's: what is read is limited in number and size before it is decoded, nothing is ever unpacked to
disk, and a picture is looked at only if its header says the expected size.
"""

import io
import os
import struct
import warnings
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray
from PIL.JpegImagePlugin import JpegImageFile

from labctl.datasets import archives
from labctl.errors import DatasetError, one_line

MAX_PICTURES = 50_000
MAX_PICTURE_BYTES = 256 * 1024
SUFFIXES = (".jpg", ".jpeg")


@dataclass(frozen=True)
class Album:
    """The pictures of a folder or zip file, class by class, by name within each.

    Attributes:
        place: The folder or zip file.
        names: `class folder/file` of each picture.
        labels: (n,) position of its class folder.
        read: Gives the content of the picture of a name, at most `MAX_PICTURE_BYTES` + 1 bytes.
    """

    place: Path
    names: tuple[str, ...]
    labels: NDArray[np.int64]
    read: Callable[[str], bytes]

    def content(self, name: str) -> bytes:
        """The JPEG file of a name.

        Raises:
            DatasetError: It cannot be read, or it is larger than a picture can be.
        """
        try:
            content = self.read(name)
        except archives.ZIP_ERRORS as error:
            reason = one_line(error)[:200]
            raise DatasetError(f"{self.place}: {name} cannot be read ({reason}): get the data set again") from None
        if len(content) > MAX_PICTURE_BYTES:
            raise DatasetError(f"{self.place}: {name} is larger than {MAX_PICTURE_BYTES} bytes: it is no such picture")
        return content

    def pictures(self, positions: NDArray[np.integer], shape: tuple[int, int]) -> NDArray[np.uint8]:
        """Grey levels (m, rows, columns) of the pictures at `positions`; no other is decoded.

        Raises:
            DatasetError: One of them cannot be decoded, or is not of `shape`.
        """
        grey = np.empty((len(positions), *shape), np.uint8)
        with warnings.catch_warnings(action="ignore"):  # Pillow's, on odd metadata that is not used
            for pixels, position in zip(grey, positions, strict=True):
                name = self.names[position]
                pixels[:] = decode(self.content(name), f"{self.place}: {name}", shape)
        return grey

    def problems(self, shape: tuple[int, int]) -> Iterator[tuple[str, str]]:
        """Name and error of every picture that cannot be decoded or is not of `shape`."""
        for position, name in enumerate(self.names):
            try:
                self.pictures(np.array([position]), shape)
            except DatasetError as error:
                yield name, str(error)


def holds(folder: Path, class_folders: Sequence[str]) -> bool:
    """True if `folder` has the class folders, or a zip file that may have them."""
    return all((folder / name).is_dir() for name in class_folders) or any(folder.glob("*.zip"))


@contextmanager
def opened(folder: Path, class_folders: Sequence[str]) -> Iterator[Album]:
    """The album in `folder`: its class folders, or the one zip file in it.

    Raises:
        DatasetError: There is none, it holds no pictures, or it is not what a data set of pictures looks like.
    """
    if all((folder / name).is_dir() for name in class_folders):
        names = _in_folders(folder, class_folders)
        yield _album(folder, names, class_folders, lambda name: _read_file(folder / name))
        return
    found = sorted(folder.glob("*.zip"))
    if len(found) != 1:
        names_found = ", ".join(path.name for path in found[:3]) or "none"
        raise DatasetError(
            f"{folder}: needs the folders {', '.join(class_folders)}, or one zip file with them (found: {names_found})"
        )
    with archives.opened(found[0]) as archive:
        names = _in_archive(archive, found[0], class_folders)
        yield _album(found[0], names, class_folders, lambda name: archives.content(archive, name, MAX_PICTURE_BYTES))


def decode(content: bytes, name: str, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Grey levels (rows, columns) of a JPEG file, by the luma weights of ITU-R BT.601.

    Args:
        content: The whole file.
        name: What to call it in an error.
        shape: Rows and columns that it must have.

    Raises:
        DatasetError: It is not a JPEG file of that size.
    """
    try:
        picture = JpegImageFile(io.BytesIO(content))
        if picture.size != shape[::-1]:
            columns, rows = picture.size
            raise DatasetError(f"{name}: is {rows}x{columns} pixels, the data set has {shape[0]}x{shape[1]}")
        return np.asarray(picture.convert("L"))
    except (OSError, SyntaxError, ValueError, ArithmeticError, LookupError, TypeError, struct.error) as error:
        raise DatasetError(f"{name}: is not a whole JPEG file ({one_line(error)}): get the data set again") from None


def _album(place: Path, names: list[str], class_folders: Sequence[str], read: Callable[[str], bytes]) -> Album:
    labels = np.array([class_folders.index(name.partition("/")[0]) for name in names], np.int64)
    if missing := [name for label, name in enumerate(class_folders) if label not in labels]:
        raise DatasetError(f"{place}: holds no JPEG file in {', '.join(missing)}/: get the data set again")
    order = sorted(range(len(names)), key=lambda position: (labels[position], names[position]))
    return Album(place, tuple(names[position] for position in order), labels[order], read)


def _in_folders(folder: Path, class_folders: Sequence[str]) -> list[str]:
    names: list[str] = []
    for class_folder in class_folders:
        try:
            with os.scandir(folder / class_folder) as entries:
                pictures = [entry.name for entry in entries if _is_picture(entry.name) and entry.is_file()]
        except OSError as error:
            reason = error.strerror or one_line(error)
            raise DatasetError(f"{folder / class_folder}: cannot be read ({reason}): let this user read it") from None
        names += (f"{class_folder}/{name}" for name in pictures)
    if len(names) > MAX_PICTURES:
        raise DatasetError(f"{folder}: holds {len(names)} pictures, at most {MAX_PICTURES} are read")
    return names


def _read_file(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(MAX_PICTURE_BYTES + 1)


def _in_archive(archive: zipfile.ZipFile, path: Path, class_folders: Sequence[str]) -> list[str]:
    names: list[str] = []
    for member in archive.infolist():
        parts = PurePosixPath(member.filename).parts
        if ".." in parts or parts[:1] == ("/",) or "\\" in member.filename or ":" in member.filename:
            raise DatasetError(f"{path}: names {member.filename[:80]!r}, a place outside the archive: do not use it")
        if len(parts) != 2 or parts[0] not in class_folders or not _is_picture(parts[1]) or member.is_dir():
            continue
        if member.file_size > MAX_PICTURE_BYTES or member.compress_size > MAX_PICTURE_BYTES:
            raise DatasetError(f"{path}: {member.filename[:80]!r} unpacks to {member.file_size} bytes: no such picture")
        if not archives.usual(member):
            raise DatasetError(
                f"{path}: {member.filename[:80]!r} is encrypted or packed in an unusual way: pack it again"
            )
        names.append(member.filename)
    if len(names) > MAX_PICTURES or len(names) != len(set(names)):
        raise DatasetError(f"{path}: holds more than {MAX_PICTURES} pictures, or two of one name: do not use it")
    return names


def _is_picture(name: str) -> bool:
    """True for visible JPEG files; a file whose name a terminal cannot print is no picture."""
    return name.lower().endswith(SUFFIXES) and not name.startswith(".") and name.isprintable()
