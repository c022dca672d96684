"""The live views in a folder of runs, as far as somebody looks at them."""

from pathlib import Path

from labctl.dashboard.account import Account
from labctl.dashboard.state import RunState
from labctl.runs.format.origin import Origin
from labctl.runs.live.sight import LIVE, Sight, read_sight


class WatchedView:
    """One live view: what it is doing, and what it sees; None before it has seen anything."""

    def __init__(self, directory: Path) -> None:
        """Watch the view in `directory`; nothing is read yet."""
        self.directory = directory
        self.sight: Sight | None = None
        self._account = Account(directory)

    def look(self) -> None:
        """Read what came since the last look."""
        self._account.look()
        self.sight = read_sight(self.directory)

    @property
    def state(self) -> RunState:
        """What it is doing."""
        return self._account.state

    @property
    def origin(self) -> Origin:
        """Whether its instruments are real or simulated, or some of each, by who they said they are."""
        told = self.state.started.fields.get("origin") if self.state.started is not None else None
        return next((one for one in Origin if one == told), Origin.REAL)


def newest_view(folder: Path) -> Path | None:
    """The folder of the live view that began last among the runs in `folder`."""
    try:
        found = [one for one in (folder / LIVE).iterdir() if one.is_dir() and not one.is_symlink()]
    except OSError:
        return None
    return max(found, key=lambda one: one.name, default=None)
