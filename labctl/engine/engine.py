"""The engine: carries out a protocol on an opened bench and stores what comes.

It owns what every protocol needs and none should repeat: identities and settings for the manifest, the run directory,
and, in `measuring`, storage, progress, interruption and lost links. Light and safe state belong to the protocol's own
`acquire`.
"""

import os
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from instruments.bench import Bench
from instruments.values import Drive
from labctl.bench.signals import Interruption, heeds_signals
from labctl.bench.station import Station
from labctl.engine.control import controlled
from labctl.engine.profile import Stopwatch
from labctl.engine.recorder import Measuring, Progress
from labctl.engine.recovery import Recovery
from labctl.engine.resume import refuse_changed_instruments, refuse_other_plan
from labctl.runs.format.durable import not_written
from labctl.runs.format.layout import run_name
from labctl.runs.format.provenance import git_revision, versions
from labctl.runs.format.shots import Durability, PlayedDrive, RunShape, ShotColumns
from labctl.runs.live.commands import CommandLog
from labctl.runs.live.events import EventLog
from labctl.runs.write.room import needed
from labctl.runs.write.writer import RunWriter
from protocols.base import Inputs, Measurement, Pass, Shot


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


@dataclass(frozen=True)
class Request:
    """What is to be run: the protocol, what it shows or plays, its station, and a reference to its calibration."""

    protocol: Measurement[Any]
    inputs: Inputs
    station: Station
    calibration: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Listeners:
    """Who follows a run while it goes on; `interruption` is asked, after every record, whether it is to end."""

    log: CommandLog
    events: EventLog
    progress: Progress
    interruption: Interruption
    stopwatch: Stopwatch


def carry_out(request: Request, bench: Bench, listeners: Listeners, directory: Path | None) -> Outcome:
    """Run the protocol on `bench`; the run directory is `directory`, or a new one under `runs/`.

    Every instrument is asked who it is before a file is written or light switched on, and the laser is set in the dark,
    so that the manifest has the light of the first pass as it settled. The finished shots are kept
    however the run ends, and the bench is left in the safe state.

    Raises:
        InstrumentError: an instrument failed or gave the same trace twice.
        RunError: the directory exists or cannot be written.
        ProtocolError: the protocol does not suit the inputs or the bench.
    """
    plan = _plan(request, bench)
    started = datetime.now(UTC)
    manifest = _manifest(request, bench, started)
    directory = directory or new_directory(request.protocol, started)
    durability, seconds = durability_of(request.station), _seconds_a_shot(request, bench)
    with RunWriter.create(directory, manifest, *plan, durability, seconds_a_shot=seconds) as writer:
        _keep(listeners.log, writer.paths.commands)
        _tell_start("run started", listeners.events, request, writer)
        return _measure(request, bench, listeners, writer)


def bytes_needed(request: Request, bench: Bench) -> int:
    """What the run writes at most; nothing is sent to the bench."""
    return needed(*_planned(request, bench), durability_of(request.station), _seconds_a_shot(request, bench))


def go_on(request: Request, bench: Bench, listeners: Listeners, writer: RunWriter) -> Outcome:
    """Measure what the run that `writer` has opened again still lacks, on `bench`.

    The bench is made safe first: a killed process may have left it lit. Nothing is lit before instruments and plan are
    found to be those of the manifest.

    Raises:
        SettingsChanged: instruments have other identities or settings than the manifest says.
        InstrumentError: an instrument failed, or the light is not what it was.
        RunError: the run was planned otherwise, or cannot be written.
        ProtocolError: the protocol does not suit the inputs or the bench.
    """
    listeners.log("run", "!", f"resumed: shots on disk by pass {', '.join(map(str, writer.done))}")
    bench.make_safe()
    refuse_other_plan(writer.paths, writer.manifest, *_plan(request, bench))
    _, instruments = _light_and_instruments(request, bench)
    refuse_changed_instruments(writer.paths.directory, writer.manifest, instruments)
    _keep(listeners.log, writer.paths.commands)
    _tell_start("run resumed", listeners.events, request, writer)
    return _measure(request, bench, listeners, writer)


def _tell_start(event: str, events: EventLog, request: Request, writer: RunWriter) -> None:
    shape = writer.manifest["shape"]
    events(
        event,
        protocol=request.protocol.name,
        shots=shape["shots"],
        records=shape["shots"] * len(shape["passes"]),
        done=sum(writer.done),
        station=request.station.source,
        simulated=request.station.simulated,
        process=os.getpid(),
        heeds_signals=heeds_signals(),
        host=platform.node(),
    )
    events.keep_in(writer.paths.events)


def _keep(log: CommandLog, path: Path) -> None:
    try:
        log.keep_in(path)
    except OSError as error:
        raise not_written(path, error) from error


def new_directory(protocol: Measurement[Any], started: datetime) -> Path:
    """Where a run goes that names no directory of its own."""
    return Path("runs") / run_name(started, protocol.name, protocol.digest())


def durability_of(station: Station) -> Durability:
    """How much a killed process may lose there."""
    return Durability(shots=station.durability.shots, seconds=station.durability.seconds)


def _measure(request: Request, bench: Bench, listeners: Listeners, writer: RunWriter) -> Outcome:
    """Measure what `writer` lacks and finish the run."""
    before, log, events = writer.complete, listeners.log, listeners.events

    def tell_room(line: str) -> None:
        log("run", "!", line)
        events("warning", text=line)

    writer.room.tell = tell_room
    clock = time.perf_counter(), bench.now()
    with controlled(writer.paths.directory, listeners.interruption) as control:
        measuring = Measuring(
            request.protocol,
            request.inputs,
            bench,
            writer,
            control=control,
            progress=listeners.progress,
            events=events,
            stopwatch=listeners.stopwatch,
        )
        measuring.measure(Recovery(bench, log, events))
    writer.sync()
    seconds, bench_seconds = time.perf_counter() - clock[0], bench.now() - clock[1]
    outcome = Outcome(
        directory=writer.paths.directory,
        complete=writer.finish(),
        shots=writer.complete,
        measured=writer.complete - before,
        clipped=measuring.clipped,
        recovered=measuring.recovered,
        seconds=seconds,
        bench_seconds=bench_seconds,
        simulated=request.station.simulated,
    )
    told = {"shots": outcome.shots, "clipped": outcome.clipped, "recovered": outcome.recovered, "seconds": seconds}
    if outcome.complete:
        events("finished", **told)
    else:
        events("stopped", at_once=False, **told)
    return outcome


def _plan(request: Request, bench: Bench) -> tuple[RunShape, ShotColumns, PlayedDrive]:
    """Size, shots and drive of the whole run, if this bench can carry it out."""
    request.protocol.check_cabling(bench)
    request.protocol.check(bench, request.inputs)
    return _planned(request, bench)


def _planned(request: Request, bench: Bench) -> tuple[RunShape, ShotColumns, PlayedDrive]:
    protocol, inputs = request.protocol, request.inputs
    shots, passes = protocol.shots(inputs), protocol.passes(bench)
    return _shape(request, passes, shots), _columns(shots, passes), _played(protocol.drive(bench, inputs))


def _seconds_a_shot(request: Request, bench: Bench) -> float:
    """On one pass, on real instruments."""
    shots, passes = len(request.protocol.shots(request.inputs)), len(request.protocol.passes(bench))
    return request.protocol.duration_s(bench, shots) / (shots * passes)


def _shape(request: Request, passes: Sequence[Pass], shots: Sequence[Shot]) -> RunShape:
    protocol = request.protocol
    return RunShape(
        shots=len(shots),
        passes=tuple(tuple(pass_.patching.values()) for pass_ in passes),
        wavelengths_nm=tuple(pass_.wavelength_nm for pass_ in passes),
        samples=protocol.sample_count(request.inputs),
        sample_interval_s=1 / protocol.sample_rate,
        code_type="int8" if protocol.averages == 1 else "int16",
    )


def _columns(shots: Sequence[Shot], passes: Sequence[Pass]) -> ShotColumns:
    return ShotColumns(
        kind=np.array([shot.kind.value for shot in shots]),
        dataset_index=np.array([shot.dataset_index for shot in shots], np.int64),
        label=np.array([shot.label for shot in shots], np.int64),
        wavelength_nm=np.full(len(shots), passes[0].wavelength_nm),
        group=np.array([shot.group for shot in shots], np.int64),
        next_dataset_index=np.array([shot.next_dataset_index for shot in shots], np.int64),
        next_label=np.array([shot.next_label for shot in shots], np.int64),
    )


def _played(drive: Drive) -> PlayedDrive:
    return PlayedDrive(drive.samples, drive.marker, drive.sample_rate)


def _manifest(request: Request, bench: Bench, started: datetime) -> dict[str, Any]:
    protocol = request.protocol
    light, instruments = _light_and_instruments(request, bench)
    return {
        "protocol": {"name": protocol.name, "digest": protocol.digest(), "settings": protocol.model_dump(mode="json")},
        "station": request.station.model_dump(mode="json"),
        "light": light,
        "instruments": instruments,
        "calibration": request.calibration,
        "inputs_sha256": request.inputs.digest,
        "started": started.isoformat(timespec="seconds"),
        "versions": versions(),
        "git_revision": git_revision(),
        "seeds": {
            "seed": protocol.seed,
            "twin_seed": request.station.sim.twin_seed if request.station.simulated else None,
        },
    }


def _light_and_instruments(request: Request, bench: Bench) -> tuple[dict[str, Any], dict[str, Any]]:
    """What the laser settled on for the first pass, in the dark, and who all instruments are and how they are set."""
    identities = {name: vars(instrument.identify()) for name, instrument in bench.instruments.items()}
    light = vars(bench.set_light(request.protocol.passes(bench)[0].wavelength_nm))
    return light, {
        name: {"identity": identities[name], "settings": instrument.settings()}
        for name, instrument in bench.instruments.items()
    }
