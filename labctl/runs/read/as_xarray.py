"""A run as an xarray Dataset that reads what is computed or looked at, and nothing before; the extra `data`."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends.common import BackendArray
from xarray.core import indexing

from labctl.runs.read.run import Run, open_run
from labctl.runs.read.variables import Variable, variables_of


def dataset_of(path: Path | str) -> xr.Dataset:
    """See `labctl.open_run`."""
    run = open_run(path)
    try:
        variables = variables_of(run)
        data = {
            one.name: xr.Variable(one.dims, indexing.LazilyIndexedArray(_OnDemand(one)), one.described)
            for one in variables
        }
        dataset = xr.Dataset(
            {one.name: data[one.name] for one in variables if not one.coordinate},
            {one.name: data[one.name] for one in variables if one.coordinate}
            | {name: value for name, value in coordinates_of(run).items() if name not in data},
            {
                "run": str(path),
                "format_version": str(run.manifest["format_version"]),
                "manifest": json.dumps(run.manifest),
                "complete": int(run.complete),
                "shots_planned": run.shape.shots,
            },
        )
    except BaseException:
        run.close()
        raise
    dataset.set_close(run.close)
    return dataset


def coordinates_of(run: Run) -> dict[str, float | str]:
    """Where a run lies on the axes of its sweep; nothing of any other run, or where a stranger's manifest says else."""
    found = run.manifest.get("coordinates")
    if not isinstance(found, dict):
        return {}
    return {name: value for name, value in found.items() if isinstance(value, float | str)}


class _OnDemand(BackendArray):
    """The values of a variable, as xarray requests them."""

    def __init__(self, variable: Variable) -> None:
        self._variable = variable
        self.shape = variable.shape
        self.dtype = variable.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> NDArray[Any]:
        found: NDArray[Any] = indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.OUTER_1VECTOR, self._read
        )
        return found

    def _read(self, key: tuple[Any, ...]) -> NDArray[Any]:
        """Single positions are read as stretches of length 1, so that the order of the dimensions is never in doubt."""
        single = [isinstance(one, int | np.integer) for one in key]
        stretches = tuple(slice(one, one + 1) if alone else one for one, alone in zip(key, single, strict=True))
        return self._variable.read(stretches)[tuple(0 if alone else slice(None) for alone in single)]
