"""The runs in a folder, as far as somebody looks at them: read when a page asks, a few times a second at most.

All pages share what was read. A run is known by its name in the folder, as long as it is the same one.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

from labctl.dashboard.account import Account
from labctl.dashboard.accuracy import Curve
from labctl.dashboard.following import Following
from labctl.dashboard.learning import Learning
from labctl.dashboard.list_wording import run_address
from labctl.dashboard.listing import RESTS, Listing, Wanted
from labctl.dashboard.state import RunState
from labctl.dashboard.sweeps import Sweeps
from labctl.dashboard.views import WatchedView, views_in
from labctl.errors import LabctlError
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.origin import Origin
from labctl.runs.format.store import StorePath
from labctl.runs.index import Stamp, stamp
from labctl.runs.live.alarm import may_emit
from labctl.runs.queue import Item, Queue, Wish
from labctl.runs.read.follower import Follower, Latest

LOOK_EVERY_S = 0.25
LIST_EVERY_S = 10.0
"""A folder elsewhere is listed again when a page is opened, but not sooner than this after the last time."""
MOST_WATCHED = 20
"""Runs that are kept in memory; those that were not looked at for longest are forgotten."""


class WatchedRun:
    """One run: its state, one shot, its accuracy; `problem` is why part of that cannot be read, or empty.

    `latest` is the last shot with light that was reported and is on disk, on every port that has it; `shown` is the
    state of the run when it was reported, with its picture, and empty where no event is about it.
    """

    def __init__(self, directory: Path, learning: Learning, clock: Callable[[], float]) -> None:
        """Watch the run in `directory`; nothing is read yet."""
        self.directory = directory
        self.latest: list[Latest] = []
        self.shown = RunState()
        self.problem = ""
        self._learning = learning
        self._clock = clock
        self._due = clock()
        self._account = Account(directory)
        self._following: Follower | None = None

    def look(self) -> None:
        """Read what came since the last look."""
        if self._clock() < self._due:
            return
        self._due = self._clock() + LOOK_EVERY_S
        self._account.look()
        try:
            if self._following is None:
                self._following = Follower(self.directory)
            while self._following.look():
                pass
            self._see(self._following)
            self.problem = ""
        except (LabctlError, KeyError) as error:
            self.problem = str(error)

    def _see(self, following: Follower) -> None:
        """Take the last shot that was reported and is on disk; any that is there, where none was reported."""
        stored = (one for one in reversed(self._account.reported) if following.has(one.pass_index or 0, one.shot or 0))
        if (found := next(stored, None)) is not None:
            self.shown, self.latest = found, following.shot(found.shot or 0)
        elif self.shown.shot is None:
            self.latest = following.latest()

    @property
    def state(self) -> RunState:
        """What it is doing."""
        return self._account.state

    @property
    def manifest(self) -> dict[str, Any]:
        """What was asked; empty while it cannot be read."""
        return {} if self._following is None else dict(self._following.manifest.values)

    @property
    def report(self) -> Path:
        """Where its report lies, if it has one."""
        return self.directory / RunPaths(self.directory).report.name

    @property
    def records(self) -> tuple[int, int]:
        """How many records are on disk, and how many there will be."""
        if self._following is None:
            return 0, 0
        return sum(self._following.done), self._following.shape.shots * len(self._following.shape.passes)

    @property
    def pictures(self) -> dict[int, tuple[int, int]]:
        """The images that were measured on all ports: place in the data set -> class, and the first shot of it."""
        return {} if self._following is None else self._following.pictures

    def shot(self, shot: int) -> list[Latest]:
        """What one shot measured; nothing where it cannot be read, and `problem` says why."""
        try:
            return [] if self._following is None else self._following.shot(shot)
        except LabctlError as error:
            self.problem = str(error)
            return []

    def curve(self) -> Curve:
        """Accuracy as it grows; asking for it keeps it growing."""
        if self._following is None:
            return Curve()
        return self._learning.curve(self.directory, sum(self._following.done), growing=self.state.running)

    def following(self) -> Following:
        """How a readout that follows the run fares; asking for it keeps it following."""
        if self._following is None:
            return Following()
        return self._learning.following(self.directory, sum(self._following.done), growing=self.state.running)


@dataclass(frozen=True)
class Alarm:
    """A laser that did not go dark: what it was used by, the address of the page of that, and of what bench it is."""

    name: str
    address: str
    origin: Origin | None


class Watching:
    """The runs in `folder`; one elsewhere is known as it was when it was `listed`."""

    def __init__(
        self,
        folder: Path,
        environment: Mapping[str, str] = MappingProxyType({}),
        holder_of: Callable[[Path], str] = lambda _station: "",
        settle: Callable[[Queue], list[Item]] = Queue.items,
        ask: Callable[[Queue, Wish], None] = Queue.ask,
        sent_anew: Callable[[Mapping[str, Any]], Iterable[str]] = lambda _manifest: (),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Watch the runs in `folder`, which need not exist yet; one that is started here has `environment`, too.

        holder_of: who has the bench of a station file just now, in words; empty if nobody.
        settle: the items of a queue, where what ran when whoever carried it out died waits again.
        ask: ask whoever carries a queue out for something; it raises `UsageError` where nobody does.
        sent_anew: the settings in a manifest that its run sent before the first record, as patterns of names.
        """
        self.folder = folder
        self.environment = environment
        self.holder_of = holder_of
        self.settle = settle
        self.ask = ask
        self.sent_anew = sent_anew
        self.learning = Learning()
        self.listing = Listing(folder, clock)
        self.sweeps = Sweeps(folder, clock)
        self._clock = clock
        self._watched: dict[tuple[str, Stamp | None], WatchedRun] = {}
        self._old = clock()
        self.listed = datetime.now(UTC)

    def look_elsewhere(self, *names: str) -> None:
        """List a folder elsewhere anew, if that is due, and read these runs of it; nothing where the folder is here.

        It takes as long as its store does, so pages wait for it in a thread, and ask for nothing more by themselves.

        Raises:
            LabctlError: the store does not answer.
        """
        if not isinstance(self.folder, StorePath):
            return
        began = self._clock()
        if began >= self._old:
            folder = self.folder.anew()
            listing, sweeps = Listing(folder, self._clock), Sweeps(folder, self._clock)
            listing.runs(Wanted())
            sweeps.all()
            self.folder, self.listing, self.sweeps, self._watched = folder, listing, sweeps, {}
            self.listed = datetime.now(UTC)
            took = self._clock() - began
            self._old = began + took + max(LIST_EVERY_S, RESTS * took)
        for name in names:
            if (watched := self.run(name)) is not None:
                watched.look()

    def running(self) -> list[str]:
        """Names of the runs that a process writes now, the latest first; those of sweeps as sweep/run."""
        return [*self.listing.names("state = running"), *self.sweeps.running()]

    def alarms(self) -> list[Alarm]:
        """The lasers of live views and runs that did not go dark, the latest of each first."""
        views = [WatchedView(directory) for directory in reversed(views_in(self.folder)) if may_emit(directory)]
        for view in views:
            view.look()
        runs = {one.row.name: one.row.instruments for one in self.listing.runs(Wanted("alarm = 1")).found}
        return [
            *(Alarm(f"live view {view.directory.name}", view.address, view.origin) for view in views),
            *(Alarm(name, run_address(name), origin) for name, origin in (runs | self.sweeps.alarms()).items()),
        ]

    def run(self, name: str) -> WatchedRun | None:
        """The run of that name, if the list or, as sweep/run, a sweep has one."""
        if not self.listing.has(name) and not self.sweeps.has_point(name):
            return None
        known = name, stamp(RunPaths(self.folder / name).plan)
        watched = self._watched.pop(known, None) or WatchedRun(self.folder / name, self.learning, self._clock)
        self._watched[known] = watched  # the one that was asked for last is the last
        while len(self._watched) > MOST_WATCHED:
            self._watched.pop(next(iter(self._watched)))
        return watched
