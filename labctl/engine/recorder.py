"""Recording what a protocol yields: every record is checked, stored and reported before the next one is asked for.

Between records the settings of the bench are compared with what they were set to. What was measured since they were
found unchanged for the last time is in doubt until they are compared again.
"""

from collections import Counter
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np

from instruments.bench import Bench
from instruments.errors import DoubtfulRecord, InstrumentError, LightLost, LinkError, SettingChanged
from instruments.values import Frames, Scaling
from labctl.engine.alike import alike_by
from labctl.engine.control import Control
from labctl.engine.glimpses import Glimpses
from labctl.engine.likeness import Finding, Likeness
from labctl.engine.storage import Storage
from labctl.engine.thumbnail import shown_images
from labctl.runs.live.sight import LOOKED
from labctl.runs.write.writer import RunWriter
from protocols.base import Events, Inputs, Part, PassStarted, Record, ShotKind

COMPARED_EVERY = 50
"""Records after which settings are compared: a count, so that a run sends the same messages however fast it is."""
MOST_TWICE, ONE_IN = 3, 100
"""How often records of a pass may be measured again because of what they are: so often, and once in so many shots."""


def _not_yet() -> bool:
    """Nobody is sure of records before the settings were compared."""
    return False


class WrongRecord(InstrumentError):
    """Records are not those of their shots."""


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
        self._looked = writer.paths.directory / LOOKED
        self._glimpses = Glimpses(writer.paths.directory)
        self._last: Record | None = None
        time_s, epoch = writer.latest() or (0.0, -1)
        self._began = bench.now() - time_s
        first = next((part.pass_.index for part in whole if writer.missing(part.pass_.index).size), 0)
        self._epochs = epoch + 1 - first
        self._since_compared = 0  # records
        self._unsure_from: tuple[int, int] | None = None  # pass and first shot of what was measured since
        self._ends: frozenset[int] = frozenset()  # shots of the pass behind which nothing is missing
        self._alike = alike_by(inputs)
        self._twice: dict[int, set[int]] = {}  # by pass, the shots that were measured again because of their records
        self._doubted = Counter[int]()  # by pass, how often that was not single shots but all since
        self._passed = -1  # the last shot of the pass that was measured when all since was doubted
        self._likeness: tuple[int, Likeness] = -1, Likeness((), self._alike)
        self._unexamined: list[Record] = []
        self._scalings: tuple[Scaling, ...] = ()
        self._lowest = self._highest = np.empty(0)

    def record(self, events: Events) -> bool:
        """Record all that comes; True if that ended early because the operator wants it.

        Raises:
            SettingChanged: somebody else changed a setting.
            InstrumentError: an instrument failed, or records are not those of their shots.
            RunError: the disk is full or refuses.
        """
        held = False
        with closing(self._glimpses):
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
        if held:
            self._compare()
        self._writer.sync()
        self.report()
        return held

    def conclude(self, error: BaseException) -> None:
        """Light went out before its time: what was measured since nothing was known to be wrong stays, or is in doubt.

        Settings outlast the light, so they are compared once more, unless an instrument is out of reach.

        Raises:
            RunError: the disk is full or refuses.
        """
        self._storage.wait()
        if self._unsure_from is None:
            self._writer.sync()
        elif isinstance(error, SettingChanged | LightLost | DoubtfulRecord | WrongRecord):
            self._writer.doubt(str(error), *self._unsure_from)
        elif isinstance(error, LinkError):
            self._writer.sync_unsure()
        else:
            self._compare_in_the_dark()

    def darkened(self) -> None:
        """Light was off: what follows is another epoch, and what is in doubt is measured again."""
        self._epochs += 1
        self._compare_in_the_dark()
        self._writer.discard_suspect()
        self._unsure_from = None
        self.done = sum(self._writer.done)
        self._begun_with = self.done - self._single - self._storage.kept

    def _compare_in_the_dark(self) -> None:
        if self._unsure_from is None:
            return
        try:
            self._compare()
        except InstrumentError as error:
            self._writer.doubt(str(error), *self._unsure_from)
        else:
            self._writer.sync()

    def report(self) -> None:
        """Tell the observer of records that have become done."""
        done = self._begun_with + self._single + self._storage.kept
        if done > self.done:
            self.done = done
            self._observer.progress(done, self.total, self._last_shot)

    def _start(self, event: PassStarted) -> None:
        """A pass has its ranges for good from its first part on."""
        index, scalings = event.pass_.index, event.scalings
        self._storage.wait()
        self._compare()  # finding the ranges takes long
        self._observer.event(
            "pass started",
            **{"pass": index, "passes": len(self._whole)},
            wavelength_nm=event.pass_.wavelength_nm,
            ports=list(event.pass_.patching.values()),
            time_s=round(self._bench.now() - self._began, 3),
        )
        if self._writer.locked_scales(index) is None:
            self._writer.scales(index, [one.scale_v for one in scalings], [one.offset_v for one in scalings])
        if self._writer.stored(index).size:
            self._bench.dmd.blank()  # the picture that was probed may be the one to be measured: it is to be shown anew
        self._scalings = scalings
        shots = self._whole[index].shots
        if self._likeness[0] != index:
            self._likeness = index, Likeness(shots, self._alike)
            self._passed = -1
        self._unexamined = []
        missing = self._writer.missing(index)
        self._ends = frozenset(missing[np.append(np.diff(missing) > 1, True)].tolist())
        self._lowest, self._highest = self._bench.limits.detector_codes(scalings)

    def _take(self, record: Record) -> None:
        self._bench.laser.require_emission()  # what was measured in the dark is not kept
        now_s = self._bench.now() - self._began
        times = record.frames.time_s
        frames = replace(record.frames, time_s=now_s + times - times[-1])
        if (frames.codes.min(axis=(0, 2)) < self._lowest).any() or (
            frames.codes.max(axis=(0, 2)) > self._highest
        ).any():
            self._bench.limits.check_traces(tuple(record.pass_.patching), frames.codes, self._scalings)
        where = record.pass_.index, record.first
        if self._looked.exists():
            self._glimpses.take(*where, frames, self._scalings)
        epoch = self._epochs + record.pass_.index  # light that was off and on again is another one, as is another pass
        if self._unsure_from is None:
            self._unsure_from = where
        self._unexamined.append(record)
        self._since_compared += len(frames.codes)
        last = record.first + len(frames.codes) - 1
        sure = self._compare if self._since_compared >= COMPARED_EVERY or last in self._ends else _not_yet
        if len(frames.codes) == 1:
            with self._observer.step("storage"):
                self._writer.append(*where, frames, epoch, sure=sure)
                if self._unsure_from is not None:  # no shard was closed
                    sure()
            self._single += 1
        else:
            self._keep(where, frames, epoch)
        if len(frames.codes) > 1 or self._whole[where[0]].shots[last].kind is not ShotKind.DARK:
            self._last = record
        clipped = int(np.count_nonzero(frames.clipped.any(axis=1)))
        if clipped and not self.clipped:
            self._observer.warning("records touch the end of the vertical range: their peaks are cut off")
        self.clipped += clipped

    def _keep(self, where: tuple[int, int], frames: Frames, epoch: int) -> None:
        """Store a burst, whether or not the settings were changed meanwhile."""
        sure = False
        try:
            sure = self._compare()
        finally:
            self._storage.keep(*where, frames, epoch, sure=sure)

    def _compare(self) -> bool:
        """Compare the settings with what they were set to, and the records with one another; nothing is wrong.

        Raises:
            SettingChanged: a setting is another one.
            DoubtfulRecord, WrongRecord: records are not those of their shots.
        """
        with self._observer.step("comparison"):
            self._bench.require_unchanged()
        self._since_compared = 0
        self._examine()
        self._unsure_from = None
        return True

    def _examine(self) -> None:
        """Compare the records that came since with one another.

        Raises:
            SettingChanged, DoubtfulRecord, WrongRecord: they are not those of their shots.
        """
        records, self._unexamined = self._unexamined, []
        unsure_from = self._unsure_from
        if not records or unsure_from is None:
            return
        with self._observer.step("comparison"):
            likeness = self._likeness[1]
            finding = likeness.examine(records[0].first, np.concatenate([one.frames.codes for one in records]))
        if finding is not None:
            self._unsure_from = records[0].pass_.index, min(finding.first, unsure_from[1])
            self._bench.require_unchanged()  # a setting may be the reason
            likeness.measured_again(finding)
            last = records[-1].first + len(records[-1].frames.codes) - 1
            raise self._wrong(records[0].pass_.index, finding, last)

    def _wrong(self, pass_index: int, finding: Finding, last: int) -> InstrumentError:
        """What may be so by chance is measured again, unless it has just been, or too much of the pass has."""
        twice = self._twice.setdefault(pass_index, set())
        twice.update(finding.shots)
        again = finding.told_by is not None and finding.told_by <= self._passed
        if finding.told_by is not None:
            self._doubted[pass_index] += 1
            self._passed = last
        certain = not finding.shots and finding.told_by is None
        most = MOST_TWICE + len(self._whole[pass_index].shots) // ONE_IN
        if certain or again or self._doubted[pass_index] + len(twice) > most:
            self._unsure_from = pass_index, min({finding.first, *twice})
            return WrongRecord(finding.text)
        return DoubtfulRecord(finding.text)

    def _last_shot(self) -> dict[str, Any]:
        """What is known of the shot with light that was measured last, with its image."""
        if (record := self._last) is None:
            return {}
        shots = self._whole[record.pass_.index].shots[record.first : record.first + len(record.frames.codes)]
        last = next((shot for shot in reversed(shots) if shot.kind is not ShotKind.DARK), shots[-1])
        return {
            "pass": record.pass_.index,
            "shot": last.index,
            "kind": str(last.kind),
            "dataset_index": last.dataset_index,
            "label": last.label,
        } | self._shown(last)
