"""The live views in a folder of runs, as far as somebody looks at them."""

from pathlib import Path
from urllib.parse import quote

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

    def look(self) -> RunState:
        """Read what came since the last look; what it is doing."""
        self._account.look()
        self.sight = read_sight(self.directory)
        return self.state

    @property
    def state(self) -> RunState:
        """What it is doing."""
        return self._account.state

    @property
    def address(self) -> str:
        """Of its page."""
        return f"live/{quote(self.directory.name, safe='', errors='replace')}"

    @property
    def origin(self) -> Origin:
        """Whether its instruments are real or simulated, or some of each, by who they said they are."""
        told = self.state.started.fields.get("origin") if self.state.started is not None else None
        return next((one for one in Origin if one == told), Origin.REAL)


def views_in(folder: Path) -> list[Path]:
    """The folders of the live views among the runs in `folder`, the one that began last at the end."""
    try:
        found = [one for one in (folder / LIVE).iterdir() if one.is_dir() and not one.is_symlink()]
    except OSError:
        return []
    return sorted(found, key=lambda one: one.name)


def view_going_on(folder: Path) -> WatchedView | None:
    """Of the live views among the runs in `folder` that are going on, the one that began last."""
    views = map(WatchedView, reversed(views_in(folder)))
    return next((view for view in views if view.look().running), None)
