"""A run while it grows: what was added to its journal since the last look, and what was measured last."""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labctl.runs.format.journal import Entry
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest
from labctl.runs.format.own_files import own_file
from labctl.runs.format.plan import read_plan
from labctl.runs.format.shard import Shard
from labctl.runs.format.shards import Shards
from labctl.runs.read.run import Run, run_of_shards, volts

READ_AT_ONCE = 1 << 22


@dataclass(frozen=True)
class Latest:
    """The last shot of a pass with light: its place in the plan, its kind, V of each port of shape (ports, samples)."""

    shot: int
    kind: str
    ports: tuple[int, ...]
    wavelength_nm: float
    volts: NDArray[np.float64]


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
        self._latest: dict[int, tuple[int, Latest]] = {}

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
                if os.fstat(file.fileno()).st_size < self._offset:  # set aside and begun anew
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

    def latest(self) -> list[Latest]:
        """The last shot with light that each pass has on disk; passes without one are left out.

        Where the last shard of a pass has dark frames only, it is the last of them.

        Raises:
            RunError: a shard is missing or damaged.
        """
        return [found for index in range(len(self.shape.passes)) if (found := self._latest_of(index)) is not None]

    @property
    def pictures(self) -> dict[int, tuple[int, int]]:
        """The images that were measured on all ports: place in the data set -> class, and the first shot of it."""
        sound = self._shards.sound
        planned = self._plan[sound]
        images = np.flatnonzero((planned["kind"] == b"image") & (planned["dataset_index"] >= 0))
        places, first = np.unique(planned["dataset_index"][images], return_index=True)
        labels, shots = planned["label"][images][first], sound[images][first]
        return {int(a): (int(b), int(c)) for a, b, c in zip(places, labels, shots, strict=True)}

    def shot(self, shot: int) -> list[Latest]:
        """A shot that all passes have, as each pass saw it.

        Raises:
            RunError: a shard is missing or damaged.
        """
        found = {}
        for entry in self._shards.entries.values():
            if entry.first <= shot < entry.first + entry.count:
                shard = self._shards.read(entry.shard)
                found[entry.pass_index] = self._seen(shard, shot - shard.first)
        return [found[index] for index in sorted(found)]

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

    def _latest_of(self, pass_index: int) -> Latest | None:
        number = self._newest.get(pass_index)
        if number is None or number not in self._shards.entries:  # none yet, or taken back as damaged
            return None
        known = self._latest.get(pass_index)
        if known is None or known[0] != number:
            shard = self._shards.read(number)
            kinds = self._plan["kind"][shard.rows["shot"]]
            row = int(np.flatnonzero(kinds != b"dark")[-1]) if (kinds != b"dark").any() else -1
            self._latest[pass_index] = number, self._seen(shard, row)
        return self._latest[pass_index][1]

    def _seen(self, shard: Shard, row: int) -> Latest:
        """A row of a shard."""
        shot, index = int(shard.rows[row]["shot"]), shard.pass_index
        return Latest(
            shot,
            self._plan["kind"][shot].decode(errors="replace"),
            self.shape.passes[index],
            self.shape.wavelengths_nm[index] if self.shape.wavelengths_nm else 0.0,
            volts(shard.frames[row], shard.scale, shard.offset, np.float64),
        )
