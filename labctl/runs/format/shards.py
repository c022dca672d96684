"""Shards: the files that hold what was measured, and the view of all of them that the rest of the package reads.

A shard is a small HDF5 file built in memory, so that it reaches the disk in one write and its sha256 is known without
reading it back. It carries no times of writing: the same shots give the same bytes. Inside:

    /frames            (shot, port, sample)  digitiser codes
    /trigger_offset_s  (shot, port)          s
    /clipped           (shot, port)
    /rows              (shot,)               compound: shot, time_s, epoch, flags
    /scale  /offset    (port,)               volts = scale * code + offset
    attributes: format_version, pass, first, ports
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from instruments.values import Frames
from labctl.errors import RunError
from labctl.runs.format.journal import Entry
from labctl.runs.format.layout import FORMAT_VERSION, HDF5_ERRORS, LIBVER, RunPaths, check_version
from labctl.runs.format.plain_hdf5 import check_plain, opened_image
from labctl.runs.format.shots import RunShape, ShotFlag, in_this_version

ROWS_DTYPE = np.dtype([("shot", "<i8"), ("time_s", "<f8"), ("epoch", "<i4"), ("flags", "<i4")])
MOST_BYTES = 1 << 30  # of one shard, as a file and unpacked: a burst of 1000 shots, 14 ports, 2500 samples has 35 MB
MOST_SHARDS = 10**9
BLOCK_BYTES = 1 << 20  # of /frames: one chunk of data.h5, and what readers hold in memory at a time

Block = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Shard:
    """The content of one shard; shapes as in the module's description."""

    pass_index: int
    first: int
    scale: NDArray[np.float64]
    offset: NDArray[np.float64]
    frames: NDArray[Any]
    trigger_offset_s: NDArray[np.float64]
    clipped: NDArray[np.bool_]
    rows: NDArray[Any]

    @classmethod
    def of(
        cls,
        pass_index: int,
        first: int,
        frames: Frames,
        epoch: int | NDArray[np.int32],
        scale: NDArray[np.float64],
        offset: NDArray[np.float64],
    ) -> "Shard":
        """The shots of a pass from `first` on; times are s since the run began, `epoch` is one for all or one each."""
        rows = np.zeros(len(frames), ROWS_DTYPE)
        rows["shot"] = first + np.arange(rows.size)
        rows["time_s"] = frames.time_s
        rows["epoch"] = epoch
        rows["flags"] = np.where(frames.clipped.any(axis=1), int(ShotFlag.CLIPPED), 0)
        return cls(pass_index, first, scale, offset, frames.codes, frames.trigger_offset_s, frames.clipped, rows)

    @classmethod
    def empty(cls, shape: RunShape, pass_index: int) -> "Shard":
        """Of no shots: its bytes are what every shard of the pass has beside its rows."""
        ports = len(shape.passes[pass_index])
        return cls(
            pass_index=pass_index,
            first=0,
            scale=np.zeros(ports),
            offset=np.zeros(ports),
            frames=np.zeros((0, ports, shape.samples), shape.dtype),
            trigger_offset_s=np.zeros((0, ports)),
            clipped=np.zeros((0, ports), np.bool_),
            rows=np.zeros(0, ROWS_DTYPE),
        )

    def encode(self, shape: RunShape) -> bytes:
        """The bytes of the file."""
        with h5py.File("shard", "w", driver="core", backing_store=False, libver=LIBVER) as file:
            file.create_dataset("frames", data=np.asarray(self.frames, shape.dtype))
            file.create_dataset("trigger_offset_s", data=np.asarray(self.trigger_offset_s, "<f8"))
            file.create_dataset("clipped", data=np.asarray(self.clipped, np.bool_))
            file.create_dataset("rows", data=self.rows)
            file.create_dataset("scale", data=np.asarray(self.scale, "<f8"))
            file.create_dataset("offset", data=np.asarray(self.offset, "<f8"))
            file.attrs["format_version"] = FORMAT_VERSION
            file.attrs["pass"] = np.int64(self.pass_index)
            file.attrs["first"] = np.int64(self.first)
            file.attrs["ports"] = np.asarray(shape.passes[self.pass_index], "<i8")
            file.flush()
            image: bytes = file.id.get_file_image()
        return image

    @classmethod
    def decode(cls, image: bytes, shape: RunShape, origin: str) -> "Shard":
        """The inverse of `encode`; `origin` names the file in messages.

        Raises:
            RunError: not a whole shard, or not one of a run of this shape.
        """
        try:
            with opened_image(image) as file:
                check_version(file.attrs["format_version"], Path(origin))
                check_plain(file, MOST_BYTES)
                shard = cls(
                    pass_index=int(file.attrs["pass"]),
                    first=int(file.attrs["first"]),
                    scale=file["scale"][:],
                    offset=file["offset"][:],
                    frames=file["frames"][:],
                    trigger_offset_s=file["trigger_offset_s"][:],
                    clipped=file["clipped"][:],
                    rows=file["rows"][:],
                )
        except HDF5_ERRORS as error:
            raise RunError(f"{origin}: damaged shard ({error})") from error
        if not 0 <= shard.pass_index < len(shape.passes):
            raise RunError(f"{origin}: pass {shard.pass_index} is not one of this run")
        count, ports = len(shard.rows), len(shape.passes[shard.pass_index])
        for name, kind, size in (
            ("frames", shape.dtype, (count, ports, shape.samples)),
            ("trigger_offset_s", np.dtype("<f8"), (count, ports)),
            ("clipped", np.dtype(np.bool_), (count, ports)),
            ("rows", ROWS_DTYPE, (count,)),
            ("scale", np.dtype("<f8"), (ports,)),
            ("offset", np.dtype("<f8"), (ports,)),
        ):
            found = getattr(shard, name)
            if found.dtype != kind or found.shape != size:
                raise RunError(f"{origin}: {name} are not of this run's shape")
        last = shard.first + count
        if not 0 <= shard.first < last <= shape.shots or shard.rows["shot"].tolist() != list(range(shard.first, last)):
            raise RunError(f"{origin}: its shots are not a range of this run's")
        return shard


class Shards:
    """Everything the closed shards of a run hold, as one table of the shots that are complete on all passes.

    Only shards that the journal names are read, and each is compared with its sha256 whenever it is read. Memory is
    that of the block asked for, however long the run.
    """

    def __init__(self, paths: RunPaths, shape: RunShape, plan: NDArray[Any], entries: Sequence[Entry]) -> None:
        """`plan`: the planned `/shots`, shape (shots,).

        Raises:
            RunError: plan or journal are not of a run of this shape.
        """
        if np.shape(plan) != (shape.shots,):
            raise RunError(f"{paths.plan}: holds {np.size(plan)} shots, the manifest has {shape.shots}; restore a copy")
        shot = len(shape.ports) * shape.samples * shape.dtype.itemsize
        if max(shot, 8 * len(shape.passes) * shape.shots) > MOST_BYTES:
            raise RunError(
                f"{paths.manifest}: a shot of {shot} bytes or {len(shape.passes)} passes: no such run is read"
            )
        try:
            self._plan = in_this_version(plan)
        except (TypeError, ValueError) as error:
            raise RunError(f"{paths.plan}: its shots are not planned ones ({error}); restore a copy") from None
        self.paths = paths
        self.shape = shape
        self.entries: dict[int, Entry] = {}
        self._owner = np.full((len(shape.passes), shape.shots), -1, np.int64)
        self._done = np.zeros(len(shape.passes), np.int64)
        self.completed = 0  # how many shots all passes have
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
        window = self._owner[:, entry.first : last]
        before = np.count_nonzero(window >= 0, axis=1), np.count_nonzero((window >= 0).all(axis=0))
        if entry.discarded:
            self.entries.pop(entry.shard, None)
            window[entry.pass_index][window[entry.pass_index] == entry.shard] = -1
        else:
            self.entries[entry.shard] = entry
            window[entry.pass_index] = entry.shard
        change = int(np.count_nonzero((window >= 0).all(axis=0)) - before[1])
        self._done += np.count_nonzero(window >= 0, axis=1) - before[0]
        self.completed += change
        return change

    def has(self, pass_index: int, first: int, count: int = 1) -> bool:
        """Whether a pass has any of `count` shots from `first` on."""
        return bool((self._owner[pass_index, first : first + count] >= 0).any())

    @property
    def taken(self) -> NDArray[np.bool_]:
        """Which shots each pass has, shape (passes, shots)."""
        return self._owner >= 0

    def completes(self, pass_index: int, first: int, count: int) -> int:
        """How many shots become complete when a pass gets `count` shots from `first` on."""
        others = np.delete(self._owner[:, first : first + count] >= 0, pass_index, axis=0)
        return int(np.count_nonzero(others.all(axis=0)))

    @property
    def done(self) -> tuple[int, ...]:
        """How many shots each pass has."""
        return tuple(int(count) for count in self._done)

    @property
    def complete(self) -> NDArray[np.int64]:
        """Indices of the shots that all passes have, ascending."""
        return np.flatnonzero((self._owner >= 0).all(axis=0)).astype(np.int64)

    @property
    def planned(self) -> NDArray[Any]:
        """`/shots` of the complete shots as the plan has them; epoch, time and flags are still zero."""
        planned: NDArray[Any] = self._plan[self.complete]
        return planned

    def missing(self, pass_index: int) -> NDArray[np.int64]:
        """Indices of the shots that a pass lacks, ascending."""
        return np.flatnonzero(self._owner[pass_index] < 0).astype(np.int64)

    def stored(self, pass_index: int) -> NDArray[np.int64]:
        """Indices of the shots that a pass has, ascending."""
        return np.flatnonzero(self._owner[pass_index] >= 0).astype(np.int64)

    def codes(self, pass_index: int, shot: int) -> NDArray[Any]:
        """Codes of a shot that a pass has, shape (ports of the pass, samples).

        Raises:
            RunError: its shard is missing or damaged.
        """
        shard = self.read(int(self._owner[pass_index, shot]))
        codes: NDArray[Any] = shard.frames[shot - shard.first]
        return codes

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
        lines = [f"{number} {entry.sha256}\n" for number, entry in sorted(self.entries.items())]
        return hashlib.sha256("".join(lines).encode()).hexdigest()

    @property
    def rows_per_block(self) -> int:
        """Whole shots in about 1 MB of frames."""
        row = len(self.shape.ports) * self.shape.samples * self.shape.dtype.itemsize
        return max(1, BLOCK_BYTES // row)

    def image(self, number: int) -> bytes:
        """The bytes of one shard.

        Raises:
            RunError: it is missing, or not the one that the journal names.
        """
        path = self.paths.shard(number)
        try:
            with path.open("rb") as file:
                image = file.read(MOST_BYTES + 1)
        except OSError as error:
            raise RunError(f"{path}: cannot be read: {error.strerror}") from error
        if hashlib.sha256(image).hexdigest() != self.entries[number].sha256:
            raise RunError(f"{path}: damaged: its sha256 is not the journal's")
        return image

    def read(self, number: int) -> Shard:
        """Read one shard.

        Raises:
            RunError: it is missing, or not the one that the journal names.
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

    def block(self, indices: NDArray[np.int64]) -> Block:
        """The given complete shots (ascending indices), as the columns of data.h5.

        Returns the arrays `frames` (n, ports, samples), `trigger_offset_s` (n, ports) in s, `clipped` (n, ports),
        `epoch` (n, passes), `measured_at_s` (n, passes) in s and `shots` (n,), a compound table.

        Raises:
            RunError: a shard is missing or damaged.
        """
        count, ports, passes = len(indices), len(self.shape.ports), len(self.shape.passes)
        frames = np.zeros((count, ports, self.shape.samples), self.shape.dtype)
        trigger_offset = np.zeros((count, ports))
        clipped = np.zeros((count, ports), np.bool_)
        epoch = np.zeros((count, passes), "<i4")
        measured_at = np.zeros((count, passes))
        shots = self._plan[indices]
        for pass_index in range(passes):
            columns = self.shape.columns(pass_index)
            owners = self._owner[pass_index, indices]
            for number in np.unique(owners):
                shard = self.read(int(number))
                here = np.flatnonzero(owners == number)
                there = indices[here] - shard.first
                frames[here, columns] = shard.frames[there]
                trigger_offset[here, columns] = shard.trigger_offset_s[there]
                clipped[here, columns] = shard.clipped[there]
                epoch[here, pass_index] = shard.rows["epoch"][there]
                measured_at[here, pass_index] = shard.rows["time_s"][there]
                shots["flags"][here] |= shard.rows["flags"][there]
        shots["epoch"], shots["time_s"] = epoch[:, -1], measured_at[:, -1]
        return {
            "frames": frames,
            "trigger_offset_s": trigger_offset,
            "clipped": clipped,
            "epoch": epoch,
            "measured_at_s": measured_at,
            "shots": shots,
        }
