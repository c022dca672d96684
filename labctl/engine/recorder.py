"""Measuring a run: what a protocol yields is checked and stored, and what a run still lacks is measured anew."""

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from types import TracebackType
from typing import Any, Self

import numpy as np

from instruments.bench import Bench, ending_with
from instruments.errors import InstrumentError
from instruments.values import Codes, Scaling
from labctl.engine.control import Control
from labctl.engine.light_check import REPEATS, refuse_changed_light, to_repeat
from labctl.engine.profile import STORAGE_BESIDE, Stopwatch
from labctl.engine.recovery import Recovery
from labctl.engine.thumbnail import shown_images
from labctl.errors import RunError
from labctl.runs.format.layout import noted_on
from labctl.runs.format.shots import MeasuredBurst
from labctl.runs.live.events import EventLog
from labctl.runs.write.writer import RunWriter
from protocols.base import BurstRecord, Events, Inputs, LegStarted, Measurement, Part, Record, Shot

Progress = Callable[[int, int], None]
"""Called with the number of records that are done and of all. Done is a single shot that the writer has, which puts it
on disk within the durability of the run, and a burst that is on disk."""

_logger = logging.getLogger(__name__)


class Measuring:
    """A run under way: takes what a protocol yields, checks it and stores it.

    Attributes:
        clipped: records that touch the end of the vertical range.
        recovered: how often the run went on after a lost link.
    """

    def __init__(
        self,
        protocol: Measurement[Any],
        inputs: Inputs,
        bench: Bench,
        writer: RunWriter,
        *,
        control: Control,
        progress: Progress,
        events: EventLog,
        stopwatch: Stopwatch,
    ) -> None:
        """Measure what `protocol` asks for on `bench` into `writer`; nothing is sent yet.

        A run that has some shots on disk goes on: its times after the last of them, its epochs too.
        """
        self.clipped = self.recovered = 0
        self._darkened = 0  # how often light was off and on again inside this process
        self._protocol = protocol
        self._inputs = inputs
        self._bench = bench
        self._writer = writer
        self._control = control
        self._progress = progress
        self._events = events
        self._shown = shown_images(inputs)
        self._last: Record | BurstRecord | None = None
        self._stopwatch = stopwatch
        self._whole = protocol.parts(bench, inputs)
        self._total = sum(len(part.shots) for part in self._whole)
        self._begun_with = self._done = sum(writer.done)
        time_s, epoch = writer.latest() or (0.0, -1)
        self._began = bench.now() - time_s
        first = next((part.leg.index for part in self._missing()), 0)
        self._epochs = epoch + 1 - first

    def measure(self, recovery: Recovery) -> None:
        """Store every missing record until there is none, or until stopped.

        A lost link ends the light; once `recovery` has the bench back, the records that are still missing are measured
        in the vertical ranges that their legs have already. A pause is such a loss that somebody asked for. Whenever a
        run goes on, by itself or because it is resumed, a reference image that it has on disk is measured first and
        compared.

        Raises:
            InstrumentError: an instrument failed, gave the same trace twice, or the light is not what it was; a disk
                that refused thereafter is a note to it.
            RunError: the disk is full or refuses.
        """
        with Storage(self._writer, self._stopwatch) as storage:
            while parts := self._missing():
                if self._control.paused:
                    self._wait()
                    if self._control.stopped:
                        return
                try:
                    known = self._known(parts[0])
                    measured = parts if known is None else [known, *parts]
                    events = self._protocol.acquire(self._bench, self._inputs, measured)
                    with ending_with(self._darken), ending_with(events.close):
                        if known is not None:
                            self._compare(events, known)
                        held = self._keep(events, storage)
                    if not held:
                        return
                    storage.sync()
                except InstrumentError as error:
                    try:
                        storage.sync()
                    except RunError as failure:  # nothing more can be kept: no reason to light the bench again
                        error.add_note(str(failure))
                        raise error from None
                    self._report(storage)
                    recovery.after(error, self._done)
                    self.recovered += 1
                self._darkened += 1
                if self._control.stopped:
                    return

    def _darken(self) -> None:
        """A protocol that keeps hold of another one's generator may have left it, and the light, as they were."""
        if self._bench.lit:
            self._bench.make_safe()

    def _missing(self) -> list[Part]:
        """What the run still lacks on disk, with the ranges of the legs that have some."""
        parts = []
        for part in self._whole:
            index = part.leg.index
            missing = self._writer.missing(index)
            if missing.size:
                parts.append(Part(part.leg, [part.shots[shot] for shot in missing], self._ranges(index)))
        return parts

    def _ranges(self, leg: int) -> tuple[Scaling, ...] | None:
        locked = self._writer.locked_scales(leg)
        return None if locked is None else tuple(map(Scaling, *(values.tolist() for values in locked)))

    def _known(self, missing: Part) -> Part | None:
        """A picture on disk to begin with, of the leg that is cut short or else the one before; None without any."""
        for part in reversed(self._whole[: missing.leg.index + 1]):
            stored = [part.shots[shot] for shot in self._writer.stored(part.leg.index)]
            if (shot := to_repeat(stored)) is not None:
                return Part(part.leg, [shot] * REPEATS, self._ranges(part.leg.index))
        return None

    def _compare(self, events: Events, known: Part) -> None:
        found = islice(events, 1 + REPEATS)
        again = np.stack([_measured(event, 0.0, 0).codes[0] for event in found if not isinstance(event, LegStarted)])
        leg, shot = known.leg.index, known.shots[0]
        stored = [self._whole[leg].shots[index] for index in self._writer.stored(leg)]
        first = next(one for one in stored if one.group == shot.group)
        earlier, latest = (self._writer.codes(leg, one.index) for one in (first, shot))
        refuse_changed_light(shot, earlier, latest, again)

    def _keep(self, events: Events, storage: "Storage") -> bool:
        """Store what comes; True if that ended because it is to."""
        previous: Codes | None = None
        scalings: tuple[Scaling, ...] = ()
        held = False
        for event in events:
            if isinstance(event, LegStarted):
                self._start(event)
                storage.wait()
                previous, scalings = None, event.scalings
            else:
                previous = self._take(event, scalings, previous, storage)
                self._last = event
            self._report(storage)
            if held := self._control.holds:
                break
        storage.wait()
        self._report(storage)
        return held

    def _take(
        self, event: Record | BurstRecord, scalings: tuple[Scaling, ...], previous: Codes | None, storage: "Storage"
    ) -> Codes:
        """Check and store a record; returns its last shot, for the next one to differ from."""
        self._bench.laser.require_emission()  # what was measured in the dark is not kept
        # Light that was off and on again is another epoch, as is another leg.
        epoch = self._epochs + event.leg.index + self._darkened
        burst = _measured(event, self._bench.now() - self._began, epoch)
        _refuse_stale(previous, burst)
        self._bench.limits.check_traces(tuple(event.leg.patching), burst.codes, scalings)
        storage.keep(event, burst)
        self._count_clipped(burst)
        last: Codes = burst.codes[-1]
        return last

    def _report(self, storage: "Storage") -> None:
        done = self._begun_with + storage.kept
        if done > self._done:
            self._done = done
            self._progress(done, self._total)
            self._events.progress(done, self._total, self._last_shot)

    def _count_clipped(self, burst: MeasuredBurst) -> None:
        clipped = int(np.count_nonzero(burst.clipped.any(axis=1)))
        if clipped and not self.clipped:
            self._events("warning", text="records touch the end of the vertical range: their peaks are cut off")
        self.clipped += clipped

    def _wait(self) -> None:
        self._events("paused", done=self._done, total=self._total)
        self._events.interrupted()
        _logger.warning("paused in the dark after %s of %s records: waiting to go on", self._done, self._total)
        self._control.wait()
        if not self._control.stopped:
            self._events("going on")
            _logger.warning("going on")

    def _last_shot(self) -> dict[str, Any]:
        """What is told of the shot that was measured last, with the image that the DMD shows."""
        event = self._last
        if event is None:
            return {}
        last = event.shot if isinstance(event, Record) else self._last_of(event)
        return {
            "leg": event.leg.index,
            "shot": last.index,
            "kind": str(last.kind),
            "dataset_index": last.dataset_index,
            "label": last.label,
        } | self._shown(last)

    def _last_of(self, event: BurstRecord) -> Shot:
        return self._whole[event.leg.index].shots[event.first + len(event.burst.codes) - 1]

    def _start(self, event: LegStarted) -> None:
        """A leg has its ranges for good from its first part on."""
        index, scalings = event.leg.index, event.scalings
        self._events(
            "leg started",
            leg=index,
            legs=len(self._whole),
            wavelength_nm=event.leg.wavelength_nm,
            ports=list(event.leg.patching.values()),
        )
        if self._writer.locked_scales(index) is None:
            self._writer.scales(index, [one.scale_v for one in scalings], [one.offset_v for one in scalings])
        else:
            self._bench.dmd.blank()  # the picture that was probed may be the one to be measured: it is to be shown anew


class Storage:
    """Stores records; a burst in a thread of its own, while the bench measures the next one.

    Attributes:
        kept: how many records are done, see `Progress`.
    """

    def __init__(self, writer: RunWriter, stopwatch: Stopwatch) -> None:
        """Store into `writer`."""
        self.kept = 0
        self._writer = writer
        self._stopwatch = stopwatch
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="storage")
        self._stored: Future[int] | None = None

    def keep(self, event: Record | BurstRecord, burst: MeasuredBurst) -> None:
        """Store a single shot now, or wait until the last burst is stored and begin with this one."""
        if isinstance(event, Record):
            with self._stopwatch.step("storage"):
                self._writer.append(event.leg.index, burst.shot(0))
            self.kept += 1
            return
        self.wait()
        self._stored = self._thread.submit(self._store, event.leg.index, burst)

    def sync(self) -> None:
        """Return when everything that was kept so far is on disk."""
        self.wait()
        self._writer.sync()

    def wait(self) -> None:
        """Return when the burst that is being stored, if there is one, is on disk."""
        stored, self._stored = self._stored, None
        if stored is not None:
            self.kept += stored.result()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            with noted_on(error):
                self.wait()
        finally:
            self._thread.shutdown()

    def _store(self, leg: int, burst: MeasuredBurst) -> int:
        with self._stopwatch.beside(STORAGE_BESIDE):
            self._writer.append_burst(leg, burst)
        return len(burst.codes)


def _refuse_stale(previous: Codes | None, burst: MeasuredBurst) -> None:
    """Noise makes two traces differ: equal ones mean that the oscilloscope gave the same acquisition again."""
    first = 0 if previous is None else int(np.array_equal(previous, burst.codes[0]))
    repeated = np.flatnonzero((burst.codes[1:] == burst.codes[:-1]).all(axis=(1, 2)))
    if first or repeated.size:
        shot = burst.first + (0 if first else int(repeated[0]) + 1)
        raise InstrumentError(
            f"scope: shot {shot} and the one before gave byte-identical traces: it did not acquire anew; "
            f"check its trigger"
        )


def _measured(event: Record | BurstRecord, time_s: float, epoch: int) -> MeasuredBurst:
    """What is stored of an event; `time_s` is the time of the last shot in it."""
    if isinstance(event, Record):
        frames = event.frames
        return MeasuredBurst(
            event.shot.index,
            frames.codes[np.newaxis],
            frames.trigger_offset_s[np.newaxis],
            np.array([time_s]),
            frames.clipped[np.newaxis],
            epoch,
        )
    burst = event.burst
    times = time_s + burst.time_s - burst.time_s[-1]
    return MeasuredBurst(event.first, burst.codes, burst.trigger_offset_s, times, burst.clipped, epoch)
