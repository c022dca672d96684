"""A disk whose power can fail at any moment: what a program told it, and what may be left of that.

What is sure is the content of a file as of its last fsync, and the names in a folder as of the folder's last fsync.
What came later may be there, in part, or not at all; a file whose new size is kept may hold zeros in place of its data.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path
from typing import Any
from unittest import mock

from labctl.runs.format import durable, journal

Tree = dict[str, bytes | None]
"""What is found when the power is back: content of each file by its path, None for a folder."""


@dataclass
class Node:
    """A file, by whatever name: content as of the last fsync, and as the program sees it. A folder has no content."""

    folder: bool = False
    sure: bytes = b""
    seen: bytes = b""
    cut: bytes = b""  # as it is when the last write arrived by half

    def write(self, offset: int, data: bytes) -> None:
        self.cut = _overwritten(self.seen, offset, data[: len(data) // 2])
        self.seen = _overwritten(self.seen, offset, data)

    def truncate(self, size: int) -> None:
        self.cut = self.seen
        self.seen = self.seen[:size].ljust(size, b"\0")

    def sync(self) -> None:
        self.sure = self.cut = self.seen

    @property
    def zeros(self) -> bytes:
        """The size is new, and none of the data."""
        return self.sure[: len(self.seen)].ljust(len(self.seen), b"\0")


CONTENTS: tuple[Callable[[Node], bytes], ...] = (
    lambda node: node.sure,
    lambda node: node.cut,
    lambda node: node.zeros,
    lambda node: node.seen,
)
"""What may be left of a file."""


Change = dict[str, Node | None]
"""What some names of one folder are from now on, all at once; None for no name any more."""


@dataclass
class Disk:
    """Nodes by name, as of the last fsync of their folders and as the program sees them; the changes in between."""

    sure: dict[str, Node] = field(default_factory=dict)
    seen: dict[str, Node] = field(default_factory=dict)
    changes: list[Change] = field(default_factory=list)

    def change(self, change: Change) -> None:
        """Names change; whether for good is open."""
        self.changes.append(change)
        _apply(self.seen, change)

    def sync_folder(self, folder: str) -> None:
        """The names in `folder` are what they are for good."""
        open_still = []
        for change in self.changes:
            if all(os.path.dirname(path) == folder for path in change):
                _apply(self.sure, change)
            else:
                open_still.append(change)
        self.changes = open_still

    def after(self, kept: range, content: Callable[[Node], bytes]) -> Tree:
        """What is found if the power fails now, with those changes of names that are `kept`, by their place."""
        names = dict(self.sure)
        for place in kept:
            _apply(names, self.changes[place])
        folders = {path for path, node in names.items() if node.folder}
        return {
            path: None if node.folder else content(node)
            for path, node in names.items()
            if folders.issuperset(_parents(path))
        }

    def extremes(self) -> Iterator[Tree]:
        """The states at the edge of what is possible."""
        count = len(self.changes)
        for content in CONTENTS:
            yield self.after(range(0), content)
            yield self.after(range(count), content)
        for place in range(1, count):
            yield self.after(range(place), CONTENTS[0])
            yield self.after(range(place, count), CONTENTS[0])


def lay_out(tree: Tree, root: Path) -> None:
    """Write `tree` into the folder `root`."""
    for path, content in sorted(tree.items()):
        if content is None:
            (root / path).mkdir(parents=True)
        else:
            (root / path).write_bytes(content)


@contextmanager
def recorded(root: Path, disk: Disk, step: Callable[[], None]) -> Iterator[None]:
    """Tell `disk` whatever is done below `root` inside the block; `step` is called after each deed."""
    real_open, real_fsync, real_replace, real_unlink, real_mkdir = os.open, os.fsync, os.replace, os.unlink, os.mkdir
    descriptors: dict[int, str] = {}

    def known(path: Any) -> str | None:
        """The path below `root`, "" for `root` itself, None for what lies elsewhere."""
        found = Path(os.path.abspath(path))
        return str(found.relative_to(root)).removeprefix(".") if found.is_relative_to(root) else None

    def change(change: Change) -> None:
        disk.change(change)
        step()

    class File(FileIO):
        def __init__(self, path: Path, mode: str, opener: Any = None) -> None:
            super().__init__(path, mode, opener=opener)
            self._path = known(path)
            assert self._path is not None
            descriptors[self.fileno()] = self._path
            if self._path not in disk.seen:
                change({self._path: Node()})
            self._node = disk.seen[self._path]
            if mode.startswith("w"):
                self._node.truncate(0)

        def write(self, data: Any) -> int:
            written = super().write(data)
            self._node.write(self.tell() - written, bytes(data)[:written])
            step()
            return written

        def truncate(self, size: int | None = None) -> int:
            length = super().truncate(size)
            self._node.truncate(length)
            step()
            return length

    def opened(path: Any, flags: int, mode: int = 0o777, **options: Any) -> int:
        descriptor = real_open(path, flags, mode, **options)
        found = known(path)
        if found is not None:
            descriptors[descriptor] = found
            if flags & os.O_CREAT and found not in disk.seen:
                change({found: Node()})
        return descriptor

    def fsync(descriptor: int) -> None:
        real_fsync(descriptor)
        path = descriptors[descriptor]
        if path == "" or disk.seen[path].folder:
            disk.sync_folder(path)
        else:
            disk.seen[path].sync()
        step()

    def replace(source: Any, target: Any) -> None:
        real_replace(source, target)
        here, there = known(source), known(target)
        assert here is not None
        assert there is not None
        change({here: None, there: disk.seen[here]})

    def unlink(path: Any) -> None:
        real_unlink(path)
        if (found := known(path)) is not None:
            change({found: None})

    def mkdir(path: Any, mode: int = 0o777) -> None:
        real_mkdir(path, mode)
        if (found := known(path)) is not None:
            change({found: Node(folder=True)})

    with (
        mock.patch.multiple(os, open=opened, fsync=fsync, replace=replace, unlink=unlink, mkdir=mkdir),
        mock.patch.object(durable, "FileIO", File),
        mock.patch.object(journal, "FileIO", File),
    ):
        yield


def _apply(names: dict[str, Node], change: Change) -> None:
    for path, node in change.items():
        if node is None:
            names.pop(path, None)
        else:
            names[path] = node


def _overwritten(content: bytes, offset: int, data: bytes) -> bytes:
    return content[:offset].ljust(offset, b"\0") + data + content[offset + len(data) :]


def _parents(path: str) -> Iterator[str]:
    while path := os.path.dirname(path):
        yield path
