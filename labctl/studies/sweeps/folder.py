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
from labctl.bench.own_files import is_own, remember
from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION, Station, read_station
from labctl.engine import session
from labctl.engine.forecast import forecast
from labctl.engine.kept import kept
from labctl.engine.resume import own_protocol
from labctl.engine.session import Acquisition, Resumption
from labctl.errors import RunExists, StationError, writing
from labctl.runs.format.durable import not_made, replace_file
from labctl.runs.format.layout import RunPaths, run_name
from labctl.runs.index import run_row
from labctl.runs.sweep import FILE, Sweep, SweepFile
from labctl.studies.sweeps.declaration import Point
from protocols.base import Measurement
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


def new_directory(protocol: Measurement[Any], started: datetime) -> Path:
    """Where a sweep of a protocol goes that names no folder of its own."""
    return Path("runs") / f"{run_name(started, protocol.name, protocol.digest())}-sweep"


def begin(directory: Path, sweep: Sweep, protocol: type[Measurement[Any]], station: Station) -> None:
    """Make the folder of a sweep.

    Raises:
        RunExists: there is something in it.
        NotWritten, RunError: it cannot be written.
    """
    with writing(directory, "name another --out"):
        if directory.exists() and any(directory.iterdir()):
            raise RunExists(f"{directory}: is not empty: name another --out, or go on with 'labctl resume {directory}'")
        directory.mkdir(parents=True, exist_ok=True)
    file = protocol.source_file
    for path in (Path(station.source), *(() if file is None else (file.path,))):
        remember(path)
    kept = SweepFile(
        sweep=sweep,
        station=station.source,
        station_sha256=_digest(station),
        protocol_file="" if file is None else str(file.path),
        protocol_sha256="" if file is None else file.sha256,
    )
    replace_file(directory / FILE, kept.model_dump_json(indent=2).encode(), not_made)


def protocol_of(directory: Path, file: SweepFile) -> type[Measurement[Any]]:
    """The protocol of a sweep that goes on.

    Raises:
        ProtocolError: it is not installed.
        RunError: a file defines it, and no run was begun here with that file as it is now.
    """
    if not file.protocol_file:
        return protocol_class(file.sweep.protocol)
    return own_protocol(directory, file.protocol_file, file.protocol_sha256)


def station_of(directory: Path, file: SweepFile, protocol: type[Measurement[Any]], given: Station | None) -> Station:
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
        station = (
            SIMULATED_STATION.cabled(projector=protocol.projector) if built_in else read_station(Path(file.station))
        )
    if _digest(station) != file.station_sha256:
        raise StationError(
            f"{directory}: {station.source} has changed since the sweep was begun: restore it, or begin a new sweep"
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
    """Measure what the runs of a sweep still lack, one after the other; the bench is held, and dark between them.

    Raises:
        BenchInUse: another process has it.
        LabctlError: as `session.acquire` and `session.resume`; what was measured is kept.
    """
    missing = [point for point in every if not _is_complete(directory / point.name)]
    if not missing:
        return Measured(directory, len(every), len(every), 0)
    complete, measured = len(every) - len(missing), 0
    task = f"a sweep of {every[0].protocol.name}"
    with kept([point.station for point in missing], task, access.wire) as bench:
        for number, point in enumerate(every, start=1):
            if interruption.requested:
                break
            if point not in missing:
                continue
            run = directory / point.name
            with follow(number, len(every), point) as observer:
                if RunPaths(run).manifest.exists():
                    resumption = Resumption(run, point.station, data, access)
                    found = session.resume(resumption, observer=observer, interruption=interruption, bench=bench)
                else:
                    acquisition = Acquisition(
                        point.protocol, point.station, run, data, access, coordinates=dict(point.coordinates)
                    )
                    found = session.acquire(
                        acquisition, observer=observer, interruption=interruption, bench=bench
                    ).outcome
            complete += found.complete
            measured += bool(found.measured)
    return Measured(directory, len(every), complete, measured)


def _is_complete(run: Path) -> bool:
    """Whether nothing of a run is missing, nor its data.h5."""
    paths = RunPaths(run)
    return paths.data.exists() and run_row(paths).complete


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


def _digest(station: Station) -> str:
    whole = station.model_dump(mode="json", exclude={"source"})
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()
