"""zarr, a folder of compressed chunks, in the version of the format that every reader knows (2), named for xarray."""

import logging
from pathlib import Path
from typing import Any

import zarr

from labctl.runs.export.content import Content


def _of_use(record: logging.LogRecord) -> bool:
    # zarr puts several files at once and raises the first failure; of the others asyncio would print tracebacks
    return not record.getMessage().startswith("Future exception was never retrieved")


logging.getLogger("asyncio").addFilter(_of_use)


def write(content: Content, path: Path) -> None:
    """Write all of `content` to the folder `path`.

    Raises:
        OSError: there is no room.
        RunError: the run is damaged.
    """
    group = zarr.open_group(path, mode="w", zarr_format=2)
    for variable in content.variables:
        shape = content.shape(variable)
        attributes: dict[str, Any] = {"_ARRAY_DIMENSIONS": list(variable.dims), **variable.described}
        array = group.create_array(
            variable.name,
            shape=shape,
            chunks=(content.rows(variable), *shape[1:]) if "shot" in variable.dims else shape,
            dtype=variable.dtype,
            fill_value=None,  # readers take a value here for "missing", and 0 is a code like any other
            attributes=attributes,
        )
        for start, block in content.blocks(variable):
            array[start : start + len(block)] = block
    dimensions = content.sizes
    coordinates = [one.name for one in content.variables if one.coordinate and one.name not in dimensions]
    group.attrs.update({**content.attributes, "coordinates": " ".join(coordinates)})
    zarr.consolidate_metadata(group.store)
