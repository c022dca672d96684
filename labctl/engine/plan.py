"""What a run will measure, as its files describe it: size, shots and drive, and how much room they take."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.values import Drive
from labctl.bench.recording.wire import Played
from labctl.bench.station import Station
from labctl.runs.format.columns import shot_table
from labctl.runs.format.layout import run_name
from labctl.runs.format.shape import RunShape
from labctl.runs.write.durability import Durability
from labctl.runs.write.room import needed, shots_a_shard
from protocols.base import Inputs, Measurement, Pass, Shot


@dataclass(frozen=True)
class Request:
    """What is to be run: protocol, what it shows or plays, station, a reference to its calibration, its coordinates.

    played: the recordings that answer in place of the instruments, if any do.
    """

    protocol: Measurement[Any]
    inputs: Inputs
    station: Station
    calibration: Mapping[str, Any] | None = None
    coordinates: Mapping[str, float | str] = field(default_factory=dict)
    played: tuple[Played, ...] = ()

    @property
    def durability(self) -> Durability:
        """How much a killed process may lose."""
        return durability_of(self.station)


@dataclass(frozen=True)
class Plan:
    """Size, shots and drive of a run, and how many shots on real instruments close a shard."""

    shape: RunShape
    shots: NDArray[Any]
    drive: Drive
    shots_a_shard: float


def planned(request: Request, bench: Bench) -> Plan:
    """What `request` asks of `bench`, to which nothing is sent.

    Raises:
        OutOfRange: its oscilloscope does not sample so fast.
        ProtocolError: it cannot measure these inputs.
    """
    protocol, inputs = request.protocol, request.inputs
    bench.scope.require_rate(protocol.sample_rate)
    shots, passes = protocol.shots(inputs), protocol.passes(bench)
    shape = RunShape(
        shots=len(shots),
        passes=tuple(tuple(one.patching.values()) for one in passes),
        wavelengths_nm=tuple(one.wavelength_nm for one in passes),
        samples=protocol.sample_count(inputs),
        sample_interval_s=1 / protocol.sample_rate,
        start_s=protocol.start_s(bench, inputs),
        code_type=bench.scope.code_type if protocol.averages == 1 else "int16",
    )
    seconds_a_shot = protocol.duration_s(bench, len(shots)) / (len(shots) * len(passes))
    return Plan(
        shape,
        _columns(shots, passes),
        protocol.drive(bench, inputs),
        shots_a_shard(shape, request.durability, seconds_a_shot, protocol.most_together()),
    )


def aliasing(sample_rate: float, bandwidth_hz: float | None) -> str | None:
    """What to say of a sample rate (S/s) below twice what the oscilloscope lets through; None where there is nothing.

    Source: Nyquist's theorem; the noise above half the rate comes back below it in any case.
    """
    if bandwidth_hz is None or sample_rate >= 2 * bandwidth_hz:
        return None
    highest = f"{sample_rate / 2e9:g} GHz"
    return (
        f"{sample_rate / 1e9:g} GS/s, {bandwidth_hz / 1e9:g} GHz wide: frequencies above {highest} fold back below it: "
        f'set scope.bandwidth = "{highest}" in the station file, or put a low-pass filter before the oscilloscope'
    )


def checked(request: Request, bench: Bench) -> Plan:
    """`planned`, if this bench, whose cables are right, can carry it out.

    Raises:
        ProtocolError, OutOfRange: it cannot.
    """
    request.protocol.check(bench, request.inputs)
    return planned(request, bench)


def bytes_needed(request: Request, bench: Bench) -> int:
    """What the run writes at most; nothing is sent to the bench.

    Raises:
        ProtocolError, OutOfRange: it asks for what no bench or this one gives, or the light's way is another one.
    """
    request.protocol.check_cabling(bench)
    plan = planned(request, bench)
    return needed(plan.shape, plan.drive, plan.shots_a_shard)


def new_directory(protocol: Measurement[Any], started: datetime) -> Path:
    """Where a run goes that names no directory of its own."""
    return Path("runs") / run_name(started, protocol.name, protocol.digest())


def durability_of(station: Station) -> Durability:
    """How much a killed process may lose there."""
    return Durability(shots=station.durability.shots, seconds=station.durability.seconds)


def _columns(shots: Sequence[Shot], passes: Sequence[Pass]) -> NDArray[Any]:
    """The planned `/shots`: whatever a protocol says of its shots is in the column of that name."""
    columns = {one.name: np.array([getattr(shot, one.name) for shot in shots]) for one in fields(Shot)}
    return shot_table(**columns, wavelength_nm=np.full(len(shots), passes[0].wavelength_nm))
