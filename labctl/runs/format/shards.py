"""All shards of a run, as one table of the shots that are complete on all passes."""

import errno
import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.remedies import unreadable
from labctl.errors import RunError, ShardLost
from labctl.runs.format.columns import MEASURED, OF_A_SHOT, SHOTS_DTYPE, in_this_version, sizes_of
from labctl.runs.format.journal import Entry
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.own_files import read_own
from labctl.runs.format.shape import RunShape
from labctl.runs.format.shard import MOST_BYTES, Shard
from labctl.runs.format.store import mended

MOST_SHARDS = 10**9
BLOCK_BYTES = 1 << 20  # of /frames: one chunk of data.h5, and what readers hold in memory at a time
NAMES = ("shots", *(array.name for array in OF_A_SHOT))
"""What of data.h5 is made from shards."""

Rows = slice | NDArray[np.int64]
Block = dict[str, NDArray[Any]]


class Shards:
    """Everything the closed shards of a run hold, as one table of the shots that are complete on all passes.

    Only shards that the journal names are read, and each is compared with its sha256 whenever it is read. Memory is
    that of the result and of the last shard of each pass, however long the run.
    """

    def __init__(self, paths: RunPaths, shape: RunShape, plan: NDArray[Any], entries: Sequence[Entry]) -> None:
        """`plan`: the planned `/shots`, shape (shots,).

        Raises:
            RunError: plan or journal are not of a run of this shape.
        """
        if np.shape(plan) != (shape.shots,):
            raise RunError(f"{paths.plan}: holds {np.size(plan)} shots, the manifest has {shape.shots}; restore a copy")
        if max(shape.shot_bytes, 8 * len(shape.passes) * shape.shots) > MOST_BYTES:
            size = f"a shot of {shape.shot_bytes} bytes or {len(shape.passes)} passes"
            raise RunError(f"{paths.manifest}: {size}: no such run is read")
        try:
            self._plan = plan if plan.dtype == SHOTS_DTYPE else in_this_version(plan)
        except (TypeError, ValueError) as error:
            raise RunError(f"{paths.plan}: its shots are not planned ones ({error}); restore a copy") from None
        self.paths = paths
        self.shape = shape
        self.entries: dict[int, Entry] = {}
        self._held: dict[int, tuple[int, Shard]] = {}
        self._owner = np.full((len(shape.passes), shape.shots), -1, np.int64)
        self._sound = np.zeros(self._owner.shape, np.bool_)
        self._done = np.zeros(len(shape.passes), np.int64)
        self.completed = 0  # how many shots all passes have, and none of them in doubt
        for entry in entries:
            self.add(entry)

    def add(self, entry: Entry) -> int:
        """Take in one more line of the journal; returns by how much the number of complete shots changes.

        Raises:
            RunError: the line is not of a run of this shape.
        """
        last = entry.first + entry.count
        if entry.passes != len(self._owner) or not (
            0 <= entry.pass_index < entry.passes
            and 0 <= entry.first < last <= self.shape.shots
            and 0 <= entry.shard < MOST_SHARDS
        ):
            raise RunError(f"{self.paths.journal}: the line of shard {entry.shard} is not of this run; restore a copy")
        window, sound = self._owner[:, entry.first : last], self._sound[:, entry.first : last]
        before = np.count_nonzero(sound, axis=1), np.count_nonzero(sound.all(axis=0))
        of_pass = window[entry.pass_index]
        if entry.discarded:
            self.entries.pop(entry.shard, None)
        else:
            if entry.shard not in self.entries:
                of_pass[:] = entry.shard
            self.entries[entry.shard] = entry
        own = of_pass == entry.shard
        sound[entry.pass_index][own] = not (entry.discarded or entry.suspect)
        if entry.discarded:
            of_pass[own] = -1
        change = int(np.count_nonzero(sound.all(axis=0)) - before[1])
        self._done += np.count_nonzero(sound, axis=1) - before[0]
        self.completed += change
        return change

    def has(self, pass_index: int, first: int, count: int = 1) -> bool:
        """Whether a pass has any of `count` shots from `first` on."""
        return bool((self._owner[pass_index, first : first + count] >= 0).any())

    @property
    def taken(self) -> NDArray[np.bool_]:
        """Which shots each pass has, in doubt or not, shape (passes, shots)."""
        return self._owner >= 0

    def entry(
        self, number: int, pass_index: int, first: int, count: int, image: bytes | memoryview, suspect: str = ""
    ) -> Entry:
        """The line of the journal for a shard with the bytes `image`: `count` shots of a pass from `first` on."""
        others = np.delete(self._sound[:, first : first + count], pass_index, axis=0)
        completed = 0 if suspect else int(np.count_nonzero(others.all(axis=0)))
        digest = hashlib.sha256(image).hexdigest()
        return Entry(number, pass_index, len(self.shape.passes), first, completed, count, digest, suspect=suspect)

    def entered_again(self, entry: Entry, suspect: str) -> Entry:
        """The line by which the shots of a shard become suspect for a reason, or no longer are; it is taken in."""
        line = replace(entry, suspect=suspect, shots=0)
        return replace(line, shots=self.add(line))

    @property
    def done(self) -> tuple[int, ...]:
        """How many shots each pass has that are not in doubt."""
        return tuple(int(count) for count in self._done)

    @property
    def complete(self) -> NDArray[np.int64]:
        """Indices of the shots that all passes have, in doubt or not, ascending: the rows of data.h5."""
        return np.flatnonzero((self._owner >= 0).all(axis=0)).astype(np.int64)

    @property
    def sound(self) -> NDArray[np.int64]:
        """Indices of the shots that all passes have and that are in doubt on none, ascending: what readers give."""
        return np.flatnonzero(self._sound.all(axis=0)).astype(np.int64)

    @property
    def suspect(self) -> dict[str, int]:
        """Why shots are in doubt, and how many for each reason."""
        reasons: dict[str, int] = {}
        for entry in self.entries.values():
            if entry.suspect:
                reasons[entry.suspect] = reasons.get(entry.suspect, 0) + entry.count
        return reasons

    @property
    def planned(self) -> NDArray[Any]:
        """`/shots` of the `sound` shots as the plan has them; epoch, time and flags are still zero."""
        planned: NDArray[Any] = self._plan[self.sound]
        return planned

    def missing(self, pass_index: int) -> NDArray[np.int64]:
        """Indices of the shots that a pass lacks or that are in doubt on it, ascending."""
        return np.flatnonzero(~self._sound[pass_index]).astype(np.int64)

    def stored(self, pass_index: int) -> NDArray[np.int64]:
        """Indices of the shots that a pass has and that are in doubt on none, ascending."""
        return np.flatnonzero(self._sound[pass_index]).astype(np.int64)

    def codes(self, pass_index: int, shot: int) -> NDArray[Any]:
        """Codes of a shot that a pass has, shape (ports of the pass, samples).

        Raises:
            RunError: its shard is missing or damaged.
        """
        shard = self.holding(pass_index, shot)
        codes: NDArray[Any] = shard.frames[shot - shard.first]
        return codes

    def holding(self, pass_index: int, shot: int) -> Shard:
        """The shard with a shot that a pass has.

        Raises:
            RunError: it is missing or damaged.
        """
        return self.read(int(self._owner[pass_index, shot]))

    def latest(self) -> tuple[float, int] | None:
        """Time (s since the run began) and epoch of the shot that was stored last; None before the first.

        Raises:
            RunError: its shard is missing or damaged.
        """
        if not self.entries:
            return None
        last = self.read(max(self.entries)).rows[-1]
        return float(last["time_s"]), int(last["epoch"])

    @property
    def evidence(self) -> str:
        """A digest that names exactly this set of shards: data.h5 carries that of the shards it was made from."""
        lines = [
            f"{number} {entry.sha256}{' suspect' if entry.suspect else ''}\n"
            for number, entry in sorted(self.entries.items())
        ]
        return hashlib.sha256("".join(lines).encode()).hexdigest()

    @property
    def rows_per_block(self) -> int:
        """Whole shots in about 1 MB of frames."""
        return max(1, BLOCK_BYTES // self.shape.shot_bytes)

    def image(self, number: int) -> bytes:
        """The bytes of one shard.

        Raises:
            ShardLost: it is missing, or not the one that the journal names.
            RunError: it cannot be read, whatever is in it.
        """
        path = self.paths.shard(number)
        remedy = mended(path, "`labctl resume` makes it again from data.h5, or measures its shots again")
        try:
            image = read_own(path, MOST_BYTES)
        except OSError as error:
            lost = error.errno in (errno.ENOENT, errno.EFBIG)  # no shard is as large as that
            raise (ShardLost if lost else RunError)(unreadable(path, error, remedy)) from error
        if hashlib.sha256(image).hexdigest() != self.entries[number].sha256:
            raise ShardLost(f"{path}: damaged: its sha256 is not the journal's: {remedy}")
        return image

    def read(self, number: int) -> Shard:
        """Read one shard.

        Raises:
            ShardLost: it is missing, or not the one that the journal names.
            RunError: it cannot be read, or is not of this run.
        """
        entry = self.entries[number]
        path = self.paths.shard(number)
        shard = Shard.decode(self.image(number), self.shape, str(path))
        if (shard.pass_index, shard.first, len(shard.rows)) != (entry.pass_index, entry.first, entry.count):
            raise RunError(f"{path}: holds other shots than the journal says")
        return shard

    def scales(self, pass_index: int) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Scale and offset per port of a pass, in V per code and V; None before its first shard."""
        for number, entry in self.entries.items():
            if entry.pass_index == pass_index:
                shard = self.read(number)
                return shard.scale, shard.offset
        return None

    def all_scales(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Scale and offset of every port, NaN where nothing was measured yet; each of shape (ports,)."""
        scale, offset = np.full((2, len(self.shape.ports)), np.nan)
        for pass_index in range(len(self.shape.passes)):
            if (found := self.scales(pass_index)) is not None:
                scale[self.shape.columns(pass_index)], offset[self.shape.columns(pass_index)] = found
        return scale, offset

    def blocks(self) -> Iterator[tuple[int, Block]]:
        """All complete shots, block after block: the number of the first row, and the block."""
        complete = self.complete
        for start in range(0, len(complete), self.rows_per_block):
            yield start, self.block(complete[start : start + self.rows_per_block])

    def block(self, indices: NDArray[np.int64], names: Iterable[str] = NAMES) -> Block:
        """The given complete shots (ascending indices) in some of the data sets of data.h5.

        Raises:
            RunError: a shard is missing or damaged.
        """
        sizes = sizes_of(self.shape, len(indices))
        block: Block = {
            array.name: np.zeros([sizes[axis] for axis in array.axes], array.type or self.shape.dtype)
            for array in OF_A_SHOT
            if array.name in names
        }
        shots = self._plan[indices]
        for pass_index, here, there, shard in self._parts(indices):
            ports = self.shape.columns(pass_index)
            for name, column, values in (
                ("frames", ports, shard.frames),
                ("trigger_offset_s", ports, shard.trigger_offset_s),
                ("clipped", ports, shard.clipped),
                ("epoch", pass_index, shard.rows["epoch"]),
                ("measured_at_s", pass_index, shard.rows["time_s"]),
            ):
                if name in block:
                    block[name][here, column] = values[there]
            flags = shots["flags"][here] | shard.rows["flags"][there]
            later = shard.rows["time_s"][there] >= shots["time_s"][here]  # a pass may have been measured again
            for measured in MEASURED:
                values = shots[measured.name]
                values[here] = np.where(later, shard.rows[measured.name][there], values[here])
            shots["flags"][here] = flags
        shots["suspect"] = ~self._sound[:, indices].all(axis=0)
        return block | ({"shots": shots} if "shots" in names else {})

    def _parts(self, indices: NDArray[np.int64]) -> Iterator[tuple[int, Rows, Rows, Shard]]:
        """The shards that have some shots, pass after pass: where they lie among `indices`, and where in the shard."""
        for pass_index in range(len(self.shape.passes)):
            owners = self._owner[pass_index, indices]
            for number in np.unique(owners):
                held = self._held.get(pass_index)
                if held is None or held[0] != number:
                    held = self._held[pass_index] = int(number), self.read(int(number))
                here = np.flatnonzero(owners == number)
                yield pass_index, _rows(here), _rows(indices[here] - held[1].first), held[1]


def _rows(places: NDArray[np.int64]) -> Rows:
    """Ascending places, as a slice where they follow one another: so they are not copied to be read."""
    first, last = int(places[0]), int(places[-1])
    return slice(first, last + 1) if last - first + 1 == len(places) else places
