"""Writing a run: shots in, shards and journal out, data.h5 at the end."""

import math
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from instruments.values import Drive, Frames
from labctl.errors import RunError, noted_on
from labctl.runs.format.durable import replace_file
from labctl.runs.format.journal import NOT_COMPARED, JournalFile, read_journal
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest
from labctl.runs.format.plan import read_plan
from labctl.runs.format.shape import RunShape
from labctl.runs.format.shards import Shards
from labctl.runs.read.data_file import evidence_in
from labctl.runs.write.data_file import write_data_file
from labctl.runs.write.durability import Durability
from labctl.runs.write.preparation import prepare
from labctl.runs.write.recovery import recover
from labctl.runs.write.room import Room, require, shots_a_shard
from labctl.runs.write.stored_shards import StoredShards

Warn = Callable[[str], object]
"""Called with a line that somebody should read while the run goes on."""


class Timer(Protocol):
    """What `RunWriter` needs of `threading.Timer`."""

    def start(self) -> None:
        """Begin to count."""

    def cancel(self) -> None:
        """Never call back, unless that has begun."""


TimerFactory = Callable[[float, Callable[[], None]], Timer]


def _certain() -> bool:
    """Nothing else can change the settings."""
    return True


def _nobody(_line: str) -> None:
    """Warnings go to standard error alone."""


def wall_timer(seconds: float, call: Callable[[], None]) -> Timer:
    """A timer by the wall that does not keep the process alive."""
    timer = threading.Timer(seconds, call)
    timer.daemon = True
    return timer


class RunWriter:
    """Writes one run; the only thing that changes a run directory while the run lasts.

    Shots of one pass go into an open shard in memory. It is closed, that is written, fsynced, renamed and entered in
    the journal, when `Durability` requires it, when the pass changes, and when the next planned shot of the pass is on
    disk already. The age limit is kept by a timer: it holds while the bench waits for an instrument or a person, and
    a shot that came alone is written while the next one is measured.

    As a context manager: at the end of the block the open shard is closed and data.h5 is made, however the block ends.
    """

    def __init__(
        self,
        manifest: Manifest,
        shards: Shards,
        drive: Drive | None,
        durability: Durability,
        stored: StoredShards,
        *,
        recovered: tuple[str, ...] = (),
        timer: TimerFactory,
        clock: Callable[[], float],
    ) -> None:
        """Not for callers: `create` and `resume` open a run."""
        self.recovered = recovered
        self._manifest = manifest
        self._shape = manifest.shape
        self._dtype = self._shape.dtype
        self._shards = shards
        self._drive = drive
        self._durability = durability
        self._stored = stored
        self._new_timer = timer
        self._timer: Timer | None = None
        self._clock = clock
        self._came = math.inf
        self._guard = threading.RLock()
        self._open: list[Frames] = []
        self._open_epochs: list[int] = []
        self._open_pass = self._open_first = 0
        self._taken = shards.taken
        self._failure: RunError | None = None
        self._closed = False
        self._scales = {
            index: found for index in range(len(self._shape.passes)) if (found := shards.scales(index)) is not None
        }

    @classmethod
    def create(
        cls,
        directory: Path,
        manifest: Mapping[str, Any],
        shape: RunShape,
        plan: NDArray[Any],
        drive: Drive | None = None,
        durability: Durability | None = None,
        *,
        in_a_shard: float | None = None,
        on_warning: Warn = _nobody,
        timer: TimerFactory = wall_timer,
        clock: Callable[[], float] = time.monotonic,
    ) -> Self:
        """Begin a run in `directory`, which must be new, empty, or left by a process that was killed as it began one.

        Args:
            directory: Where the run goes.
            manifest: Anything JSON can hold. The catalogue shows its keys `protocol` (a name, or a map with `name`),
                `started` (ISO 8601, UTC), `seed` and `twin_seed` (or a map `seeds` of both). Added are
                `format_version`, `shape`, `durability` and `plan_sha256`.
            shape: The size of the run.
            plan: The planned `/shots`, see `labctl.runs.format.columns.shot_table`.
            drive: What the AWG plays, None for nothing.
            durability: When a shard closes.
            in_a_shard: How many shots a shard is expected to have; without it, as many as `durability` allows.
            on_warning: Called, from any thread, with one line when the disk is filling up.
            timer: What closes a shard that gets too old.
            clock: When a shot came, s.

        Raises:
            RunExists: the directory holds something else.
            RunInUse: another process is beginning a run there.
            RunError: it cannot be written, or the disk has too little room for all of it; nothing was made then.
            ValueError, TypeError: `plan` has another number of shots than `shape`, or `manifest` is not JSON.
        """
        durability = durability or Durability()
        paths = RunPaths(directory)
        expected = in_a_shard or shots_a_shard(shape, durability)
        checked, journal = prepare(paths, manifest, shape, plan, drive, durability, expected)
        room = Room(directory, shape, drive, expected, on_warning)
        shards = Shards(paths, shape, plan, ())
        return cls(checked, shards, drive, durability, StoredShards(shards, journal, room), timer=timer, clock=clock)

    @classmethod
    def resume(
        cls,
        directory: Path,
        durability: Durability | None = None,
        *,
        on_warning: Warn = _nobody,
        timer: TimerFactory = wall_timer,
        clock: Callable[[], float] = time.monotonic,
    ) -> Self:
        """Go on with an interrupted run: `missing` lists what is still to be measured.

        What a crash left behind is put in order first, and `recovered` describes what was found: a shard that did
        not reach the journal is set aside, as is one that is damaged and not in data.h5, and its shots are missing
        again. `on_warning` is called with each of these lines too; `timer` and `clock` are as of `create`.

        Raises:
            RunError: no run, a run that another process is writing, a damaged manifest or plan, a shard that cannot be
                read, or too little room on the disk for what is still to come.
        """
        paths = RunPaths(directory)
        manifest = Manifest.read(paths)
        shape = manifest.shape
        plan, drive = read_plan(paths, manifest.values["plan_sha256"])
        try:
            durability = durability or Durability.from_json(manifest.values["durability"])
        except (KeyError, TypeError, ValueError) as error:
            text = f"{paths.manifest}: damaged manifest ({error!r}); restore it from a copy of the run"
            raise RunError(text) from error
        journal = JournalFile(paths.journal)
        try:
            shards = Shards(paths, shape, plan, read_journal(paths.journal).entries)
            recovered, next_shard = recover(shards, journal)
            for line in recovered:
                on_warning(line)
            room = Room(directory, shape, drive, shots_a_shard(shape, durability), on_warning)
            writer = cls(
                manifest,
                shards,
                drive,
                durability,
                StoredShards(shards, journal, room, next_shard),
                recovered=recovered,
                timer=timer,
                clock=clock,
            )
            require(directory, room.to_come(shards, data_file=not writer._has_data_file()))
            return writer
        except BaseException:
            journal.close()
            raise

    @property
    def paths(self) -> RunPaths:
        """Where things lie."""
        return self._shards.paths

    @property
    def manifest(self) -> Mapping[str, Any]:
        """What manifest.json holds."""
        return self._manifest.values

    @property
    def done(self) -> tuple[int, ...]:
        """How many shots of each pass are on disk."""
        with self._guard:
            return self._shards.done

    @property
    def complete(self) -> int:
        """How many shots are on disk for all passes."""
        with self._guard:
            return self._shards.completed

    def missing(self, pass_index: int) -> NDArray[np.int64]:
        """Indices of the shots that a pass still lacks on disk, ascending: what a resumed run measures."""
        with self._guard:
            return self._shards.missing(pass_index)

    def stored(self, pass_index: int) -> NDArray[np.int64]:
        """Indices of the shots that a pass has on disk, ascending."""
        with self._guard:
            return self._shards.stored(pass_index)

    def codes(self, pass_index: int, shot: int) -> NDArray[Any]:
        """Codes of a shot that is on disk, shape (ports of the pass, samples).

        Raises:
            RunError: its shard is missing or damaged.
        """
        return self._shards.codes(pass_index, shot)

    def latest(self) -> tuple[float, int] | None:
        """Time (s since the run began) and epoch of the shot that was stored last; None before the first.

        Raises:
            RunError: its shard is missing or damaged.
        """
        with self._guard:
            return self._shards.latest()

    def locked_scales(self, pass_index: int) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Scale (V per code) and offset (V) per port that this run uses on a pass; None before the first shard."""
        return self._scales.get(pass_index)

    def scales(self, pass_index: int, scale: ArrayLike, offset: ArrayLike) -> None:
        """Set volts = scale * code + offset of a pass, per port or one for all. It holds for the whole run.

        Raises:
            RunError: the run was begun with other values: codes of the two ranges would be mixed.
        """
        ports = len(self._shape.passes[pass_index])
        found = tuple(np.broadcast_to(np.asarray(values, np.float64), ports).copy() for values in (scale, offset))
        with self._guard:
            locked = self._scales.setdefault(pass_index, (found[0], found[1]))
        if not (np.array_equal(locked[0], found[0]) and np.array_equal(locked[1], found[1])):
            raise RunError(
                f"{self.paths.directory}: vertical range of pass {pass_index} is locked at {locked[0].tolist()} V per "
                f"code, offset {locked[1].tolist()} V, and cannot become {found[0].tolist()}, {found[1].tolist()}: "
                "set the oscilloscope to the locked range"
            )

    def append(
        self, pass_index: int, first: int, frames: Frames, epoch: int = 0, *, sure: Callable[[], bool] = _certain
    ) -> None:
        """Take the shots of a pass from `first` on, `time_s` since the run began; the arrays are not copied.

        A single shot is on disk after at most the configured shots or seconds, and at once where the one before came
        as many seconds ago: in a run that slow each has a shard of its own anyway, and somebody may look at it. Several
        that come together are on disk when this returns. Before a shard is closed here, `sure` is asked whether the
        settings are still those that all its shots are to be measured with. Where it is not, or where a shard was
        closed by the timer, the shots are entered as suspect until somebody is sure. What `sure` raises is passed on,
        and nothing is closed.

        Raises:
            RunError: the disk is full or refuses; from then on the writer takes nothing more.
            ValueError: arrays of another shape or type than the run's, no scales yet, or shots that are there already.
        """
        count = len(frames.codes)
        self._require_fit(pass_index, first, count, frames)
        last, together = first + count, count > 1
        with self._guard:
            self._raise_failure()
            came, self._came = self._came, self._clock()
            alone = self._came - came >= self._durability.seconds
            follows = (pass_index, first) == (self._open_pass, self._open_first + len(self._open))
            full = bool(self._open) and (len(self._open) + 1) * frames.codes.nbytes > self._durability.shard_bytes
            if (together or not follows or full) and self._open:
                self._close_shard(sure())
            taken = self._taken[pass_index]
            if taken[first:last].any():
                raise ValueError(f"shots {first}..{last - 1} of pass {pass_index} are in the run already")
            taken[first:last] = True
            if not self._open:
                self._open_pass, self._open_first = pass_index, first
            self._open.append(frames)
            self._open_epochs.append(epoch)
            if together or len(self._open) >= self._durability.shots or taken[last : last + 1].all():
                self._close_shard(sure())  # what comes next is there already, or the plan ends here
                return
            if self._stored.unsure and sure():
                self._stored.trust()
            if self._timer is None:
                self._timer = self._new_timer(0.0 if alone else self._durability.seconds, self._close_aged)
                self._timer.start()

    def sync(self) -> None:
        """Close the open shard: every shot appended so far is then on disk, and the caller is sure of all of them.

        Raises:
            RunError: the disk is full or refuses.
        """
        with self._guard:
            self._raise_failure()
            self._close_shard(sure=True)

    def sync_unsure(self) -> None:
        """Close the open shard; what nobody was sure of yet is suspect until somebody is.

        Raises:
            RunError: the disk is full or refuses.
        """
        with self._guard:
            self._raise_failure()
            self._close_shard(sure=False)

    def doubt(self, reason: str, pass_index: int, first: int) -> None:
        """Close the open shard; whatever the pass has from shot `first` on is suspect.

        Raises:
            RunError: the disk is full or refuses.
        """
        with self._guard:
            self._raise_failure()
            self._close_shard(sure=False, reason=reason)
            self._stored.doubt(reason, pass_index, first)

    def discard_suspect(self) -> tuple[str, ...]:
        """Set aside what is suspect: it is missing from then on, so that it is measured again; a line for each shard.

        Raises:
            RunError: the disk is full or refuses.
        """
        with self._guard:
            self._raise_failure()
            lines = self._stored.discard_suspect()
            self._taken = self._shards.taken
            return lines

    def finish(self, *, compression: str | None = None) -> bool:
        """Close the last shard, make data.h5 of the complete shots, let go of the run; True if no shot is missing.

        Raises:
            RunError: the disk is full or refuses, or a shard turned out damaged. The shards stay valid.
        """
        with self._guard:
            if self._closed:
                return self.complete == self._shape.shots
            try:
                self.sync()
                self._stored.require_untouched()
                self._note_suspect()
                if not self._has_data_file():
                    write_data_file(self._shards, self._manifest, self._drive, compression=compression)
            finally:
                self.abandon()
            return self.complete == self._shape.shots

    def abandon(self) -> None:
        """Let go of the run at once: the open shard is lost, data.h5 is not made. For tests and hopeless disks."""
        with self._guard:
            self._stop_timer()
            self._open.clear()
            self._closed = True
            self._stored.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with noted_on(error):
            if error is not None and not self._closed:
                with self._guard:
                    self._close_shard(sure=False)
                    self._stored.unsure.clear()
            self.finish()

    def _note_suspect(self) -> None:
        """Let the manifest say what is in doubt, so that it is known of a run whose journal nobody reads."""
        noted = self._manifest.with_suspect(self._shards.suspect)
        if noted != self._manifest:
            replace_file(self.paths.manifest, noted.encode())
            self._manifest = noted

    def _has_data_file(self) -> bool:
        """Whether data.h5 was made from just these shards: a run that is resumed may be complete already."""
        try:
            return self.paths.data.exists() and evidence_in(self.paths.data) == self._shards.evidence
        except RunError:
            return False

    def _require_fit(self, pass_index: int, first: int, count: int, frames: Frames) -> None:
        """Compare frames of `count` shots from `first` on with the run that they are to be part of.

        Raises:
            ValueError: see `append`.
        """
        size = count, len(self._shape.passes[pass_index])
        if frames.codes.shape != (*size, self._shape.samples) or frames.codes.dtype != self._dtype:
            found = f"{frames.codes.dtype} {frames.codes.shape}"
            raise ValueError(f"frames of {found} are not those of a run of {self._shape}")
        if frames.trigger_offset_s.shape != size or frames.clipped.shape != size:
            raise ValueError(f"trigger_offset_s and clipped must have shape {size}")
        if not 0 <= first < first + count <= self._shape.shots:
            raise ValueError(f"shots {first}..{first + count - 1} are not among 0..{self._shape.shots - 1}")
        if pass_index not in self._scales:
            raise ValueError(f"scales of pass {pass_index} are not set")

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._failure
        if self._closed:
            raise RunError(f"{self.paths.directory}: this run is closed; `labctl resume` opens it again")

    def _close_aged(self) -> None:
        with self._guard:
            self._timer = None
            if not self._closed and self._failure is None:
                try:
                    self._close_shard(sure=False)
                except RunError as error:
                    self._failure = error  # this thread has no caller: the next call on the writer raises it

    def _close_shard(self, sure: bool, reason: str = NOT_COMPARED) -> None:
        """Write what is open, suspect for a `reason` unless somebody is sure, also of what was not sure before."""
        self._stop_timer()
        if sure:
            self._stored.trust()
        if self._open:
            index, suspect = self._open_pass, "" if sure else reason
            epochs = np.repeat(self._open_epochs, [len(frames.codes) for frames in self._open])
            most = max(1, self._durability.shard_bytes // self._open[0].codes[0].nbytes)
            try:
                for start in range(0, epochs.size, most):  # more than one round for a large burst alone
                    parts = self._open if epochs.size <= most else [self._open[0].part(start, start + most)]
                    some = epochs[start : start + most]
                    self._stored.store(index, self._open_first + start, parts, some, self._scales[index], suspect)
            except RunError as error:
                self._failure = error
                raise
            finally:
                self._open.clear()
                self._open_epochs.clear()

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
