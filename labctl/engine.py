"""The engine: carries out a protocol on an opened bench and stores what comes.

It owns what every protocol needs and none should repeat: identities and settings for the manifest, the run directory,
and, in `measuring`, storage, progress, interruption and lost links. Light and safe state belong to the protocol's own
`acquire`.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from instruments.bench import Bench
from instruments.values import Drive
from labctl.command_log import CommandLog
from labctl.interruption import Interruption
from labctl.lost_links import Recovery
from labctl.measuring import Measuring, Progress
from labctl.provenance import git_revision, versions
from labctl.runs import Durability, PlayedDrive, RunPaths, RunShape, RunWriter, ShotColumns, run_name
from labctl.station import Station
from labctl.stopwatch import Stopwatch
from protocols.base import Inputs, Leg, Measurement, Shot


@dataclass(frozen=True)
class Outcome:
    """How a run went.

    `recovered` is how often it went on after a lost link. `seconds` is the wall time from first light to the last
    record; `bench_seconds` the bench's.
    """

    directory: Path
    shots: int
    complete: bool
    clipped: int
    recovered: int
    seconds: float
    bench_seconds: float

    @property
    def shots_per_second(self) -> float:
        """Shots on all ports, storage included, per second of wall time."""
        return self.shots / self.seconds if self.seconds else 0.0


@dataclass(frozen=True)
class Request:
    """What is to be run: the protocol, what it shows or plays, and the station it is for."""

    protocol: Measurement[Any]
    inputs: Inputs
    station: Station


def carry_out(
    request: Request,
    bench: Bench,
    log: CommandLog,
    *,
    directory: Path | None,
    interruption: Interruption,
    progress: Progress,
    stopwatch: Stopwatch,
) -> Outcome:
    """Run the protocol on `bench`; the run directory is `directory`, or a new one under `runs/`.

    Every instrument is asked who it is before a file is written or light switched on, and the laser is set in the dark,
    so that the manifest has the light of the first leg as it settled. The finished shots are kept
    however the run ends, and the bench is left in the safe state.

    Raises:
        InstrumentError: an instrument failed or gave the same trace twice.
        RunError: the directory exists or cannot be written.
        ProtocolError: the protocol does not suit the inputs or the bench.
    """
    protocol, inputs = request.protocol, request.inputs
    shots = protocol.shots(inputs)
    legs = protocol.legs(bench)
    protocol.check_cabling(bench)
    protocol.check(bench, inputs)
    started = datetime.now(UTC)
    manifest = _manifest(request, bench, started, legs[0])
    directory = directory or Path("runs") / run_name(started, protocol.name, protocol.digest())
    durability = Durability(shots=request.station.durability.shots, seconds=request.station.durability.seconds)
    with RunWriter.create(
        directory,
        manifest,
        _shape(request, legs, shots),
        _columns(shots, legs),
        _played(protocol.drive(bench, inputs)),
        durability,
    ) as writer:
        log.keep_in(RunPaths(directory).commands)
        clock = time.perf_counter(), bench.now()
        measuring = Measuring(
            protocol, inputs, bench, writer, interruption=interruption, progress=progress, stopwatch=stopwatch
        )
        measuring.measure(Recovery(bench, log))
        seconds, bench_seconds = time.perf_counter() - clock[0], bench.now() - clock[1]
    return Outcome(
        directory,
        writer.complete,
        writer.complete == len(shots),
        measuring.clipped,
        measuring.recovered,
        seconds,
        bench_seconds,
    )


def _shape(request: Request, legs: Sequence[Leg], shots: Sequence[Shot]) -> RunShape:
    protocol = request.protocol
    return RunShape(
        shots=len(shots),
        passes=tuple(tuple(leg.patching.values()) for leg in legs),
        wavelengths_nm=tuple(leg.wavelength_nm for leg in legs),
        samples=protocol.sample_count(request.inputs),
        sample_interval_s=1 / protocol.sample_rate,
        code_type="int8" if protocol.averages == 1 else "int16",
    )


def _columns(shots: Sequence[Shot], legs: Sequence[Leg]) -> ShotColumns:
    return ShotColumns(
        kind=np.array([shot.kind.value for shot in shots]),
        dataset_index=np.array([shot.dataset_index for shot in shots], np.int64),
        label=np.array([shot.label for shot in shots], np.int64),
        wavelength_nm=np.full(len(shots), legs[0].wavelength_nm),
        group=np.array([shot.group for shot in shots], np.int64),
        next_dataset_index=np.array([shot.next_dataset_index for shot in shots], np.int64),
        next_label=np.array([shot.next_label for shot in shots], np.int64),
    )


def _played(drive: Drive) -> PlayedDrive:
    return PlayedDrive(drive.samples, drive.marker, drive.sample_rate)


def _manifest(request: Request, bench: Bench, started: datetime, first: Leg) -> dict[str, Any]:
    protocol = request.protocol
    identities = {name: vars(instrument.identify()) for name, instrument in bench.instruments.items()}
    return {
        "protocol": {"name": protocol.name, "digest": protocol.digest(), "settings": protocol.model_dump(mode="json")},
        "station": request.station.model_dump(mode="json"),
        "light": vars(bench.set_light(first.wavelength_nm)),
        "instruments": {
            name: {"identity": identities[name], "settings": instrument.settings()}
            for name, instrument in bench.instruments.items()
        },
        "inputs_sha256": request.inputs.digest,
        "started": started.isoformat(timespec="seconds"),
        "versions": versions(),
        "git_revision": git_revision(),
        "seeds": {"seed": protocol.seed, "twin_seed": request.station.sim.twin_seed},
    }
