"""One run from a station and a protocol: load the inputs, open the bench, carry it out, close it."""

from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from labctl.command_log import CommandLog
from labctl.engine import Outcome, Request, carry_out
from labctl.inputs import inputs_for
from labctl.interruption import Interruption
from labctl.measuring import Progress
from labctl.opening import opened
from labctl.station import Station
from labctl.stopwatch import Stopwatch
from labctl.tuning import check_laser
from labctl.uploads import Uploading, tell_uploads
from protocols.base import Measurement


def _no_progress(_done: int, _total: int) -> None:
    pass


@dataclass(frozen=True)
class Acquisition:
    """What to acquire, with what, and where to put it."""

    protocol: Measurement[Any]
    station: Station
    directory: Path | None = None
    data: Path | None = None
    attended: bool = False
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
    uploading: Uploading | None = None,
) -> Acquired:
    """Carry out one acquisition; `progress` is called after every record, `uploading` while something is uploaded.

    Raises:
        DatasetError, StationError, ProtocolError, RunError: what was asked for is wrong; no light was switched on.
        InstrumentError: an instrument failed; finished shots are kept.
    """
    protocol, station = acquisition.protocol, acquisition.station
    inputs = inputs_for(protocol, acquisition.data)
    with ExitStack() as stack:
        log = stack.enter_context(CommandLog())
        open_bench = stack.enter_context(opened(station, log, attended=acquisition.attended))
        check_laser(station, [leg.wavelength_nm for leg in protocol.legs(open_bench.bench)])
        simulation = open_bench.simulation
        stopwatch = Stopwatch((lambda: simulation.world.physics_seconds) if simulation is not None else lambda: 0.0)
        if uploading is not None:
            tell_uploads(open_bench.bench, uploading)
        if acquisition.profile:
            stopwatch.watch(open_bench.bench)
        outcome = carry_out(
            Request(protocol, inputs, station),
            open_bench.bench,
            log,
            directory=acquisition.directory,
            interruption=interruption or Interruption(),
            progress=progress,
            stopwatch=stopwatch,
        )
        return Acquired(outcome, stopwatch.budget(outcome.shots) if acquisition.profile else {})
