"""The folder of a sweep: sweep.json, which says what is to be measured, and a folder for each run."""

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from instruments.bench import Observer, Observers
from labctl.bench.opening import Access
from labctl.bench.own_files import is_own, remember
from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION, Station, read_station
from labctl.engine import session
from labctl.engine.control import Control, controlled
from labctl.engine.engine import Outcome
from labctl.engine.forecast import forecast
from labctl.engine.kept import kept
from labctl.engine.recorded_protocol import own_protocol
from labctl.engine.resume import without_files
from labctl.engine.session import Acquisition, Resumption
from labctl.engine.start import this_process
from labctl.errors import RunError, RunExists, StationError, writing
from labctl.runs.format.durable import not_made, replace_file
from labctl.runs.format.layout import RunPaths, run_name
from labctl.runs.format.store import alone, is_elsewhere, written
from labctl.runs.index import run_row
from labctl.runs.live.logs import EventLog
from labctl.runs.live.owner import OWNER, owned
from labctl.runs.said import Said, Saying
from labctl.runs.sweep import FILE, Sweep, SweepFile, read
from labctl.studies.run_tasks import acquire_run, missing_shard, refuse_another, require_in_place, resume_run
from labctl.studies.sweeps.declaration import Point, of_each
from labctl.studies.sweeps.run_folder import runs_of
from labctl.studies.tasks import Engine, Interrupted, in_parallel
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


def begin(
    directory: Path,
    sweep: Sweep,
    protocol: type[Measurement[Any]],
    station: Station,
    said: Said | None = None,
    store: Path | None = None,
) -> None:
    """Make the folder of a sweep; what is `said` of it holds for each of its runs, which go to `store` if there is one.

    Raises:
        UsageError: there is a password in the URL of the store.
        RunExists: there is something in it.
        NotWritten, RunError: it cannot be written.
    """
    place = "" if store is None else written(store)
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
        station_sha256=_digest(without_files(_settings(station))),
        protocol_file="" if file is None else str(file.path),
        protocol_sha256="" if file is None else file.sha256,
        said=said or Said(),
        store=place,
        of_each=of_each(sweep, protocol, station) if place else {},
    )
    replace_file(directory / FILE, kept.encode(), not_made)
    if kept.store:
        remember(directory / FILE)


def refuse_others(every: list[Point], store: Path, *, data: Path | None, access: Access) -> None:
    """Refuse a store in which another run has the place of one of a new sweep; the first that is there tells.

    Raises:
        UsageError: there is a password in its URL.
        WrongPlace, RunError: another run is there.
    """
    written(store)
    there = {path.name for path in store.iterdir()} if store.is_dir() else set()  # asked once, not for every point
    found = (one for one in every if one.name in there and RunPaths(store / one.name).manifest.exists())
    point = next(found, None)
    if point is not None:
        run = alone(store / point.name)
        refuse_another(_acquisition(point, run, data, access), run)


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
    settings = _settings(station)
    if file.station_sha256 not in (_digest(without_files(settings)), _digest(settings)):  # so in earlier sweeps
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

    What the folder is told by `labctl.runs.asking` holds before each run and as soon as it has begun.

    Raises:
        BenchInUse: another process has it.
        RunError: another process carries the sweep out, or its folder cannot be written.
        StoppedBySignal: it was told to stop at once.
        LabctlError: as `session.acquire` and `session.resume`; what was measured is kept.
    """
    missing = [point for point in every if not _is_complete(directory / point.name)]
    if not missing:
        return Measured(directory, len(every), len(every), 0)
    complete, measured = len(every) - len(missing), 0
    saying = Saying(read(directory).said)
    task = f"a sweep of {every[0].protocol.name}"
    stations = [point.station for point in missing]
    with kept(stations, task, access.wire) as bench, _under_way(directory, interruption) as control:
        for number, point in enumerate(every, start=1):
            if point not in missing:
                continue
            control.wait()
            if control.stopped:
                break
            run = directory / point.name
            with follow(number, len(every), point) as following:
                observer = Observers(saying, following, _Heeding(control))
                if RunPaths(run).manifest.exists():
                    resumption = Resumption(run, point.station, data, access)
                    found = session.resume(resumption, observer=observer, interruption=interruption, bench=bench)
                else:
                    acquisition = _acquisition(point, run, data, access)
                    found = session.acquire(
                        acquisition, observer=observer, interruption=interruption, bench=bench
                    ).outcome
            complete += found.complete
            measured += bool(found.measured)
    return Measured(directory, len(every), complete, measured)


def carry_out_side_by_side(
    directory: Path,
    every: list[Point],
    *,
    engine: Engine,
    data: Path | None,
    access: Access,
    interruption: Interruption,
    progress: Callable[[int, int], None],
) -> Measured:
    """Measure what the runs of a sweep still lack, as many at once as `engine` has workers; each bench is simulated.

    progress: called again and again with how many of the runs that were missing are done, and of how many. The runs are
    where the sweep's file says.

    While it is paused no run begins; a run that is measured in its place is told by `labctl.runs.asking`, others go on
    to their end.

    Raises:
        StationError: a bench is not wholly simulated.
        RunError: another process carries the sweep out, or its folder cannot be written.
        StoppedBySignal: it was told to stop at once.
        WrongPlace: another run has the place of one, or what was measured is not seen from here.
        LabctlError: as `session.acquire` and `session.resume`.
    """
    file = read(directory)
    runs = runs_of(directory, file)
    complete = {point.name for point in every if _is_complete(runs / point.name)}
    missing = [point for point in every if file.store or point.name not in complete]
    if not missing:
        return Measured(directory, len(every), len(every), 0)
    require_simulated(missing)
    saying = Saying(file.said)
    tasks: dict[str, Callable[[], Outcome]] = {}
    for point in missing:
        run = alone(runs / point.name)
        begun = not is_elsewhere(run) and RunPaths(run).manifest.exists()
        if begun and not file.store and point.name not in complete:
            tasks[point.name] = partial(resume_run, Resumption(run, point.station, data, access), saying)
        else:  # one that is complete in a store is looked at: another sweep may have put it there
            tasks[point.name] = partial(acquire_run, _acquisition(point, run, data, access), saying)
    with _under_way(directory, interruption) as control, suppress(Interrupted):

        def follow(done: int, _records: int) -> None:
            control.wait()
            if not control.stopped:
                progress(done, len(tasks))

        measured = in_parallel(tasks, engine=engine, interruption=interruption, progress=follow)
        require_in_place(runs / name for name in measured)
    runs = alone(runs)
    now = sum(_is_complete(runs / point.name) for point in every)
    return Measured(directory, len(every), now, now - len(complete))


def _acquisition(point: Point, run: Path, data: Path | None, access: Access) -> Acquisition:
    return Acquisition(point.protocol, point.station, run, data, access, coordinates=dict(point.coordinates))


@contextmanager
def _under_way(directory: Path, interruption: Interruption) -> Iterator[Control]:
    """The sweep can be found as one that this process carries out, and told something, inside the block."""
    with ExitStack() as stack:
        try:
            stack.enter_context(owned(directory))
        except BlockingIOError:
            raise RunError(
                f"{directory}: another process carries this sweep out: wait for its end, or stop it"
            ) from None
        except OSError as error:
            raise not_made(directory / OWNER, error) from error
        control = stack.enter_context(controlled(directory, interruption))
        events = stack.enter_context(EventLog())
        events.stored_in(directory)
        events.event("sweep started", **this_process())
        yield control
        events.event("stopped" if interruption.requested else "finished")


class _Heeding(Observer):
    """Between the look before a run and the time from which the run can be told something itself, the sweep may be."""

    def __init__(self, control: Control) -> None:
        self._control = control

    def stored_in(self, directory: Path) -> None:
        """The last look."""
        self._control.wait()


def _is_complete(run: Path) -> bool:
    """Whether nothing of a run is missing, no shard, nor its data.h5; a run in a store is whole."""
    paths = RunPaths(run)
    if is_elsewhere(run):
        return paths.manifest.exists()
    return paths.data.exists() and run_row(paths).complete and not missing_shard(paths)


def require_simulated(every: list[Point]) -> None:
    """Refuse to measure several points at once with one real bench.

    Raises:
        StationError: a bench is not wholly simulated.
    """
    if real := next((point.station for point in every if not point.station.wholly_simulated), None):
        raise StationError(f"{real.source}: one bench measures one run after the other: leave --scheduler out")


def forecasts(every: list[Point], *, data: Path | None, access: Access) -> Iterator[dict[str, Any]]:
    """What each run of a sweep will do; those of equal protocol and bench, whichever twin, are asked for once.

    Raises:
        LabctlError: as `forecast`: what was asked for is wrong, or this bench cannot do it.
    """
    known: dict[str, dict[str, Any]] = {}
    for point in every:
        key = f"{point.protocol.digest()} {_digest(_settings(point.station.twin(0)))}"
        if key not in known:
            known[key] = forecast(Acquisition(point.protocol, point.station, None, data, access))
        yield known[key]


def _settings(station: Station) -> dict[str, Any]:
    return station.model_dump(mode="json", exclude={"source"})


def _digest(settings: object) -> str:
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()
