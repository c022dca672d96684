"""Recording what a protocol yields: every record is checked, stored and reported before the next one is asked for."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.errors import InstrumentError
from instruments.values import Codes, Scaling
from labctl.engine.control import Control
from labctl.engine.storage import Storage
from labctl.engine.thumbnail import shown_images
from labctl.runs.write.writer import RunWriter
from protocols.base import Events, Inputs, Part, PassStarted, Record


class Recorder:
    """Takes what a protocol yields, in one stretch of light after the other, and keeps count.

    Attributes:
        clipped: records that touch the end of the vertical range.
        done: records of the run that are on disk, or that the writer will put there within the run's durability.
        total: records of the whole run.
    """

    def __init__(
        self,
        bench: Bench,
        inputs: Inputs,
        whole: tuple[Part, ...],
        writer: RunWriter,
        storage: Storage,
        control: Control,
    ) -> None:
        """Record the run of the parts `whole` into `storage`; nothing is sent to `bench` yet.

        A run that has some shots on disk goes on: its times after the last of them, its epochs too.
        """
        self.clipped = 0
        self.done = self._begun_with = sum(writer.done)
        self._single = 0  # shots that were stored one by one
        self.total = sum(len(part.shots) for part in whole)
        self._bench = bench
        self._observer = bench.observer
        self._whole = whole
        self._writer = writer
        self._storage = storage
        self._control = control
        self._shown = shown_images(inputs)
        self._last: Record | None = None
        time_s, epoch = writer.latest() or (0.0, -1)
        self._began = bench.now() - time_s
        first = next((part.pass_.index for part in whole if writer.missing(part.pass_.index).size), 0)
        self._epochs = epoch + 1 - first
        self._scalings: tuple[Scaling, ...] = ()
        self._lowest = self._highest = np.empty(0)
        self._previous: Codes | None = None

    def darkened(self) -> None:
        """Light was off: what follows is another epoch."""
        self._epochs += 1

    def record(self, events: Events) -> bool:
        """Record all that comes; True if that ended early because the operator wants it.

        Raises:
            InstrumentError: an instrument failed, or gave the same trace twice.
            RunError: the disk is full or refuses.
        """
        held = False
        for event in events:
            if isinstance(event, PassStarted):
                self._start(event)
            else:
                self._take(event)
            self.report()
            asked = self._control.interruption.requested or self._control.path.exists()
            if held := asked and self._control.holds:
                break
        self._storage.wait()
        self.report()
        return held

    def report(self) -> None:
        """Tell the observer of records that have become done."""
        done = self._begun_with + self._single + self._storage.kept
        if done > self.done:
            self.done = done
            self._observer.progress(done, self.total, self._last_shot)

    def _start(self, event: PassStarted) -> None:
        """A pass has its ranges for good from its first part on."""
        index, scalings = event.pass_.index, event.scalings
        self._observer.event(
            "pass started",
            **{"pass": index, "passes": len(self._whole)},
            wavelength_nm=event.pass_.wavelength_nm,
            ports=list(event.pass_.patching.values()),
        )
        if self._writer.locked_scales(index) is None:
            self._writer.scales(index, [one.scale_v for one in scalings], [one.offset_v for one in scalings])
        else:
            self._bench.dmd.blank()  # the picture that was probed may be the one to be measured: it is to be shown anew
        self._storage.wait()
        self._scalings, self._previous = scalings, None
        self._lowest, self._highest = self._bench.limits.detector_codes(scalings)

    def _take(self, record: Record) -> None:
        self._bench.laser.require_emission()  # what was measured in the dark is not kept
        now_s = self._bench.now() - self._began
        times = record.frames.time_s
        frames = replace(record.frames, time_s=now_s + times - times[-1])
        self._refuse_stale(record.first, frames.codes)
        if (frames.codes.min(axis=(0, 2)) < self._lowest).any() or (
            frames.codes.max(axis=(0, 2)) > self._highest
        ).any():
            self._bench.limits.check_traces(tuple(record.pass_.patching), frames.codes, self._scalings)
        where = record.pass_.index, record.first
        epoch = self._epochs + record.pass_.index  # light that was off and on again is another one, as is another pass
        if len(frames.codes) == 1:
            with self._observer.step("storage"):
                self._writer.append(*where, frames, epoch)
            self._single += 1
        else:
            self._storage.keep(*where, frames, epoch)
        self._previous, self._last = frames.codes[-1], record
        clipped = int(np.count_nonzero(frames.clipped.any(axis=1)))
        if clipped and not self.clipped:
            self._observer.warning("records touch the end of the vertical range: their peaks are cut off")
        self.clipped += clipped

    def _refuse_stale(self, shot: int, codes: Codes) -> None:
        """Noise makes two traces differ: equal ones mean that the oscilloscope gave the same acquisition again."""
        first = self._previous is not None and np.array_equal(self._previous, codes[0])
        repeated: NDArray[np.intp] = np.flatnonzero((codes[1:] == codes[:-1]).all(axis=(1, 2)))
        if first or repeated.size:
            shot += 0 if first else int(repeated[0]) + 1
            raise InstrumentError(
                f"scope: shot {shot} and the one before gave byte-identical traces: it did not acquire anew; "
                f"check its trigger"
            )

    def _last_shot(self) -> dict[str, Any]:
        """What is known of the shot that was measured last, with the image that the DMD shows."""
        if (record := self._last) is None:
            return {}
        last = self._whole[record.pass_.index].shots[record.first + len(record.frames.codes) - 1]
        return {
            "pass": record.pass_.index,
            "shot": last.index,
            "kind": str(last.kind),
            "dataset_index": last.dataset_index,
            "label": last.label,
        } | self._shown(last)
