"""The engine: carries out a protocol on an opened bench and stores what comes.

It owns what every protocol needs and none should repeat: identities and settings for the manifest, storage, progress,
interruption, and the checks that a record is new. Light and safe state belong to the protocol's own `acquire`.
"""

import hashlib
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from instruments.bench import Bench
from instruments.interfaces import Codes, Drive, InstrumentError
from labctl.command_log import CommandLog
from labctl.interruption import Interruption
from labctl.provenance import git_revision, versions
from labctl.runs import Durability, MeasuredBurst, PlayedDrive, RunPaths, RunShape, RunWriter, ShotColumns, run_name
from labctl.station import Station
from labctl.stopwatch import Stopwatch
from protocols.base import BurstRecord, Images, Leg, LegStarted, Measurement, Record, Shot

Progress = Callable[[int, int], None]
"""Called after every record with the number of records so far and in all."""


@dataclass(frozen=True)
class Outcome:
    """How a run went. `seconds` is the wall time from first light to the last record; `bench_seconds` the bench's."""

    directory: Path
    shots: int
    complete: bool
    clipped: int
    seconds: float
    bench_seconds: float

    @property
    def shots_per_second(self) -> float:
        """Shots on all ports, storage included, per second of wall time."""
        return self.shots / self.seconds if self.seconds else 0.0


@dataclass(frozen=True)
class Request:
    """What is to be run: the protocol, its images, and the station it is for."""

    protocol: Measurement
    images: Images
    station: Station

    @property
    def images_sha256(self) -> str:
        """Digest of the images and labels as they will be shown."""
        digest = hashlib.sha256(np.ascontiguousarray(self.images.images).tobytes())
        digest.update(np.ascontiguousarray(self.images.labels).tobytes())
        return digest.hexdigest()


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

    Every instrument is asked who it is before a file is written or light switched on. The finished shots are kept
    however the run ends, and the bench is left in the safe state.

    Raises:
        InstrumentError: an instrument failed or gave the same trace twice.
        RunError: the directory exists or cannot be written.
        ProtocolError: the protocol does not suit the images or the bench.
    """
    protocol, images = request.protocol, request.images
    shots = protocol.shots(images)
    legs = protocol.legs(bench)
    protocol.check(bench, images)
    started = datetime.now(UTC)
    manifest = _manifest(request, bench, started)
    directory = directory or Path("runs") / run_name(started, protocol.name, protocol.digest())
    durability = Durability(shots=request.station.durability.shots, seconds=request.station.durability.seconds)
    with RunWriter.create(
        directory,
        manifest,
        _shape(protocol, legs, shots),
        _columns(shots, legs),
        _played(protocol.drive(bench)),
        durability,
    ) as writer:
        log.keep_in(RunPaths(directory).commands)
        clock = time.perf_counter(), bench.now()
        clipped = _store(
            protocol, bench, images, shots, writer, interruption=interruption, progress=progress, stopwatch=stopwatch
        )
        seconds, bench_seconds = time.perf_counter() - clock[0], bench.now() - clock[1]
    return Outcome(directory, writer.complete, writer.complete == len(shots), clipped, seconds, bench_seconds)


def _store(
    protocol: Measurement,
    bench: Bench,
    images: Images,
    shots: Sequence[Shot],
    writer: RunWriter,
    *,
    interruption: Interruption,
    progress: Progress,
    stopwatch: Stopwatch,
) -> int:
    """Store every record of the protocol until it ends or is interrupted; returns how many were clipped."""
    total = len(shots) * len(protocol.legs(bench))
    done = clipped = 0
    previous: Codes | None = None
    began = bench.now()
    with Storage(writer, stopwatch) as storage, closing(protocol.acquire(bench, images, shots)) as events:
        for event in events:
            if isinstance(event, LegStarted):
                scalings = event.scalings
                writer.scales(event.leg.index, [s.scale_v for s in scalings], [s.offset_v for s in scalings])
                previous = None
                continue
            burst = _measured(event, bench.now() - began)
            _refuse_stale(previous, burst)
            previous = burst.codes[-1]
            storage.keep(event, burst)
            clipped += int(np.count_nonzero(burst.clipped.any(axis=1)))
            done += len(burst.codes)
            progress(done, total)
            if interruption.requested:
                break
    return clipped


class Storage:
    """Stores records; a burst in a thread of its own, while the bench measures the next one."""

    def __init__(self, writer: RunWriter, stopwatch: Stopwatch) -> None:
        self._writer = writer
        self._stopwatch = stopwatch
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="storage")
        self._stored: Future[None] | None = None

    def keep(self, event: Record | BurstRecord, burst: MeasuredBurst) -> None:
        """Store a single shot now, or wait until the last burst is stored and begin with this one."""
        if isinstance(event, Record):
            with self._stopwatch.step("storage"):
                self._writer.append(event.leg.index, burst.shot(0))
            return
        self._finish()
        self._stored = self._thread.submit(self._store, event.leg.index, burst)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._finish()
        finally:
            self._thread.shutdown()

    def _store(self, leg: int, burst: MeasuredBurst) -> None:
        with self._stopwatch.step("storage"):
            self._writer.append_burst(leg, burst)

    def _finish(self) -> None:
        stored, self._stored = self._stored, None
        if stored is not None:
            stored.result()


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


def _measured(event: Record | BurstRecord, time_s: float) -> MeasuredBurst:
    """What is stored of an event; `time_s` is the time of the last shot in it."""
    epoch = event.leg.index
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


def _shape(protocol: Measurement, legs: Sequence[Leg], shots: Sequence[Shot]) -> RunShape:
    return RunShape(
        shots=len(shots),
        passes=tuple(tuple(leg.patching.values()) for leg in legs),
        wavelengths_nm=tuple(leg.wavelength_nm for leg in legs),
        samples=protocol.sample_count(),
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
    )


def _played(drive: Drive) -> PlayedDrive:
    return PlayedDrive(drive.samples, drive.marker, drive.sample_rate)


def _manifest(request: Request, bench: Bench, started: datetime) -> dict[str, Any]:
    protocol = request.protocol
    return {
        "protocol": {"name": protocol.name, "digest": protocol.digest(), "settings": protocol.model_dump(mode="json")},
        "station": request.station.model_dump(mode="json"),
        "instruments": {
            name: {"identity": vars(instrument.identify()), "settings": instrument.settings()}
            for name, instrument in bench.instruments.items()
        },
        "images_sha256": request.images_sha256,
        "started": started.isoformat(timespec="seconds"),
        "versions": versions(),
        "git_revision": git_revision(),
        "seeds": {"seed": protocol.seed, "twin_seed": request.station.sim.twin_seed},
    }
