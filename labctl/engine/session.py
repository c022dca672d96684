"""One run from a station and a protocol: load the inputs, open the bench, carry it out, close it; or go on with one."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from instruments.bench import Observer, Observers
from labctl.bench import answers
from labctl.bench.calibration import newest, warnings
from labctl.bench.laser_limits import check_laser
from labctl.bench.lock import held
from labctl.bench.opening import Access, OpenBench, opened
from labctl.bench.own_files import remember
from labctl.bench.signals import Interruption
from labctl.bench.station import Station
from labctl.bench.supervision import supervised
from labctl.engine.engine import Outcome, carry_out, go_on
from labctl.engine.inputs import inputs_for
from labctl.engine.kept import KeptBench
from labctl.engine.plan import Request, aliasing, durability_of
from labctl.engine.profile import Profile
from labctl.engine.recorded_protocol import protocol_of_manifest, refuse_other_inputs
from labctl.engine.resume import own_station, refuse_edited, refuse_mixed, station_of_manifest
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest
from labctl.runs.live.logs import CommandLog, EventLog
from labctl.runs.write.writer import RunWriter
from protocols.base import Measurement


@dataclass(frozen=True)
class Acquisition:
    """What to acquire, with what, and where to put it.

    `coordinates`: what the run stands for among others, such as its place on the axes of a sweep, in SI units.
    """

    protocol: Measurement[Any]
    station: Station
    directory: Path | None = None
    data: Path | None = None
    access: Access = Access()
    profile: bool = False
    coordinates: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True)
class Acquired:
    """A finished (or interrupted) run; `budget` is milliseconds of each step per shot, if it was profiled."""

    outcome: Outcome
    budget: dict[str, float] = field(default_factory=dict)


def acquire(
    acquisition: Acquisition,
    *,
    observer: Observer | None = None,
    interruption: Interruption | None = None,
    bench: KeptBench | None = None,
) -> Acquired:
    """Carry out one acquisition; `observer` follows it, and `interruption` is asked after every record.

    `bench` is one that is held already, and stays so for further runs.

    Concerns about the newest calibration of the bench are warnings, before light is switched on.

    Raises:
        DatasetError, StationError, ProtocolError, RunError: what was asked for is wrong; no light was switched on.
        NotConfigured: the laser is not armed.
        InstrumentError: an instrument failed; finished shots are kept.
    """
    protocol, station = acquisition.protocol, acquisition.station
    inputs = inputs_for(protocol, acquisition.data)
    observers = Observers()
    session = _session(protocol, station, acquisition.access, observers, observer, bench)
    with session as open_bench:
        simulation = open_bench.simulation
        profile = Profile((lambda: simulation.world.physics_seconds) if simulation is not None else lambda: 0.0)
        if acquisition.profile:
            observers.add(profile)
        calibrated = newest(station, datetime.now(UTC))
        reference = None if calibrated is None else calibrated.reference()
        _warn([*warnings(reference, station), *answers.warnings(station)], observers)
        for path in (Path(station.source), *(() if protocol.source_file is None else (protocol.source_file.path,))):
            remember(path)
        request = Request(protocol, inputs, station, reference, acquisition.coordinates, acquisition.access.wire.played)
        outcome = carry_out(request, open_bench.bench, interruption or Interruption(), acquisition.directory)
        return Acquired(outcome, profile.budget(outcome.shots) if acquisition.profile else {})


@dataclass(frozen=True)
class Resumption:
    """Which run to go on with, the station of this bench if somebody names it, and where the data sets lie."""

    directory: Path
    station: Station | None = None
    data: Path | None = None
    access: Access = Access()


def resume(
    resumption: Resumption,
    *,
    observer: Observer | None = None,
    interruption: Interruption | None = None,
    bench: KeptBench | None = None,
) -> Outcome:
    """Measure what a run still lacks, with the protocol and the seeds of its manifest, on this bench's own station.

    `bench` is one that is held already, and stays so for further runs.

    What is found of a crash, and concerns about the calibration that the run refers to, are warnings, before light is
    switched on. A run that lacks nothing is left as it is, but for a data.h5 that it may not have yet; no bench is
    opened then.

    Raises:
        RunError: no run, one that another process is writing, one whose manifest was edited, or one that cannot go on
            as it was begun, such as one of a recording.
        DatasetError, StationError, ProtocolError: what the manifest asks for is not there any more; or nobody names the
            station of this bench.
        InstrumentError: an instrument failed, or the light is not what it was; finished shots are kept.
    """
    directory = resumption.directory
    paths = RunPaths(directory)
    manifest = Manifest.read(paths)
    refuse_edited(paths, manifest.values)
    protocol = protocol_of_manifest(directory, manifest.values)
    begun = station_of_manifest(directory, manifest.values, resumption.station)
    station = own_station(directory, begun) if resumption.station is None else begun
    durability = None if resumption.station is None else durability_of(station)
    observers = Observers(observer or Observer())  # the others of a session follow once the bench is opened
    with ExitStack() as stack:
        writer = stack.enter_context(RunWriter.resume(directory, durability, on_warning=observers.warning))
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
        refuse_mixed(directory, manifest.values, resumption.access.wire)
        inputs = inputs_for(protocol, resumption.data)
        refuse_other_inputs(directory, manifest.values, inputs)
        session = _session(protocol, station, resumption.access, observers, observer, bench)
        open_bench = stack.enter_context(session)
        _warn(warnings(manifest.values.get("calibration"), station), observers)
        request = Request(protocol, inputs, station)
        return go_on(request, open_bench.bench, interruption or Interruption(), writer)


def _warn(lines: Iterable[str], observer: Observer) -> None:
    for line in lines:
        observer.warning(line)


@contextmanager
def _session(
    protocol: Measurement[Any],
    station: Station,
    access: Access,
    observers: Observers,
    observer: Observer | None,
    bench: KeptBench | None,
) -> Iterator[OpenBench]:
    """The opened bench, held, supervised, allowed to light; nothing was sent to it yet. Aliasing is noted in the logs.

    Its hold, supervisor, logs and `observer`, in this order, become the `observers`, who follow it.
    """
    with ExitStack() as stack:
        log = stack.enter_context(CommandLog())
        events = stack.enter_context(EventLog())
        if bench is None:
            hold, opening = stack.enter_context(held(station, f"a run of {protocol.name}", access.wire)), opened
        else:
            hold, opening = bench.hold, bench.opened
        supervisor = stack.enter_context(supervised(station, log, access.wire, hold.descriptors))
        observers.follow(hold, supervisor, log, events, observer or Observer())
        open_bench = stack.enter_context(opening(station, log, access, observer=observers))
        check_laser(station, [one.wavelength_nm for one in protocol.passes(open_bench.bench)])
        open_bench.bench.require_arm()
        if (aliased := aliasing(protocol.sample_rate, open_bench.bench.scope.bandwidth_hz)) is not None:
            log.warning(aliased)
            events.warning(aliased)
        yield open_bench
