"""The engine: carries out a protocol on an opened bench and stores what comes.

It owns what every protocol needs and none should repeat: the run directory, pauses and stops, lost links, and the
comparison with what is on disk when a run goes on. Light and safe state belong to the protocol's own `acquire`. What it
does is reported to the bench's observer.
"""

import logging
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

import numpy as np

from instruments.bench import Bench
from instruments.errors import InstrumentError
from instruments.safe_state import ending_with
from instruments.values import Scaling
from labctl.bench.identity import who_they_are
from labctl.bench.signals import Interruption
from labctl.engine.control import Control, HeldBack, controlled
from labctl.engine.light_check import REPEATS, first_of, refuse_changed_light, to_repeat
from labctl.engine.manifest import light_and_instruments, manifest
from labctl.engine.plan import Request, checked, new_directory
from labctl.engine.recorder import Recorder
from labctl.engine.recovery import Recovery
from labctl.engine.resume import refuse_changed_instruments, refuse_other_plan
from labctl.engine.start import carried_out
from labctl.engine.storage import Storage
from labctl.errors import RunError
from labctl.runs.write.writer import RunWriter
from protocols.base import Events, Part, PassStarted

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Outcome:
    """How a run went.

    `measured` of its `shots` became complete now, fewer than all where it was resumed. `recovered` is how often it went
    on after a lost link. `seconds` is the wall time from first light to the last record; `bench_seconds` the bench's,
    which is another one where an instrument is `simulated` in this process.
    """

    directory: Path
    shots: int
    measured: int
    complete: bool
    clipped: int
    recovered: int
    seconds: float
    bench_seconds: float
    simulated: bool

    @property
    def shots_per_second(self) -> float:
        """Shots on all ports, storage included, per second of wall time."""
        return self.measured / self.seconds if self.seconds else 0.0


def carry_out(request: Request, bench: Bench, interruption: Interruption, directory: Path | None) -> Outcome:
    """Run the protocol on `bench`; the run directory is `directory`, or a new one under `runs/`.

    Every instrument is asked who it is before a file is written or light switched on, and the laser is set in the dark,
    so that the manifest has the light of the first pass as it settled. The finished shots are kept however the run
    ends, and the bench is left in the safe state. `interruption` is asked after every record whether the run is to end.

    Raises:
        InstrumentError: an instrument failed or gave the same trace twice.
        RunError: the directory exists or cannot be written.
        ProtocolError: the protocol does not suit the inputs or the bench.
    """
    request.protocol.check_cabling(bench)
    identities = who_they_are(request.station, bench)
    plan = checked(request, bench)
    started = datetime.now(UTC)
    values = manifest(request, bench, identities, started)
    writer = RunWriter.create(
        directory or new_directory(request.protocol, started),
        values,
        plan.shape,
        plan.shots,
        plan.drive,
        request.durability,
        in_a_shard=plan.shots_a_shard,
        on_warning=bench.observer.warning,
    )
    with writer, controlled(writer.paths.directory, interruption) as control:
        _tell_start("run started", request, bench, writer)
        bench.observer.stored_in(writer.paths.directory)
        return _Measurement(request, bench, writer, control).outcome()


def go_on(request: Request, bench: Bench, interruption: Interruption, writer: RunWriter) -> Outcome:
    """Measure what the run that `writer` has opened again still lacks, on `bench`.

    The bench is made safe as soon as it is known whose it is: a killed process may have left it lit. Nothing is lit
    before instruments and plan are found to be those of the manifest.

    Raises:
        SettingsChanged: instruments have other identities or settings than the manifest says.
        InstrumentError: an instrument failed, or the light is not what it was.
        RunError: the run was planned otherwise, or cannot be written.
        ProtocolError: the protocol does not suit the inputs or the bench.
    """
    text = "; ".join([f"resumed: shots on disk by pass {', '.join(map(str, writer.done))}", *writer.recovered])
    with controlled(writer.paths.directory, interruption) as control:
        _tell_start("run resumed", request, bench, writer, text=text)
        identities = who_they_are(request.station, bench)
        bench.make_safe()
        request.protocol.check_cabling(bench)
        plan = checked(request, bench)
        refuse_other_plan(writer.paths, writer.manifest, plan.shape, plan.shots, plan.drive)
        _, instruments = light_and_instruments(request, bench, identities)
        refuse_changed_instruments(writer.paths.directory, writer.manifest, instruments, request.station)
        bench.observer.stored_in(writer.paths.directory)
        return _Measurement(request, bench, writer, control).outcome()


def _tell_start(event: str, request: Request, bench: Bench, writer: RunWriter, **more: str) -> None:
    shape = writer.manifest["shape"]
    bench.observer.event(
        event,
        protocol=request.protocol.name,
        shots=shape["shots"],
        records=shape["shots"] * len(shape["passes"]),
        done=sum(writer.done),
        **carried_out(request.station),
        **more,
    )


class _Measurement:
    """One run under way, through pauses and lost links, until nothing is missing or nobody wants more."""

    def __init__(self, request: Request, bench: Bench, writer: RunWriter, control: Control) -> None:
        self._request = request
        self._bench = bench
        self._writer = writer
        self._control = control
        self._whole = request.protocol.parts(bench, request.inputs)
        self._recovery = Recovery(bench)

    def outcome(self) -> Outcome:
        """Measure all that is missing, finish the run, and say how it went."""
        writer, bench = self._writer, self._bench
        before = writer.complete
        clock = time.perf_counter(), bench.now()
        with Storage(writer, bench.observer) as storage:
            recorder = Recorder(bench, self._request.inputs, self._whole, writer, storage, self._control)
            self._measure(recorder)
        seconds, bench_seconds = time.perf_counter() - clock[0], bench.now() - clock[1]
        outcome = Outcome(
            directory=writer.paths.directory,
            complete=writer.finish(),
            shots=writer.complete,
            measured=writer.complete - before,
            clipped=recorder.clipped,
            recovered=self._recovery.count,
            seconds=seconds,
            bench_seconds=bench_seconds,
            simulated=self._request.station.simulated,
        )
        counts = {"shots": outcome.shots, "clipped": outcome.clipped, "recovered": outcome.recovered}
        if outcome.complete:
            bench.observer.event("finished", **counts, seconds=seconds)
        else:
            bench.observer.event("stopped", at_once=False, **counts, seconds=seconds)
        return outcome

    def _measure(self, recorder: Recorder) -> None:
        """Store every missing record until there is none, or until stopped.

        A lost link ends the light, and so does a setting that somebody else has changed; once the bench is back, the
        records that are still missing or in doubt are measured in the vertical ranges that their passes have already.
        A pause is such a loss that somebody asked for. When a run goes
        on, by itself or because it is resumed, a reference image that it has on disk is measured first and compared.

        Raises:
            InstrumentError: an instrument failed, gave the same trace twice, or the light is not what it was; a disk
                that refused thereafter is a note to it.
            RunError: the disk is full or refuses.
        """
        control = self._control
        while missing := self._missing():
            if control.paused:
                self._wait(recorder)
            if control.stopped:
                return
            try:
                if not self._record(missing, recorder):
                    return
            except BaseException as error:
                try:
                    recorder.conclude(error)
                except RunError as failure:  # nothing more can be kept: no reason to light the bench again
                    if failure is not error:
                        error.add_note(str(failure))
                    raise error from None
                if not isinstance(error, InstrumentError | HeldBack):
                    raise
                recorder.report()
                if isinstance(error, InstrumentError):
                    self._recovery.after(error, sum(self._writer.done))
            recorder.darkened()

    def _record(self, missing: list[Part], recorder: Recorder) -> bool:
        """Measure in one stretch of light what is missing; True if it ended early because the operator wants it."""
        known = self._known(missing[0])
        parts = missing if known is None else [known, *missing]
        events = self._request.protocol.acquire(self._bench, self._request.inputs, parts)
        with self._control.followed(self._bench), ending_with(self._darken), ending_with(events.close):
            if known is not None:
                self._compare(events, known)
            return recorder.record(events)

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
                shots = [part.shots[shot] for shot in missing]
                parts.append(Part(part.pass_, shots, self._ranges(index), part.shots))
        return parts

    def _ranges(self, pass_index: int) -> tuple[Scaling, ...] | None:
        locked = self._writer.locked_scales(pass_index)
        return None if locked is None else tuple(map(Scaling, *(values.tolist() for values in locked)))

    def _known(self, missing: Part) -> Part | None:
        """A picture on disk to begin with, of the pass that is cut short or else the one before; None without any."""
        for part in reversed(self._whole[: missing.pass_.index + 1]):
            stored = [part.shots[shot] for shot in self._writer.stored(part.pass_.index)]
            if (shot := to_repeat(stored)) is not None:
                return Part(part.pass_, [shot] * REPEATS, self._ranges(part.pass_.index), part.shots)
        return None

    def _compare(self, events: Events, known: Part) -> None:
        found = islice(events, 1 + REPEATS)
        again = np.concatenate([event.frames.codes for event in found if not isinstance(event, PassStarted)])
        index, shot = known.pass_.index, known.shots[0]
        stored = [self._whole[index].shots[place] for place in self._writer.stored(index)]
        earlier, latest = (self._writer.codes(index, one.index) for one in (first_of(shot, stored), shot))
        refuse_changed_light(shot, earlier, latest, again)

    def _wait(self, recorder: Recorder) -> None:
        observer = self._bench.observer
        observer.event("paused", done=recorder.done, total=recorder.total)
        _logger.warning("paused in the dark after %s of %s records: waiting to go on", recorder.done, recorder.total)
        self._control.wait()
        if not self._control.stopped:
            observer.event("going on")
            _logger.warning("going on")
