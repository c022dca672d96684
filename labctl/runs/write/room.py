"""Room on the disk: what the files of a run take at most, known before a byte is written, and what is free.

The sizes of shards, journal, plan and data.h5 follow from the shape of the run, up to what HDF5 writes around the
numbers, for which a constant is allowed. Every file takes whole pages of the file system, and gaps cut a pass into one
shard more. No format limits commands.log; it is allowed what labctl's drivers write for a record.
"""

import errno
import logging
import math
import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from instruments.values import Drive
from labctl.errors import RunError
from labctl.runs.format.columns import ARRAYS, ROWS_DTYPE, SHOTS_DTYPE, sizes_of
from labctl.runs.format.durable import not_made, not_written
from labctl.runs.format.journal import Entry
from labctl.runs.format.shape import RunShape
from labctl.runs.format.shards import BLOCK_BYTES, Shards
from labctl.runs.write.durability import Durability

PAGE = 1 << 12
SHARD_HEADERS = 1 << 12
"""Bytes allowed for what HDF5 puts around the numbers of a shard: 2.2 kB, and 24 bytes a port."""
DATA_HEADERS = 6 * PAGE
"""Bytes allowed for what HDF5 puts around the numbers of data.h5 and plan.h5: 19 kB, units and meanings among them."""
MARGIN = 0.01
"""Of data.h5, for the index of its chunks: a node of 3 kB for 32 of about 1 MB; more where a shot is larger."""
MANIFEST = 1 << 16
"""Bytes allowed for the manifest, as a file and in data.h5: ten times what one has."""
LOG_OF_A_PASS = 1 << 17
"""Bytes of commands.log for the settings, uploads and probe shots of a pass: twice what they are with four channels."""
LOG_OF_A_SHOT = 1 << 9
"""Bytes of commands.log for one shot on one pass: twice what four channels take whose trigger offsets all differ."""

_logger = logging.getLogger(__name__)


def needed(shape: RunShape, drive: Drive | None, in_a_shard: float) -> int:
    """Bytes of a run that has not begun, at most, where a shard has so many shots."""
    played = 0 if drive is None else drive.samples.nbytes + drive.marker.nbytes
    plan = DATA_HEADERS + played + shape.shots * SHOTS_DTYPE.itemsize
    missing = [shape.shots] * len(shape.passes)
    shards = measured(shape, missing, in_a_shard)
    return _pages(plan) + MANIFEST + shards + data_file(shape, drive)


def measured(shape: RunShape, missing: Sequence[int], shots_a_shard: float) -> int:
    """Bytes of shards, journal and commands.log, at most, of the shots that each pass lacks."""
    most = shape.shots
    line = len(Entry(most, most, most, most, most, most, "0" * 64).encode())
    total = 0
    for ports, count in zip(shape.passes, missing, strict=True):
        if count:
            row = len(ports) * (shape.samples * shape.dtype.itemsize + 8 + 1) + ROWS_DTYPE.itemsize
            shards = math.ceil(count / shots_a_shard) + 1
            total += count * row + shards * (SHARD_HEADERS + PAGE + line)
            total += LOG_OF_A_PASS + count * LOG_OF_A_SHOT
    return total


def data_file(shape: RunShape, drive: Drive | None) -> int:
    """Bytes of data.h5 of all shots, at most; its last chunk is stored whole."""
    rows = min(shape.shots, max(1, BLOCK_BYTES // shape.shot_bytes))
    frames = math.ceil(shape.shots / rows) * rows * shape.shot_bytes
    sizes = sizes_of(shape, shape.shots) | {"drive_sample": 0 if drive is None else len(drive.samples)}
    columns = shape.shots * SHOTS_DTYPE.itemsize + sum(
        np.dtype(array.type).itemsize * math.prod(sizes[axis] for axis in array.axes)
        for array in ARRAYS
        if array.name != "frames"
    )
    return _pages(DATA_HEADERS + MANIFEST + (1 + MARGIN) * frames + columns)


def shots_a_shard(
    shape: RunShape, durability: Durability, seconds_a_shot: float = 0.0, together: float = math.inf
) -> float:
    """How many shots close a shard, by their number, size or age, where one takes so long on one pass.

    together: how many come at once, and close it, at most; infinite where each comes by itself.
    """
    row = max(map(len, shape.passes)) * shape.samples * shape.dtype.itemsize
    by_age = durability.seconds / seconds_a_shot if seconds_a_shot else math.inf
    return max(1.0, min(durability.shots, durability.shard_bytes // row, by_age, together))


def require(directory: Path, size: int) -> None:
    """Refuse to begin to measure, or to go on, where there is too little room for it.

    Raises:
        RunError: with what is needed and what is free.
    """
    if (found := _free(directory)) < size:
        raise RunError(
            f"{directory}: up to {_text(size)} are needed and the disk has {_text(found)} free: make room, or move to "
            f"another disk"
        )


class Room:
    """Looks at the free space while a run goes on."""

    def __init__(
        self, directory: Path, shape: RunShape, drive: Drive | None, shots_a_shard: float, warn: Callable[[str], object]
    ) -> None:
        """For the run in `directory`, whose shards are expected to hold so many shots.

        `warn` is called with the line that goes to standard error too.
        """
        self._directory = directory
        self._shape = shape
        self._data_file = data_file(shape, drive)
        self._expected = shots_a_shard
        self._warn = warn
        self._warned = False

    def to_come(self, shards: Shards, *, data_file: bool = True) -> int:
        """Bytes that are still to be written, at most, with data.h5 or without.

        The shards so far show how many shots the others will hold.
        """
        missing = [self._shape.shots - done for done in shards.done]
        held = sum(shards.done) / len(shards.entries) if shards.entries else 0.0
        return measured(self._shape, missing, held or self._expected) + data_file * self._data_file

    def before(self, path: Path, size: int, shards: Shards) -> None:
        """To be called before a shard of `size` bytes is written to `path`.

        Too little room for what is still to come is a warning, once, and the run goes on: room may be made meanwhile.

        Raises:
            RunError: the shard itself has no room.
        """
        found = _free(self._directory)
        if found < (least := _pages(size) + PAGE):  # the line in the journal may begin a page
            full = f"{os.strerror(errno.ENOSPC)} ({_text(least)} needed, {_text(found)} free)"
            raise not_written(path, OSError(errno.ENOSPC, full))
        if not self._warned and found < (rest := self.to_come(shards)):
            self._warned = True
            line = (
                f"{self._directory}: the disk has {_text(found)} free and up to {_text(rest)} are still to come: "
                f"make room while the run goes on"
            )
            _logger.warning("%s", line)
            self._warn(line)


def _free(directory: Path) -> int:
    """Bytes free where `directory` is or will be.

    Raises:
        RunError: the file system does not say.
    """
    try:
        existing = next(folder for folder in (directory, *directory.absolute().parents) if folder.exists())
        return shutil.disk_usage(existing).free
    except OSError as error:
        raise not_made(directory, error) from error


def _pages(size: float) -> int:
    return math.ceil(size / PAGE) * PAGE


def _text(size: int) -> str:
    """Bytes for people, to three digits."""
    for unit, name in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= unit:
            return f"{size / unit:.3g} {name}"
    return f"{size} B"
