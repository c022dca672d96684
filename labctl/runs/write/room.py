"""Room on the disk: what the files of a run take, known from their formats before a byte is written, and what is free.

The sizes of shards, journal, plan and data.h5 follow from the shape of the run. What is not known to the byte is taken
as it is at most: every file takes whole pages of the file system, gaps cut a pass into one shard more, and the last
chunk of data.h5 is stored whole. How long commands.log grows no format says; it is allowed what labctl's drivers write
for a record.
"""

import errno
import logging
import math
import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from labctl.errors import RunError
from labctl.runs.format.durable import not_written
from labctl.runs.format.journal import Entry
from labctl.runs.format.plan import encode_plan
from labctl.runs.format.shards import BLOCK_BYTES, ROWS_DTYPE, Shard, Shards
from labctl.runs.format.shots import SHOTS_DTYPE, Durability, PlayedDrive, RunShape, ShotColumns
from labctl.runs.write.data_file import data_file_headers

PAGE = 1 << 12
MANIFEST = 1 << 16
"""Bytes allowed for the manifest, as a file and in data.h5: ten times what one has."""
LOG_OF_A_PASS = 1 << 17
"""Bytes of commands.log for the settings, uploads and probe shots of a pass: twice what they are with four channels."""
LOG_OF_A_SHOT = 1 << 11
"""Bytes of commands.log for one shot on one pass: one and a half times what they are with four channels."""
CHUNK_NODE, CHUNKS_A_NODE = 3136, 32
"""HDF5 file format, III.A.1, three axes: bytes of a node of the index of chunks, and how many it holds half full."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Sizes:
    """What the files of a run take, in bytes.

    shard_headers: a shard of each pass beside its rows. data_headers: data.h5 beside its rows.
    """

    shape: RunShape
    shard_headers: tuple[int, ...]
    data_headers: int

    def shard(self, pass_index: int, shots: int) -> int:
        """A shard of so many shots of a pass, to the byte."""
        ports = len(self.shape.passes[pass_index])
        row = ports * (self.shape.samples * self.shape.dtype.itemsize + 8 + 1) + ROWS_DTYPE.itemsize
        return self.shard_headers[pass_index] + shots * row

    @property
    def data_file(self) -> int:
        """data.h5 of all shots, at most."""
        ports, passes, shots = len(self.shape.ports), len(self.shape.passes), self.shape.shots
        frames = ports * self.shape.samples * self.shape.dtype.itemsize
        rows = min(shots, max(1, BLOCK_BYTES // frames))
        chunks = math.ceil(shots / rows)
        index = CHUNK_NODE * (2 + math.ceil(chunks / CHUNKS_A_NODE))
        beside = ports * (8 + 1) + passes * (4 + 8) + SHOTS_DTYPE.itemsize + 8
        return _pages(self.data_headers + index + chunks * rows * frames + shots * beside)

    def whole_run(self, plan: int, shots_a_shard: float) -> int:
        """Everything that a run with a plan.h5 of so many bytes writes, at most."""
        missing = [self.shape.shots] * len(self.shape.passes)
        return _pages(plan) + MANIFEST + self.measured(missing, shots_a_shard) + self.data_file

    def measured(self, missing: Sequence[int], shots_a_shard: float) -> int:
        """Shards, journal and commands.log, at most, of the shots that each pass lacks."""
        shots = self.shape.shots
        line = len(Entry(shots, shots, shots, shots, shots, shots, "0" * 64).encode())
        total = 0
        for index, count in enumerate(missing):
            if count:
                rows = self.shard(index, count) - self.shard_headers[index]
                shards = math.ceil(count / shots_a_shard) + 1
                total += rows + shards * (self.shard_headers[index] + PAGE + line)
                total += LOG_OF_A_PASS + count * LOG_OF_A_SHOT
        return total


@lru_cache(maxsize=1)
def sizes_of(shape: RunShape, drive_samples: int) -> Sizes:
    """Found by making an empty file of each kind in memory; without a drive it has 0 samples."""
    shards = tuple(len(Shard.empty(shape, index).encode(shape)) for index in range(len(shape.passes)))
    beside = MANIFEST + 8 * shape.samples + (4 + 1) * drive_samples
    return Sizes(shape, shards, data_file_headers(shape) + beside)


def shots_a_shard(shape: RunShape, durability: Durability, seconds_a_shot: float) -> float:
    """How many shots close a shard, by their number, size or age, where one takes so long on one pass."""
    row = max(map(len, shape.passes)) * shape.samples * shape.dtype.itemsize
    by_age = durability.seconds / seconds_a_shot if seconds_a_shot else math.inf
    return max(1.0, min(durability.shots, durability.shard_bytes // row, by_age))


def samples_of(drive: PlayedDrive | None) -> int:
    """How long a drive is, 0 for none."""
    return 0 if drive is None else len(drive.samples)


def needed(
    shape: RunShape, plan: ShotColumns, drive: PlayedDrive | None, durability: Durability, seconds_a_shot: float
) -> int:
    """Bytes of a run that has not begun, at most.

    Raises:
        ValueError: columns of different lengths, or an unknown kind.
    """
    image = encode_plan(plan.table(), drive)
    sizes = sizes_of(shape, samples_of(drive))
    return sizes.whole_run(len(image), shots_a_shard(shape, durability, seconds_a_shot))


def require(directory: Path, size: int) -> None:
    """Refuse to begin a run, or to go on with one, where there is too little room for it.

    Raises:
        RunError: with what is needed and what is free.
    """
    if (found := _free(directory)) < size:
        raise RunError(
            f"{directory}: the run needs up to {_text(size)} and the disk has {_text(found)} free: make room, or "
            f"move to another disk"
        )


class Room:
    """Looks at the free space while a run goes on; `tell` gets what standard error is told too."""

    def __init__(self, directory: Path, sizes: Sizes, shots_a_shard: float) -> None:
        """For the run in `directory`, whose shards are expected to hold so many shots."""
        self.tell: Callable[[str], object] = _unheard
        self._directory = directory
        self._sizes = sizes
        self._expected = shots_a_shard
        self._told = False

    def to_come(self, shards: Shards, *, data_file: bool = True) -> int:
        """Bytes that are still to be written, at most, with data.h5 or without.

        The shards so far tell how many shots the others will hold.
        """
        missing = [self._sizes.shape.shots - done for done in shards.done]
        held = sum(shards.done) / len(shards.entries) if shards.entries else 0.0
        return self._sizes.measured(missing, held or self._expected) + data_file * self._sizes.data_file

    def before(self, path: Path, size: int, shards: Shards) -> None:
        """To be called before a shard of `size` bytes is written to `path`.

        Too little room for what is still to come is told once, and the run goes on: room may be made meanwhile.

        Raises:
            RunError: the shard itself has no room.
        """
        found = _free(self._directory)
        if found < (least := _pages(size) + PAGE):  # the line in the journal may begin a page
            full = f"{os.strerror(errno.ENOSPC)} ({_text(least)} needed, {_text(found)} free)"
            raise not_written(path, OSError(errno.ENOSPC, full))
        if not self._told and found < (rest := self.to_come(shards)):
            self._told = True
            line = (
                f"{self._directory}: the disk has {_text(found)} free and up to {_text(rest)} are still to come: "
                f"make room while the run goes on"
            )
            _logger.warning("%s", line)
            self.tell(line)


def _unheard(_line: str) -> None:
    """Nobody listens but standard error."""


def _free(directory: Path) -> int:
    """Bytes free where `directory` is or will be.

    Raises:
        RunError: the file system does not say.
    """
    try:
        existing = next(folder for folder in (directory, *directory.absolute().parents) if folder.exists())
        return shutil.disk_usage(existing).free
    except OSError as error:
        raise not_written(directory, error) from error


def _pages(size: int) -> int:
    return math.ceil(size / PAGE) * PAGE


def _text(size: int) -> str:
    """Bytes for people, to three digits."""
    for unit, name in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= unit:
            return f"{size / unit:.3g} {name}"
    return f"{size} B"
