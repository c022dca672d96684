"""One run from a station and a protocol: load the inputs, open the bench, carry it out, close it; or go on with one."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from instruments.values import Uploading
from labctl.bench.calibration import newest, warnings
from labctl.bench.laser_limits import check_laser
from labctl.bench.opening import OpenBench, opened
from labctl.bench.signals import Interruption
from labctl.bench.station import Station
from labctl.bench.supervision import supervised
from labctl.engine.engine import Listeners, Outcome, Request, carry_out, durability_of, go_on
from labctl.engine.inputs import inputs_for
from labctl.engine.instrument_states import tell_states
from labctl.engine.profile import Stopwatch
from labctl.engine.recorder import Progress
from labctl.engine.resume import protocol_of_manifest, refuse_other_inputs, station_of_manifest
from labctl.runs.format.layout import Manifest, RunPaths
from labctl.runs.live.commands import CommandLog
from labctl.runs.live.events import EventLog
from labctl.runs.write.writer import RunWriter
from protocols.base import Measurement

Warn = Callable[[str], None]
"""Called with each line that must be said before light is switched on."""


def _no_progress(_done: int, _total: int) -> None:
    pass


def _no_upload(_what: str, _done: int, _total: int) -> None:
    pass


def _to_nobody(_line: str) -> None:
    pass


def _both(first: Uploading, second: Uploading) -> Uploading:
    def told(what: str, done: int, total: int) -> None:
        first(what, done, total)
        second(what, done, total)

    return told


@dataclass(frozen=True)
class Acquisition:
    """What to acquire, with what, and where to put it."""

    protocol: Measurement[Any]
    station: Station
    directory: Path | None = None
    data: Path | None = None
    attended: bool = False
    armed: bool = False
    profile: bool = False


@dataclass(frozen=True)
class Acquired:
    """A finished (or interrupted) run; `budget` is milliseconds of each step per shot, if it was profiled."""

    outcome: Outcome
    budget: dict[str, float] = field(default_factory=dict)


def acquire(
    acquisition: Acquisition,
    *,
    interruption: Interruption | None = None,
    progress: Progress = _no_progress,
    uploading: Uploading = _no_upload,
    warn: Warn = _to_nobody,
) -> Acquired:
    """Carry out one acquisition; `progress` is called after every record, `uploading` while something is uploaded.

    `warn` hears what is to be said of the newest calibration of the bench; the run's events keep it too.

    Raises:
        DatasetError, StationError, ProtocolError, RunError: what was asked for is wrong; no light was switched on.
        NotConfigured: the laser is not armed.
        InstrumentError: an instrument failed; finished shots are kept.
    """
    protocol, station = acquisition.protocol, acquisition.station
    inputs = inputs_for(protocol, acquisition.data)
    at_work = _at_work(protocol, station, uploading, attended=acquisition.attended, armed=acquisition.armed)
    with at_work as (open_bench, log, events):
        simulation = open_bench.simulation
        stopwatch = Stopwatch((lambda: simulation.world.physics_seconds) if simulation is not None else lambda: 0.0)
        if acquisition.profile:
            stopwatch.watch(open_bench.bench)
        calibrated = newest(station)
        reference = None if calibrated is None else calibrated.reference()
        _warn(warnings(reference, station), warn, events)
        outcome = carry_out(
            Request(protocol, inputs, station, reference),
            open_bench.bench,
            Listeners(log, events, progress, interruption or Interruption(), stopwatch),
            acquisition.directory,
        )
        return Acquired(outcome, stopwatch.budget(outcome.shots) if acquisition.profile else {})


@dataclass(frozen=True)
class Resumption:
    """Which run to go on with; its station anew, where addresses have changed, and where its data sets lie."""

    directory: Path
    station: Station | None = None
    data: Path | None = None
    attended: bool = False
    armed: bool = False


def resume(
    resumption: Resumption,
    *,
    interruption: Interruption | None = None,
    progress: Progress = _no_progress,
    uploading: Uploading = _no_upload,
    warn: Warn = _to_nobody,
) -> Outcome:
    """Measure what a run still lacks, with the protocol, the seeds and the station of its manifest.

    `warn` hears what is to be said of the calibration that the run refers to; the run's events keep it too.

    A run that lacks nothing is left as it is, but for a data.h5 that it may not have yet; no bench is opened then.

    Raises:
        RunError: no run, one that another process is writing, or one that cannot go on as it was begun.
        DatasetError, StationError, ProtocolError: what the manifest asks for is not there any more.
        InstrumentError: an instrument failed, or the light is not what it was; finished shots are kept.
    """
    directory = resumption.directory
    manifest = Manifest.read(RunPaths(directory))
    protocol = protocol_of_manifest(directory, manifest.values)
    station = station_of_manifest(directory, manifest.values, resumption.station)
    durability = None if resumption.station is None else durability_of(station)
    with ExitStack() as stack:
        writer = stack.enter_context(RunWriter.resume(directory, durability))
        if writer.complete == manifest.shape.shots:
            return Outcome(
                directory=directory,
                shots=writer.complete,
                measured=0,
                complete=writer.finish(),
                clipped=0,
                recovered=0,
                seconds=0.0,
                bench_seconds=0.0,
                simulated=station.simulated,
            )
        inputs = inputs_for(protocol, resumption.data)
        refuse_other_inputs(directory, manifest.values, inputs)
        open_bench, log, events = stack.enter_context(
            _at_work(protocol, station, uploading, attended=resumption.attended, armed=resumption.armed)
        )
        _warn(warnings(manifest.values.get("calibration"), station), warn, events)
        listeners = Listeners(log, events, progress, interruption or Interruption(), Stopwatch(lambda: 0.0))
        return go_on(Request(protocol, inputs, station), open_bench.bench, listeners, writer)


def _warn(lines: Iterable[str], warn: Warn, events: EventLog) -> None:
    for line in lines:
        warn(line)
        events("warning", text=line)


@contextmanager
def _at_work(
    protocol: Measurement[Any], station: Station, uploading: Uploading, *, attended: bool, armed: bool
) -> Iterator[tuple[OpenBench, CommandLog, EventLog]]:
    """The opened bench under supervision, allowed to light, and its two logs; nothing was sent to it yet."""
    with ExitStack() as stack:
        log = stack.enter_context(CommandLog())
        events = stack.enter_context(EventLog())
        watch = stack.enter_context(supervised(station, log))
        open_bench = stack.enter_context(opened(station, log, attended=attended, armed=armed))
        watch(open_bench.bench)
        check_laser(station, [pass_.wavelength_nm for pass_ in protocol.passes(open_bench.bench)])
        open_bench.bench.require_arm()
        open_bench.bench.uploading = _both(uploading, events.uploading)
        tell_states(open_bench.bench, events)
        yield open_bench, log, events
