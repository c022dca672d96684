"""Where the runs of a sweep are: in its own folder, or in a store, where others may lie beside them."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from labctl.bench.own_files import is_own
from labctl.errors import RunError, WrongPlace
from labctl.runs.catalogue import AT_ONCE
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest
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


def begun(directory: Path, file: SweepFile) -> dict[str, dict[str, str]]:
    """Name and values on the axes of every run of a sweep that has begun, in the order they are measured.

    Raises:
        WrongPlace: its runs are in a store, and one of that name there is another sweep's.
        RunError: as `runs_of`.
    """
    runs = runs_of(directory, file)
    there = {name: values for name, values in places(file.sweep) if RunPaths(runs / name).manifest.exists()}
    if file.of_each:
        with ThreadPoolExecutor(AT_ONCE) as pool:
            list(pool.map(partial(_refuse_anothers, file), [runs / name for name in there]))
    return there


def _refuse_anothers(file: SweepFile, run: Path) -> None:
    from labctl.studies.run_tasks import other_than  # the engine takes long to load
    from labctl.studies.sweeps.declaration import varied

    try:
        then = Manifest.read(RunPaths(run)).values
    except RunError:  # whoever looks into it says what is wrong with it
        return
    if other := other_than(file.of_each, then, *varied(file.sweep)):
        raise WrongPlace(
            f"{run}: is of another sweep ({other}): look at it with 'labctl runs {file.store}', and begin this "
            "sweep anew with another --store"
        )


def own_runs(folder: Path) -> tuple[Path, frozenset[str] | None]:
    """The folder that has the runs of a folder, another one of a sweep in a store, and the names of those that count.

    No names: all in it do.

    Raises:
        RunError: of a sweep, as `read` and `begun`.
    """
    if is_elsewhere(folder) or not is_sweep(folder):
        return folder, None
    file = read(folder)
    return runs_of(folder, file), frozenset(begun(folder, file)) if file.store else None
