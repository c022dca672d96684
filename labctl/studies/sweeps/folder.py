"""The folder of a sweep: sweep.json, which says what is to be measured, and a folder for each run."""

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from instruments.bench import Observer
from labctl.bench.opening import Access
from labctl.bench.own_stations import is_own
from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION, Station, read_station
from labctl.engine import session
from labctl.engine.forecast import forecast
from labctl.engine.session import Acquisition, Resumption
from labctl.errors import RunExists, StationError, writing
from labctl.runs.format.durable import not_made, replace_file
from labctl.runs.format.layout import RunPaths, run_name
from labctl.runs.sweep import FILE, Sweep, SweepFile
from labctl.studies.sweeps.declaration import Point, points
from protocols.registry import protocol_class


@dataclass(frozen=True)
class Measured:
    """How far a sweep is: complete runs of all, and in how many of them something was measured now."""

    directory: Path
    runs: int
    complete: int
    measured: int


Follow = Callable[[int, int, Point], AbstractContextManager[Observer]]
"""Whatever follows run n of so many; it ends with the run."""


def new_directory(protocol: str, started: datetime) -> Path:
    """Where a sweep of the protocol called so goes that names no folder of its own.

    Raises:
        ProtocolError: it is not installed.
    """
    return Path("runs") / f"{run_name(started, protocol, protocol_class(protocol)().digest())}-sweep"


def begin(directory: Path, sweep: Sweep, station: Station) -> None:
    """Make the folder of a sweep.

    Raises:
        RunExists: there is something in it.
        NotWritten, RunError: it cannot be written.
    """
    with writing(directory, "name another --out"):
        if directory.exists() and any(directory.iterdir()):
            raise RunExists(f"{directory}: is not empty: name another --out, or go on with 'labctl resume {directory}'")
        directory.mkdir(parents=True, exist_ok=True)
    kept = SweepFile(sweep=sweep, station=station.source, station_sha256=_digest(station))
    replace_file(directory / FILE, kept.model_dump_json(indent=2).encode(), not_made)


def station_of(directory: Path, file: SweepFile, given: Station | None) -> Station:
    """The bench of a sweep that goes on: the one given, or the file that it was begun with here, if it is as it was.

    Raises:
        StationError: there is none, or it says something else now.
    """
    station = given
    if station is None:
        built_in = file.station == SIMULATED_STATION.source
        if not built_in and not is_own(Path(file.station)):
            raise StationError(
                f"{directory}: no run was begun here with the station file {file.station!r} as it is now: name the "
                f"station of this bench by --station"
            )
        station = SIMULATED_STATION if built_in else read_station(Path(file.station))
        station = _as_begun(file, station)
    if _digest(station) != file.station_sha256:
        raise StationError(
            f"{directory}: {station.source} does not say what it said when the sweep was begun: put that back, or "
            f"begin a new sweep"
        )
    return station


def carry_out(
    directory: Path,
    every: list[Point],
    *,
    data: Path | None,
    access: Access,
    interruption: Interruption,
    follow: Follow,
) -> Measured:
    """Measure what the runs of a sweep still lack, one after the other; the bench is dark between them.

    Raises:
        LabctlError: as `session.acquire` and `session.resume`; what was measured is kept.
    """
    complete = measured = 0
    for number, point in enumerate(every, start=1):
        if interruption.requested:
            break
        run = directory / point.name
        if RunPaths(run).manifest.exists():
            with follow(number, len(every), point) as observer:
                found = session.resume(
                    Resumption(run, point.station, data, access), observer=observer, interruption=interruption
                )
        else:
            with follow(number, len(every), point) as observer:
                acquisition = Acquisition(
                    point.protocol, point.station, run, data, access, coordinates=dict(point.coordinates)
                )
                found = session.acquire(acquisition, observer=observer, interruption=interruption).outcome
        complete += found.complete
        measured += bool(found.measured)
    return Measured(directory, len(every), complete, measured)


def forecasts(every: list[Point], *, data: Path | None, access: Access) -> Iterator[dict[str, Any]]:
    """What each run of a sweep will do; those of equal protocol and bench are asked for once.

    Raises:
        LabctlError: as `forecast`: what was asked for is wrong, or this bench cannot do it.
    """
    known: dict[str, dict[str, Any]] = {}
    for point in every:
        key = f"{point.protocol.digest()} {_digest(point.station)}"
        if key not in known:
            known[key] = forecast(Acquisition(point.protocol, point.station, None, data, access))
        yield known[key]


def _as_begun(file: SweepFile, station: Station) -> Station:
    """With the light's way as the sweep's protocol needs it, where no station file was named."""
    if file.station != SIMULATED_STATION.source:
        return station
    projector = points(file.sweep, station)[0].protocol.projector
    return station.cabled(projector=projector)


def _digest(station: Station) -> str:
    whole = station.model_dump(mode="json", exclude={"source"})
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()
