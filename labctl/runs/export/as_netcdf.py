"""netCDF-4, for xarray and every netCDF tool: coordinates, units and long names; the manifest is a global attribute."""

from io import FileIO
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
from numpy.typing import NDArray

from labctl.runs.export.content import Content
from labctl.runs.format.hdf5_target import Hdf5Target
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS


def write(content: Content, path: Path) -> None:
    """Write all of `content` to the file `path`.

    Raises:
        OSError: there is no room.
        RunError: the run is damaged.
    """
    with FileIO(path, "w+") as raw:
        target = Hdf5Target(raw)
        try:
            with h5netcdf.File(target, "w") as file:
                _write(content, file, target)
        except HDF5_ERRORS:
            target.check()
            raise
        target.check()


def _write(content: Content, file: Any, target: Hdf5Target) -> None:
    file.dimensions = content.sizes
    for variable in content.variables:
        shape = content.shape(variable)
        made = file.create_variable(
            variable.name,
            variable.dims,
            h5py.string_dtype() if variable.dtype.kind == "U" else _plain(variable.dtype),
            chunks=(content.rows(variable), *shape[1:]) if len(shape) > 1 else None,
        )
        for name, value in variable.described.items():
            made.attrs[name] = value
        if variable.dtype == np.bool_:
            made.attrs["dtype"] = "bool"  # netCDF has none; xarray makes it one again
        for start, block in content.blocks(variable):
            made[start : start + len(block)] = _stored(block)
            target.check()
    for name, value in content.attributes.items():
        file.attrs[name] = value if isinstance(value, str) else np.int64(value)
    dimensions = content.sizes
    file.attrs["coordinates"] = " ".join(
        one.name for one in content.variables if one.coordinate and one.name not in dimensions
    )


def _plain(dtype: np.dtype[Any]) -> np.dtype[Any]:
    return np.dtype(np.int8) if dtype == np.bool_ else dtype


def _stored(block: NDArray[Any]) -> NDArray[Any]:
    return block.astype(object) if block.dtype.kind == "U" else block.astype(_plain(block.dtype), copy=False)
