"""labctl: runs a photonic machine-vision bench, real or simulated, from images in to accuracy out."""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import xarray

    from labctl.interface import bench, evaluate, live_trace, run, runs, sweep, train
else:
    from labctl import bench, runs

__all__ = ["bench", "evaluate", "live_trace", "open_run", "open_runs", "run", "runs", "sweep", "train"]

_OF_INTERFACE = frozenset(__all__) - {"open_run", "open_runs"}


def __getattr__(name: str) -> Any:
    """What of the public interface needs packages that `import labctl` alone does not load."""
    if name in _OF_INTERFACE:
        return getattr(import_module("labctl.interface"), name)
    raise AttributeError(f"module 'labctl' has no attribute {name!r}")


class _PackageAndFunction(ModuleType):
    """A package whose name is also that of a function: `labctl.bench(...)` beside `labctl.bench.station`."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        function = getattr(import_module("labctl.interface"), self.__name__.rpartition(".")[2])
        return function(*arguments, **named)


for _name in ("bench", "runs"):
    sys.modules[f"labctl.{_name}"].__class__ = _PackageAndFunction


def open_run(path: "Path | str") -> "xarray.Dataset":
    """A run, finished or still going on, as an xarray Dataset that reads nothing before it is looked at.

    Dimensions are shot, port, time (s after the trigger; of sequences, after their frame's first sample), pass and
    drive_sample. `frames` are digitiser codes and `volts` the signal in V, both (shot, port, time); the coordinates say
    what shots and ports are, and the manifest in the attribute `manifest`, as JSON. A run that is going on is shown as
    it is now. Close the dataset, or use it as a context manager. Needs the extra `data`.

    Args:
        path: A run directory, or a data.h5 by itself; or the URL of either, such as `s3://bucket/lab/run`.

    Raises:
        labctl.errors.RunError: Not a run, or damaged, or a package is not installed; says what to do.
        labctl.runs.format.store.Unreachable: The store of a URL does not answer.

    Example:
        >>> from labctl import open_run
        >>> with open_run("runs/mine") as run:
        ...     run.volts.sel(port=3, time=slice(0, 0.4e-9)).shape
        (220, 11)
    """
    _require_xarray(path)
    from labctl.runs.read.as_xarray import dataset_of

    return dataset_of(path)


def open_runs(runs: "Path | str | Sequence[Path | str]") -> "xarray.Dataset":
    """Several runs as one xarray Dataset with a first dimension `run`, which reads nothing before it is looked at.

    Of the runs of a sweep, what was varied is a coordinate of `run`, in SI units: `window`, `power`. A shorter record
    ends in values that are not numbers. Close the dataset, or use it as a context manager. Needs the extra `data`.

    Args:
        runs: The folder of a sweep or of any runs that have ports and sampling in common, or run directories; or
            their URLs.

    Raises:
        labctl.errors.RunError: No runs, one of them damaged, or of other ports; says what to do.

    Example:
        >>> from labctl import open_runs
        >>> with open_runs(["runs/mine", "runs/mine"]) as both:
        ...     both.volts.sel(port=3, time=slice(0, 0.4e-9)).shape
        (2, 220, 11)
    """
    from pathlib import Path

    from labctl.errors import RunError
    from labctl.runs.format.store import location
    from labctl.runs.index import run_directories

    if isinstance(runs, str | Path):
        folder, only = import_module("labctl.studies.sweeps.run_folder").own_runs(location(runs))
        paths = [path for path in run_directories(folder) if only is None or path.name in only]
    else:
        paths = [location(one) for one in runs]
    if not paths:
        raise RunError(f"{runs}: holds no runs: name a folder that 'labctl sweep' or 'labctl run' made")
    _require_xarray(paths[0])
    from labctl.runs.read.several_as_xarray import dataset_of_runs

    return dataset_of_runs(paths)


def _require_xarray(path: "Path | str") -> None:
    from labctl.errors import RunError

    try:
        import_module("xarray")
    except ModuleNotFoundError:
        raise RunError(
            f'{path}: needs xarray to be opened: pip install "photonic-labctl[data]", or read its data.h5 with h5py'
        ) from None
