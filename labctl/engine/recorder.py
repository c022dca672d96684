"""Measuring a run: what a protocol yields is checked and stored, and what a run still lacks is measured anew."""

import logging
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from instruments.bench import Bench, ending_with
from instruments.errors import InstrumentError
from instruments.values import Codes, Frames, Scaling
from labctl.engine.control import Control
from labctl.engine.light_check import REPEATS, refuse_changed_light, to_repeat
from labctl.engine.profile import Stopwatch
from labctl.engine.recovery import Recovery
from labctl.engine.storage import Storage
from labctl.engine.thumbnail import shown_images
from labctl.errors import RunError
from labctl.runs.live.events import EventLog
from labctl.runs.write.writer import RunWriter
from protocols.base import Events, Inputs, Measurement, Part, PassStarted, Record

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
        self._last: Record | None = None
        self._stopwatch = stopwatch
        self._whole = protocol.parts(bench, inputs)
        self._total = sum(len(part.shots) for part in self._whole)
        self._begun_with = self._done = sum(writer.done)
        time_s, epoch = writer.latest() or (0.0, -1)
        self._began = bench.now() - time_s
        first = next((part.pass_.index for part in self._missing()), 0)
        self._epochs = epoch + 1 - first

    def measure(self, recovery: Recovery) -> None:
        """Store every missing record until there is none, or until stopped.

        A lost link ends the light; once `recovery` has the bench back, the records that are still missing are measured
        in the vertical ranges that their passes have already. A pause is such a loss that somebody asked for. When a
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
        """What the run still lacks on disk, with the ranges of the passes that have some."""
        parts = []
        for part in self._whole:
            index = part.pass_.index
            missing = self._writer.missing(index)
            if missing.size:
                parts.append(Part(part.pass_, [part.shots[shot] for shot in missing], self._ranges(index)))
        return parts

    def _ranges(self, pass_: int) -> tuple[Scaling, ...] | None:
        locked = self._writer.locked_scales(pass_)
        return None if locked is None else tuple(map(Scaling, *(values.tolist() for values in locked)))

    def _known(self, missing: Part) -> Part | None:
        """A picture on disk to begin with, of the pass that is cut short or else the one before; None without any."""
        for part in reversed(self._whole[: missing.pass_.index + 1]):
            stored = [part.shots[shot] for shot in self._writer.stored(part.pass_.index)]
            if (shot := to_repeat(stored)) is not None:
                return Part(part.pass_, [shot] * REPEATS, self._ranges(part.pass_.index))
        return None

    def _compare(self, events: Events, known: Part) -> None:
        found = islice(events, 1 + REPEATS)
        again = np.concatenate([event.frames.codes for event in found if not isinstance(event, PassStarted)])
        pass_, shot = known.pass_.index, known.shots[0]
        stored = [self._whole[pass_].shots[index] for index in self._writer.stored(pass_)]
        first = next(one for one in stored if one.group == shot.group)
        earlier, latest = (self._writer.codes(pass_, one.index) for one in (first, shot))
        refuse_changed_light(shot, earlier, latest, again)

    def _keep(self, events: Events, storage: Storage) -> bool:
        """Store what comes; True if that ended because it is to."""
        previous: Codes | None = None
        scalings: tuple[Scaling, ...] = ()
        held = False
        for event in events:
            if isinstance(event, PassStarted):
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

    def _take(self, record: Record, scalings: tuple[Scaling, ...], previous: Codes | None, storage: Storage) -> Codes:
        """Check and store a record; returns its last shot, for the next one to differ from."""
        self._bench.laser.require_emission()  # what was measured in the dark is not kept
        now_s = self._bench.now() - self._began
        frames = replace(record.frames, time_s=now_s + record.frames.time_s - record.frames.time_s[-1])
        _refuse_stale(previous, record)
        self._bench.limits.check_traces(tuple(record.pass_.patching), frames.codes, scalings)
        # Light that was off and on again is another epoch, as is another pass.
        storage.keep(record.pass_.index, record.first, frames, self._epochs + record.pass_.index + self._darkened)
        self._count_clipped(frames)
        last: Codes = frames.codes[-1]
        return last

    def _report(self, storage: Storage) -> None:
        done = self._begun_with + storage.kept
        if done > self._done:
            self._done = done
            self._progress(done, self._total)
            self._events.progress(done, self._total, self._last_shot)

    def _count_clipped(self, frames: Frames) -> None:
        clipped = int(np.count_nonzero(frames.clipped.any(axis=1)))
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
        record = self._last
        if record is None:
            return {}
        last = self._whole[record.pass_.index].shots[record.first + len(record.frames) - 1]
        return {
            "pass": record.pass_.index,
            "shot": last.index,
            "kind": str(last.kind),
            "dataset_index": last.dataset_index,
            "label": last.label,
        } | self._shown(last)

    def _start(self, event: PassStarted) -> None:
        """A pass has its ranges for good from its first part on."""
        index, scalings = event.pass_.index, event.scalings
        self._events(
            "pass started",
            **{"pass": index, "passes": len(self._whole)},
            wavelength_nm=event.pass_.wavelength_nm,
            ports=list(event.pass_.patching.values()),
        )
        if self._writer.locked_scales(index) is None:
            self._writer.scales(index, [one.scale_v for one in scalings], [one.offset_v for one in scalings])
        else:
            self._bench.dmd.blank()  # the picture that was probed may be the one to be measured: it is to be shown anew


def _refuse_stale(previous: Codes | None, record: Record) -> None:
    """Noise makes two traces differ: equal ones mean that the oscilloscope gave the same acquisition again."""
    codes = record.frames.codes
    first = 0 if previous is None else int(np.array_equal(previous, codes[0]))
    repeated = np.flatnonzero((codes[1:] == codes[:-1]).all(axis=(1, 2)))
    if first or repeated.size:
        shot = record.first + (0 if first else int(repeated[0]) + 1)
        raise InstrumentError(
            f"scope: shot {shot} and the one before gave byte-identical traces: it did not acquire anew; "
            f"check its trigger"
        )
