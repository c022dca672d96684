"""The sweeps in a folder: which there are, and how far each of their runs is. Looked at when a page asks."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from labctl.dashboard.listing import EVERY_S, RESTS
from labctl.errors import LabctlError, RunError
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.origin import Origin
from labctl.runs.format.store import is_elsewhere
from labctl.runs.index import RunRow, Stamp, is_there, run_row, stamp
from labctl.runs.live.alarm import may_emit
from labctl.runs.sweep import FILE, Sweep, places, read


@dataclass(frozen=True)
class Point:
    """A run of a sweep: its folder's name, values on the axes, and how far it is; None before it begins.

    alarm: its laser did not go dark. made: stamp of its plan.
    """

    name: str
    values: Mapping[str, str]
    row: RunRow | None
    alarm: bool = False
    made: Stamp | None = None

    @property
    def settled(self) -> bool:
        """Whether nothing more is to come of it."""
        return self.row is not None and self.row.complete and not self.alarm


@dataclass(frozen=True)
class SweepState:
    """A sweep and its runs in the order they are measured; `problem`: why it cannot be read.

    made: stamp of its file.
    """

    name: str
    sweep: Sweep | None = None
    points: tuple[Point, ...] = ()
    problem: str = ""
    made: Stamp | None = None

    @property
    def complete(self) -> int:
        """How many runs are complete."""
        return sum(point.row is not None and point.row.complete for point in self.points)

    @property
    def running(self) -> bool:
        """Whether a process of this machine measures one of them."""
        return any(point.row is not None and point.row.running for point in self.points)


class Sweeps:
    """The sweeps in a folder."""

    def __init__(self, folder: Path, clock: Callable[[], float] = time.monotonic) -> None:
        """Of `folder`, which need not exist yet; one elsewhere is looked at once, as it was listed."""
        self._folder = folder
        self._clock = clock
        self._due = clock()
        self._states: dict[str, SweepState] = {}

    def all(self) -> list[SweepState]:
        """All of them, the last by name first, which is the latest where no other names were given."""
        began = self._clock()
        if began >= self._due:
            inside = (one.name for one in self._folder.iterdir()) if self._folder.is_dir() else ()
            names = sorted((name for name in inside if is_there(self._folder / name / FILE)), reverse=True)
            self._states = {name: self._look(name, self._states.get(name)) for name in names}
            rests = math.inf if is_elsewhere(self._folder) else max(EVERY_S, RESTS * (self._clock() - began))
            self._due = self._clock() + rests
        return list(self._states.values())

    def named(self, name: str) -> SweepState | None:
        """The sweep of that name; one that has come since the last look is looked at."""
        if self._known(name) is None:
            self._look_for(self._folder / name / FILE)
        return self._known(name)

    def has_point(self, name: str) -> bool:
        """Whether `name`, written as sweep/run, is a run of a sweep that has begun, were it since the last look."""
        if not self._knows_point(name):
            self._look_for(RunPaths(self._folder / name).manifest)
        return self._knows_point(name)

    def running(self) -> list[str]:
        """The runs that are measured now, as sweep/run."""
        return [name for name, point in self._points() if point.row is not None and point.row.running]

    def alarms(self) -> dict[str, Origin | None]:
        """The runs whose laser did not go dark, as sweep/run, and what their instruments are."""
        return {name: point.row.instruments for name, point in self._points() if point.alarm and point.row is not None}

    def _known(self, name: str) -> SweepState | None:
        return next((state for state in self.all() if state.name == name), None)

    def _knows_point(self, name: str) -> bool:
        sweep, _, run = name.partition("/")
        state = self._known(sweep)
        return state is not None and any(point.name == run and point.row is not None for point in state.points)

    def _look_for(self, file: Path) -> None:
        """The next question is answered by a fresh look, if there is such a file: of a folder elsewhere never."""
        if not is_elsewhere(self._folder) and is_there(file):
            self._due = self._clock()

    def _points(self) -> list[tuple[str, Point]]:
        return [(f"{state.name}/{point.name}", point) for state in self.all() for point in state.points]

    def _look(self, name: str, before: SweepState | None) -> SweepState:
        """What is complete is not read again while it is the same."""
        directory = self._folder / name
        made = stamp(directory / FILE)
        known = before if before is not None and before.made == made else SweepState(name)
        done = {one.name: one for one in known.points if one.settled and one.made == _made(directory / one.name)}
        if known.sweep is not None and len(done) == len(known.points):
            return known
        try:
            sweep = known.sweep or _of_runs_here(directory)
            every = places(sweep)
        except LabctlError as error:
            return SweepState(name, problem=str(error))
        points = tuple(done.get(run) or _point(directory / run, values) for run, values in every)
        return SweepState(name, sweep, points, made=made)


def _of_runs_here(directory: Path) -> Sweep:
    """The sweep of a folder that holds its runs; a place elsewhere is not looked at because a file names it.

    Raises:
        RunError: It holds no sweep, or its runs are in a store.
    """
    file = read(directory)
    if file.store:
        raise RunError(f"{directory}: its runs are in {file.store}: look at them with 'labctl dashboard {file.store}'")
    return file.sweep


def _point(directory: Path, values: Mapping[str, str]) -> Point:
    paths = RunPaths(directory)
    if not is_there(paths.manifest):
        return Point(directory.name, values, None)
    made = _made(directory)
    return Point(directory.name, values, run_row(paths), alarm=may_emit(directory), made=made)


def _made(run: Path) -> Stamp | None:
    return stamp(RunPaths(run).plan)
