"""The disk of a virtual Tektronix instrument: a tree of files in memory, its own. The host's disk is not touched.

Paths are those of Windows: a drive, backslashes, no difference between capitals and small letters. The capacity is
recalled.  Source: instrument facts 1.4.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PureWindowsPath

from sim_backends.scpi.status import ScpiError

DRIVE = "C:"
CAPACITY = 2**32  # bytes
DEEPEST = 64  # folders


@dataclass(frozen=True)
class Entry:
    """One line of a folder: a file's size in bytes, None for a folder."""

    name: str
    size: int | None


def _key(path: PureWindowsPath) -> str:
    return str(path).lower()


class Disk:
    """Files by path, and the current drive and folder.

    Args:
        folders: Those that are there from the start.
    """

    def __init__(self, *folders: str) -> None:
        self._folders: dict[str, PureWindowsPath] = {}
        self._files: dict[str, tuple[PureWindowsPath, bytearray]] = {}
        self._folder = PureWindowsPath(DRIVE + "\\")
        self._folders[_key(self._folder)] = self._folder
        for folder in map(PureWindowsPath, folders):
            for path in (*reversed(folder.parents), folder):
                self._folders.setdefault(_key(path), path)

    @property
    def drive(self) -> str:
        """The current drive, `C:`."""
        return self._folder.drive

    @drive.setter
    def drive(self, name: str) -> None:
        if PureWindowsPath(name).drive.upper() != DRIVE:
            raise ScpiError(-250, f"no drive {name}")

    @property
    def folder(self) -> str:
        """The current folder; -256 for one that is not there."""
        return str(self._folder)

    @folder.setter
    def folder(self, name: str) -> None:
        path = self.path(name)
        if _key(path) not in self._folders:
            raise ScpiError(-256, f"no folder {path}")
        self._folder = self._folders[_key(path)]

    @property
    def used(self) -> int:
        """Bytes in all files."""
        return sum(len(data) for _, data in self._files.values())

    def path(self, name: str) -> PureWindowsPath:
        """The whole path of `name`, seen from the current folder; -257 for one that cannot be."""
        if not name or any(character in name for character in '*?<>|"\x00') or len(name) > 260:
            raise ScpiError(-257, name)
        path = self._folder / PureWindowsPath(name)
        if path.drive.upper() != DRIVE:
            raise ScpiError(-250, f"no drive {path.drive}")
        parts: list[str] = []
        for part in path.parts[1:]:
            if part == "..":
                parts = parts[:-1]
            elif part != ".":
                parts.append(part)
        if len(parts) > DEEPEST:
            raise ScpiError(-257, name)
        return PureWindowsPath(DRIVE + "\\", *parts)

    def make_folder(self, name: str) -> None:
        """Make a folder; -257 where something of that name is, -256 where the folder above is not."""
        path = self.path(name)
        if _key(path) in self._folders or _key(path) in self._files:
            raise ScpiError(-257, f"{path} exists")
        if _key(path.parent) not in self._folders:
            raise ScpiError(-256, f"no folder {path.parent}")
        self._folders[_key(path)] = path

    def entries(self) -> Iterator[Entry]:
        """What the current folder holds."""
        here = _key(self._folder)
        for key, path in self._folders.items():
            if _key(path.parent) == here and key != here:
                yield Entry(path.name, None)
        for path, data in self._files.values():
            if _key(path.parent) == here:
                yield Entry(path.name, len(data))

    def read(self, name: str) -> memoryview:
        """A file's bytes; -256 if there is none."""
        return memoryview(self._file(name)).toreadonly()

    def write(self, name: str, data: memoryview, start: int | None = None) -> None:
        """Write a file, or with `start` (bytes, from 0) into one.

        Raises:
            ScpiError: -256 no such folder, -257 a folder of that name, -222 a gap behind the file, -254 no room.
        """
        path = self.path(name)
        if _key(path.parent) not in self._folders:
            raise ScpiError(-256, f"no folder {path.parent}")
        if _key(path) in self._folders:
            raise ScpiError(-257, f"{path} is a folder")
        _, old = self._files.get(_key(path), (path, bytearray()))
        begin = start or 0
        if begin > len(old):
            raise ScpiError(-222, f"{path} has {len(old)} bytes")
        if self.used + max(0, begin + data.nbytes - len(old)) > CAPACITY:
            raise ScpiError(-254, f"{data.nbytes} bytes")
        new = bytearray() if start is None else bytearray(old)
        new[begin : begin + data.nbytes] = data
        self._files[_key(path)] = path, new

    def delete(self, name: str) -> None:
        """Delete a file or an empty folder; -256 if there is none, -250 if it holds something or is in use."""
        path = self.path(name)
        if _key(path) in self._files:
            del self._files[_key(path)]
            return
        if _key(path) not in self._folders:
            raise ScpiError(-256, str(path))
        held = (other for other in (*self._folders.values(), *(file for file, _ in self._files.values())))
        if any(path in other.parents for other in held) or path == self._folder:
            raise ScpiError(-250, f"{path} is not empty, or in use")
        del self._folders[_key(path)]

    def _file(self, name: str) -> bytearray:
        path = self.path(name)
        try:
            return self._files[_key(path)][1]
        except KeyError:
            raise ScpiError(-256, str(path)) from None
