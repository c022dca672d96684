"""Several runs, such as those of a sweep, as one xarray Dataset that reads what is looked at; the extra `data`."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends.common import BackendArray
from xarray.core import indexing

from labctl.errors import RunError
from labctl.runs.read.as_xarray import coordinates_of
from labctl.runs.read.run import Run, open_run
from labctl.runs.read.variables import Key, Variable, variables_of

SHARED = ("time", "port", "pass", "shot")
"""Coordinates that all runs have in common, as far as each reaches."""


def dataset_of_runs(paths: Sequence[Path]) -> xr.Dataset:
    """See `labctl.open_runs`."""
    with ExitStack() as stack:
        runs = [stack.enter_context(open_run(path)) for path in paths]
        of_each = [{one.name: one for one in variables_of(run)} for run in runs]
        names = [name for name in of_each[0] if all(_dims(each, name) == of_each[0][name].dims for each in of_each)]
        data: dict[str, xr.Variable] = {}
        coordinates: dict[str, Any] = {"run": [path.name for path in paths]}
        for name in names:
            one = of_each[0][name]
            if name in SHARED:
                coordinates[name] = _shared(name, of_each, paths)
                continue
            stacked = _Stacked([each[name] for each in of_each])
            variable = xr.Variable(("run", *one.dims), indexing.LazilyIndexedArray(stacked), one.described)
            (coordinates if one.coordinate else data)[name] = variable
        dataset = xr.Dataset(data, coordinates | _on_axes(runs, coordinates.keys() | data.keys()))
        dataset.set_close(stack.pop_all().close)
    return dataset


def _dims(variables: dict[str, Variable], name: str) -> tuple[str, ...] | None:
    return variables[name].dims if name in variables else None


def _shared(name: str, of_each: Sequence[dict[str, Variable]], paths: Sequence[Path]) -> xr.Variable:
    """The longest of a coordinate that all runs have in common; RunError where they do not.

    Of runs whose frames begin at different times after the trigger, such as single shots and bursts, times count from
    the first sample.
    """
    values = [each[name].read((slice(None),)) for each in of_each]
    described = of_each[0][name].described
    if name == "time" and len({float(found[0]) for found in values}) > 1:
        values = [found - found[0] for found in values]
        described |= {"long_name": "time after the frame's first sample"}
    longest = max(values, key=len)
    for found, path in zip(values, paths, strict=True):
        if not np.allclose(found, longest[: len(found)], rtol=1e-6, atol=0):
            raise RunError(f"{path}: its {name} coordinate is not that of the other runs: open it with labctl.open_run")
    return xr.Variable((name,), longest, described)


def _on_axes(runs: Sequence[Run], taken: set[str]) -> dict[str, tuple[str, NDArray[Any]]]:
    """Where each run lies on the axes that all of them have, and when it began and whether it is whole."""
    places = [coordinates_of(run) for run in runs]
    axes = [name for name in places[0] if name not in taken and all(name in place for place in places)]
    found = {name: ("run", np.array([place[name] for place in places])) for name in axes}
    found["started"] = ("run", np.array([str(run.manifest.get("started", "")) for run in runs]))
    found["complete"] = ("run", np.array([run.complete for run in runs]))
    return found


class _Stacked(BackendArray):
    """A variable of each run on a first dimension; what a shorter run does not have is not a number, or empty text."""

    def __init__(self, variables: Sequence[Variable]) -> None:
        self._variables = variables
        sizes = [one.shape for one in variables]
        self.shape = (len(sizes), *(max(size) for size in zip(*sizes, strict=True)))
        self.dtype = np.result_type(*(one.dtype for one in variables))
        if any(size != sizes[0] for size in sizes) and self.dtype.kind in "iub":
            self.dtype = np.result_type(self.dtype, np.float32)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> NDArray[Any]:
        found: NDArray[Any] = indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.OUTER_1VECTOR, self._read
        )
        return found

    def _read(self, key: tuple[Any, ...]) -> NDArray[Any]:
        single = [isinstance(one, int | np.integer) for one in key]
        stretches = tuple(slice(one, one + 1) if alone else one for one, alone in zip(key, single, strict=True))
        chosen = np.arange(self.shape[0])[stretches[0]]
        lengths = [len(np.arange(size)[one]) for size, one in zip(self.shape[1:], stretches[1:], strict=True)]
        nothing: Any = np.nan if self.dtype.kind == "f" else np.zeros((), self.dtype)
        found = np.full((chosen.size, *lengths), nothing, self.dtype)
        for place, number in enumerate(chosen):
            part = self._variables[number]
            within = _within(stretches[1:], part.shape)
            values = part.read(within)
            there: tuple[Any, ...] = (place, *(slice(size) for size in values.shape))
            found[there] = values
        return found[tuple(0 if alone else slice(None) for alone in single)]


def _within(key: Key, shape: tuple[int, ...]) -> Key:
    """What of a key an array of `shape` has: positions ascend, so that it is their beginning."""
    return tuple(
        slice(*one.indices(size)) if isinstance(one, slice) else one[one < size]
        for one, size in zip(key, shape, strict=True)
    )
