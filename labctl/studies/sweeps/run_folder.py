"""Where the runs of a sweep are: in its own folder, or in a store, where others may lie beside them."""

from pathlib import Path

from labctl.bench.own_files import is_own
from labctl.errors import RunError
from labctl.runs.format.store import is_elsewhere, location
from labctl.runs.sweep import FILE, SweepFile, is_sweep, places, read


def runs_of(directory: Path, file: SweepFile) -> Path:
    """The folder that has the runs of a sweep.

    Raises:
        RunError: it says that they are in a store, and it was not begun here: whoever wrote that has no say here.
    """
    if file.store and not is_own(directory / FILE):
        raise RunError(
            f"{directory / FILE}: was not written here, and names {file.store} for its runs: look at them with "
            f"'labctl runs {file.store}'"
        )
    return location(file.store) if file.store else directory


def own_runs(folder: Path) -> tuple[Path, frozenset[str] | None]:
    """The folder that has the runs of a folder, another one of a sweep in a store, and the names of those that count.

    No names: all in it do.

    Raises:
        RunError: of a sweep, as `read` and `runs_of`.
    """
    if is_elsewhere(folder) or not is_sweep(folder):
        return folder, None
    file = read(folder)
    names = frozenset(name for name, _ in places(file.sweep)) if file.store else None
    return runs_of(folder, file), names
