"""A run while it grows: what was added to its journal since the last look, and what was measured last."""

import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.runs.format.journal import Entry
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest
from labctl.runs.format.own_files import own_file
from labctl.runs.format.plan import read_plan
from labctl.runs.format.shards import Shards
from labctl.runs.live.glimpse import Glimpse, read_glimpse
from labctl.runs.read.run import Run, run_of_shards, volts

READ_AT_ONCE = 1 << 22


@dataclass(frozen=True)
class Latest:
    """A shot as a pass measured it: its place in the plan, its kind, V of each port of shape (ports, samples).

    sample_interval_s: s from one sample to the next. ends: (ports, 2) lowest and highest V that the oscilloscope can
    tell in the pass, the same throughout.
    """

    shot: int
    kind: str
    ports: tuple[int, ...]
    wavelength_nm: float
    sample_interval_s: float
    volts: NDArray[np.float64]
    ends: NDArray[np.float64]


@dataclass(frozen=True)
class Stretch:
    """Shots of one pass that follow one another: what one shard holds.

    shots, kinds, time_s: (shots,) of each its place in the plan, its kind, and when it was measured, s since the run
    began. codes: (shots, ports, samples). scale, offset: (ports,) volts = scale * code + offset.
    """

    pass_index: int
    ports: tuple[int, ...]
    shots: NDArray[np.int64]
    kinds: NDArray[np.bytes_]
    time_s: NDArray[np.float64]
    codes: NDArray[np.signedinteger[Any]]
    scale: NDArray[np.float64]
    offset: NDArray[np.float64]


class Follower:
    """Follows the run in a directory; never changes it, and reads the journal only as far as it grew."""

    def __init__(self, directory: Path) -> None:
        """Open the run.

        Raises:
            RunError: no run, or one whose manifest or plan is damaged.
        """
        self.paths = RunPaths(directory)
        self.manifest = Manifest.read(self.paths)
        self.shape = self.manifest.shape
        plan_sha256 = self.manifest.values.get("plan_sha256")
        self._plan, _ = read_plan(self.paths, str(plan_sha256))
        self._entries: list[Entry] = []
        self._shards = self._all()
        self._offset = 0
        self._newest: dict[int, int] = {}
        self._read: tuple[tuple[int, int], list[Latest]] | None = None
        self._glimpse: Stretch | None = None

    @property
    def done(self) -> tuple[int, ...]:
        """How many shots each pass has."""
        return self._shards.done

    @property
    def entries(self) -> int:
        """Lines of the journal so far: while this stays the same, nothing was added."""
        return len(self._entries)

    @property
    def classes(self) -> NDArray[np.int64]:
        """The classes of the images that are planned, ascending."""
        return np.unique(self._plan["label"][self._plan["kind"] == b"image"]).astype(np.int64)

    def look(self) -> bool:
        """Read what was added to the journal; True if anything was.

        Raises:
            RunError: the journal is of another run.
        """
        try:
            with own_file(self.paths.journal) as file:
                if file.seek(0, os.SEEK_END) < self._offset:  # set aside and begun anew
                    self._offset, self._entries, self._newest, self._shards = 0, [], {}, self._all()
                file.seek(self._offset)
                whole = file.read(READ_AT_ONCE).rpartition(b"\n")[0]
        except OSError:
            return False
        if not whole:
            return False
        self._offset += len(whole) + 1
        for line in whole.split(b"\n"):
            try:
                entry = Entry.decode(line)
            except ValueError:
                continue  # `labctl verify` reports it
            self._shards.add(entry)
            self._entries.append(entry)
            self._newest[entry.pass_index] = max(entry.shard, self._newest.get(entry.pass_index, -1))
        return True

    def has(self, pass_index: int, shot: int) -> bool:
        """Whether a pass has a shot on disk."""
        planned = 0 <= pass_index < len(self.shape.passes) and 0 <= shot < self.shape.shots
        return planned and self._shards.has(pass_index, shot)

    def stretches(self) -> list[int]:
        """Numbers of the stretches of the pass that was measured last, in the order in which they came to the disk."""
        entries = self._shards.entries
        return [number for number in sorted(entries) if entries[number].pass_index == entries[max(entries)].pass_index]

    def stretch(self, number: int) -> Stretch:
        """One of these.

        Raises:
            RunError: its shard is missing or damaged.
        """
        shard = self._shards.read(number)
        return Stretch(
            shard.pass_index,
            self.shape.passes[shard.pass_index],
            shard.rows["shot"],
            self._plan["kind"][shard.rows["shot"]],
            shard.rows["time_s"],
            shard.frames,
            shard.scale,
            shard.offset,
        )

    def glimpse(self) -> Stretch | None:
        """The last shots as the run itself shows them, which may not be on disk; the same until there are others.

        None where it shows none now. What is there when it is asked for first may have been left by a process that was
        killed: it counts when something else follows.
        """
        left, found = self._left, read_glimpse(self.paths.directory)
        if found is None or found.time_s[-1] == left or not self._fits(found):
            self._glimpse = None
        elif self._glimpse is None or found.time_s[-1] != self._glimpse.time_s[-1]:
            kinds = self._plan["kind"][found.shots]
            ports = self.shape.passes[found.pass_index]
            self._glimpse = Stretch(
                found.pass_index, ports, found.shots, kinds, found.time_s, found.codes, found.scale_v, found.offset_v
            )
        return self._glimpse

    @cached_property
    def _left(self) -> float | None:
        """When the last of the shots that were shown first was measured."""
        found = read_glimpse(self.paths.directory)
        return None if found is None else float(found.time_s[-1])

    def _fits(self, glimpse: Glimpse) -> bool:
        """Whether these are shots of this run."""
        planned = glimpse.shots.min() >= 0 and glimpse.shots.max() < self.shape.shots
        passes = self.shape.passes
        return (
            planned
            and 0 <= glimpse.pass_index < len(passes)
            and len(glimpse.scale_v) == len(passes[glimpse.pass_index])
        )

    def latest(self) -> list[Latest]:
        """The last shot with light that is on disk, as each pass measured it that has it; none before the first shard.

        Where the last shard has dark frames only, it is the last of them.

        Raises:
            RunError: a shard is missing or damaged.
        """
        newest = max(self._newest.values(), default=None)
        if newest is None or newest not in self._shards.entries:  # none yet, or taken back as damaged
            return []
        entry = self._shards.entries[newest]
        lit = np.flatnonzero(self._plan["kind"][entry.first : entry.first + entry.count] != b"dark")
        return self.shot(entry.first + int(lit[-1] if lit.size else entry.count - 1))

    def shot(self, shot: int) -> list[Latest]:
        """One shot, as each pass measured it that has it on disk.

        Raises:
            RunError: a shard is missing or damaged.
        """
        if self._read is None or self._read[0] != (shot, self.entries):
            found = [self._of_pass(index, shot) for index in range(len(self.shape.passes)) if self.has(index, shot)]
            self._read = (shot, self.entries), found
        return self._read[1]

    @property
    def pictures(self) -> dict[int, tuple[int, int]]:
        """The images that were measured on all ports: place in the data set -> class, and the first shot of it."""
        sound = self._shards.sound
        planned = self._plan[sound]
        images = np.flatnonzero((planned["kind"] == b"image") & (planned["dataset_index"] >= 0))
        places, first = np.unique(planned["dataset_index"][images], return_index=True)
        labels, shots = planned["label"][images][first], sound[images][first]
        return {int(a): (int(b), int(c)) for a, b, c in zip(places, labels, shots, strict=True)}

    def measured(self, least: int, most: int, since: int = 0) -> Run | None:
        """The shots that all of the first passes have, of as many passes as have at least `least` shots each.

        Only about `most` shots of the plan from the one at `since` on are looked at, and some before it: a reader's
        memory is not that of the run. None where not even the first pass has so many. A run that is in its last pass is
        thus seen with its first ports until the shots on all ports are worth a look.
        """
        count = sum(done >= least for done in self._shards.done)
        passes = next((n for n in range(count, 0, -1) if min(self._shards.done[:n]) >= least), 0)
        if not passes:
            return None
        shape = replace(
            self.shape, passes=self.shape.passes[:passes], wavelengths_nm=self.shape.wavelengths_nm[:passes]
        )
        entries = [
            replace(entry, passes=passes)
            for entry in self._entries
            if entry.pass_index < passes and since < entry.first + entry.count and entry.first < since + most
        ]
        shards = Shards(self.paths, shape, self._plan, entries)
        return run_of_shards(self.paths.directory, Manifest({**self.manifest.values, "shape": shape.to_json()}), shards)

    def _all(self) -> Shards:
        return Shards(self.paths, self.shape, self._plan, [])

    def _of_pass(self, pass_index: int, shot: int) -> Latest:
        shard = self._shards.holding(pass_index, shot)
        lowest, highest = np.iinfo(shard.frames.dtype).min, np.iinfo(shard.frames.dtype).max
        return Latest(
            shot,
            self._plan["kind"][shot].decode(errors="replace"),
            self.shape.passes[pass_index],
            self.shape.wavelengths_nm[pass_index] if self.shape.wavelengths_nm else 0.0,
            self.shape.sample_interval_s,
            volts(shard.frames[shot - shard.first], shard.scale, shard.offset, np.float64),
            np.stack([shard.scale * code + shard.offset for code in (lowest, highest)], axis=1),
        )
