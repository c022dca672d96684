"""The live views in a folder of runs, as far as somebody looks at them."""

from pathlib import Path

from labctl.dashboard.state import ENDED, Phase, RunState, advanced
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.origin import Origin
from labctl.runs.index import INSTRUMENTS, Instruments
from labctl.runs.live.events import EventReader
from labctl.runs.live.owner import is_elsewhere, writer_named
from labctl.runs.live.sight import LIVE, Sight, read_sight


class WatchedView:
    """One live view: what it is doing, and what it sees; None before it has seen anything."""

    def __init__(self, directory: Path) -> None:
        """Watch the view in `directory`; nothing is read yet."""
        self.directory = directory
        self.state = RunState()
        self.sight: Sight | None = None
        self._events = EventReader(RunPaths(directory).events)
        self._told = RunState()

    def look(self) -> None:
        """Read what came since the last look."""
        while events := self._events.read():
            for event in events:
                self._told = advanced(self._told, event)
        started = self._told.started
        gone = (
            started is not None
            and not is_elsewhere(started)
            and writer_named(started, RunPaths(self.directory)) is None
        )
        self.state = self._told.without_writer() if gone else self._told
        self.sight = read_sight(self.directory)

    @property
    def running(self) -> bool:
        """Whether a process carries it out."""
        return self.state.phase not in (*ENDED, Phase.UNKNOWN)

    @property
    def origin(self) -> Origin:
        """Whether its bench is simulated, by who its instruments say they are."""
        told = self.state.started.fields.get("origin") if self.state.started is not None else None
        return next((one for one in Origin if one == told), Origin.BENCH)

    @property
    def instruments(self) -> Instruments:
        """Whether they are real or simulated, or some of each."""
        return INSTRUMENTS[self.origin]


def newest_view(folder: Path) -> Path | None:
    """The folder of the live view that began last among the runs in `folder`."""
    try:
        found = [one for one in (folder / LIVE).iterdir() if one.is_dir() and not one.is_symlink()]
    except OSError:
        return None
    return max(found, key=lambda one: one.name, default=None)
