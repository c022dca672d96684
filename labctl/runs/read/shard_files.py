"""The shards of a run as they are read while it goes on, or when it was cut short: in the columns of data.h5."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.values import Drive
from labctl.runs.format.shards import NAMES, Block, Shards

PIECE_BYTES = 1 << 26  # of frames put together at a time where only some ports or samples are kept


class ShardFiles:
    """Columns put together from shards.

    Attributes:
        drive: what the AWG played, None if nothing.
        frames: `/frames`, read from the shards that an index needs.
        suspect: how many shots are left out because they are in doubt.
    """

    def __init__(self, shards: Shards, drive: Drive | None) -> None:
        """Of the sound shots of `shards`."""
        self.drive = drive
        self.frames = ShardFrames(shards)
        self.suspect = len(shards.complete) - len(self.frames)
        self._shards = shards
        self._columns: Block | None = None

    def column(self, name: str) -> NDArray[Any]:
        """A whole data set other than the frames; with the first one all are read, since they fit in memory.

        Raises:
            RunError: a shard is missing or damaged.
        """
        if self._columns is None:
            self._columns = self._shards.block(self._shards.sound, [one for one in NAMES if one != "frames"])
        return self._columns[name]

    def planned(self) -> NDArray[Any]:
        """The table `/shots`; what is measured is still zero in it."""
        return self._shards.planned

    def scales(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Scale and offset per port."""
        return self._shards.all_scales()

    def close(self) -> None:
        """Nothing is kept open."""


class ShardFrames:
    """`/frames` as it would be in data.h5, without what is in doubt."""

    def __init__(self, shards: Shards) -> None:
        """Of the sound shots of `shards`."""
        self._shards = shards
        self._sound = shards.sound
        self.shape = (len(self._sound), len(shards.shape.ports), shards.shape.samples)
        self.dtype = shards.shape.dtype

    def __len__(self) -> int:
        return len(self._sound)

    def __getitem__(self, key: Any) -> NDArray[Any]:
        chosen, *rest = key if isinstance(key, tuple) else (key,)
        if chosen is Ellipsis:
            chosen, rest = slice(None), [Ellipsis, *rest]
        indices = self._sound[chosen]
        if np.ndim(indices) == 0:
            return np.asarray(self._read(np.atleast_1d(indices), tuple(rest))[0])
        return self._read(indices, tuple(rest))

    def _read(self, indices: NDArray[np.int64], rest: tuple[Any, ...]) -> NDArray[Any]:
        """Some shots; where not all of them is kept, piece by piece, so that the rest is never in memory as a whole."""
        step = max(1, PIECE_BYTES // self._shards.shape.shot_bytes) if rest else len(indices)
        first = self._whole(indices[:step])[(slice(None), *rest)]
        if len(indices) <= step:
            return first
        frames = np.empty((len(indices), *first.shape[1:]), self.dtype)
        frames[:step] = first
        for start in range(step, len(indices), step):
            frames[start : start + step] = self._whole(indices[start : start + step])[(slice(None), *rest)]
        return frames

    def _whole(self, indices: NDArray[np.int64]) -> NDArray[Any]:
        return self._shards.block(indices, ["frames"])["frames"]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[:], dtype)
