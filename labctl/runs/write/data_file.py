"""data.h5: all complete shots of a run as one plain HDF5 file, made once from the shards.

`labctl.runs.format.columns` lists what is in it: the table `/shots`, and arrays with their units and meanings as
attributes; `/shots` has those of its columns. `/frames` is in chunks of about 1 MB, each of whole shots.
The axes are HDF5 dimension scales, so that xarray knows them. Attributes of the file: format_version, manifest (JSON),
complete, shots_planned, evidence.

It holds the shots that are complete on all passes and no others. That of an interrupted run therefore has fewer shots
than planned, identifies them by `/shots.index` and has `complete` false; the shards stay, and when the run is resumed
and ends, data.h5 is made again.
"""

import hashlib
import json
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike

from instruments.values import Drive, Frames
from labctl.runs.format.columns import ARRAYS, OF_A_SHOT, SHOTS, SHOTS_DTYPE, sizes_of
from labctl.runs.format.durable import replacement
from labctl.runs.format.hdf5_target import Hdf5Target
from labctl.runs.format.journal import Entry
from labctl.runs.format.manifest import Manifest
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS, LIBVER, attribute, check_plain, set_text, walked
from labctl.runs.format.plan import write_drive
from labctl.runs.format.shape import RunShape
from labctl.runs.format.shard import encode
from labctl.runs.format.shards import NAMES, Shards
from labctl.runs.format.version import FORMAT_VERSION
from labctl.runs.read.data_file import MOST_BYTES, damaged

SCALES = {"shot": "shot", "port": "ports", "sample": "time", "pass": "passes"}
"""The data set with the coordinates of each axis."""


def write_data_file(shards: Shards, manifest: Manifest, drive: Drive | None, *, compression: str | None = None) -> int:
    """Write data.h5 from `shards` and fsync it; returns the number of shots in it.

    Without a single complete shot there is no data.h5. `compression` is h5py's ("gzip", "lzf").

    Raises:
        RunError: a shard is missing or damaged (an existing data.h5 is then left alone), or the disk is full.
    """
    count = len(shards.complete)
    if not count:
        return 0
    with replacement(shards.paths.data) as raw:
        target = Hdf5Target(raw)
        try:
            with h5py.File(target, "w", libver=LIBVER) as file:
                _create(file, shards, count, compression)
                write_drive(file, drive)
                for name, dimension, axis in attached():
                    file[name].dims[dimension].attach_scale(file[SCALES[axis]])
                set_text(file, "manifest", json.dumps(dict(manifest.values)))
                for owner, attributes in attributes_in(file, shards).items():
                    described = file[owner]
                    for name, value in attributes.items():
                        if isinstance(value, str):
                            set_text(described, name, value)
                        else:
                            described.attrs[name] = value
                arrays = {name: file[name] for name in NAMES}
                for start, block in shards.blocks():
                    for name, values in block.items():
                        arrays[name][start : start + len(values)] = values
                    target.check()
        except HDF5_ERRORS:
            target.check()
            raise
        target.check()
    return count


def constants(shards: Shards) -> dict[str, ArrayLike]:
    """The arrays of data.h5 that do not grow with the shots, but for the drive."""
    shape = shards.shape
    scale, offset = shards.all_scales()
    return {
        "ports": shape.ports,
        "pass_of_port": shape.pass_of_port,
        "wavelength_of_port": shape.wavelength_of_port,
        "scale": scale,
        "offset": offset,
        "time": shape.time,
        "passes": range(len(shape.passes)),
    }


def attributes_in(file: h5py.File, shards: Shards) -> dict[str, dict[str, Any]]:
    """By owner the attributes of a data.h5 but for those of the drive, the axes and the manifest.

    Each array has its unit and its meaning, `/shots` those of its columns, and the file says what it was made of.
    """
    found: dict[str, dict[str, Any]] = {
        f"/{array.name}": {"long_name": array.meaning} | ({"units": array.unit} if array.unit else {})
        for array in ARRAYS
        if array.name in file
    }
    found["/shots"] = {column.name: column.meaning for column in SHOTS}
    found["/shots"] |= {f"{column.name}_units": column.unit for column in SHOTS if column.unit}
    found["/"] = {
        "format_version": FORMAT_VERSION,
        "evidence": shards.evidence,
        "complete": shards.completed == shards.shape.shots,
        "suspect": np.int64(len(shards.complete) - shards.completed),
        "shots_planned": np.int64(shards.shape.shots),
    }
    return found


def attached() -> Iterator[tuple[str, int, str]]:
    """Which dimension of which data set lies on which of the axes that have coordinates."""
    for name, axes in {"shots": ("shot",), **{array.name: array.axes for array in ARRAYS}}.items():
        for dimension, axis in enumerate(axes):
            if axis in SCALES and name != SCALES[axis]:
                yield name, dimension, axis


def shard_in_data_file(shards: Shards, entry: Entry) -> memoryview | None:
    """The bytes of the shard that the journal's `entry` names, made again from data.h5; None where it has others.

    Raises:
        RunError: data.h5 cannot be read, whatever is in it.
    """
    try:
        with walked(shards.paths.data) as file:
            check_plain(file, MOST_BYTES, besides="frames")
            image = _shard_in(file, shards.shape, entry)
    except FileNotFoundError:
        return None
    except HDF5_ERRORS as error:
        if isinstance(error, OSError) and error.errno:
            raise damaged(shards.paths.data, error) from error
        return None
    return image if hashlib.sha256(image).hexdigest() == entry.sha256 else None


def _shard_in(file: h5py.File, shape: RunShape, entry: Entry) -> memoryview:
    """A shard made of the shots in data.h5.

    Raises:
        KeyError: data.h5 has not all of its shots.
    """
    index = file["shots"]["index"]
    places = np.flatnonzero((index >= entry.first) & (index < entry.first + entry.count))
    if len(places) != entry.count:
        raise KeyError(f"shots of shard {entry.shard}")
    rows, ports = slice(int(places[0]), int(places[-1]) + 1), shape.columns(entry.pass_index)
    frames = Frames(
        file["frames"][rows, ports],
        file["trigger_offset_s"][rows, ports],
        file["measured_at_s"][rows, entry.pass_index],
        file["clipped"][rows, ports],
    )
    epoch, version = file["epoch"][rows, entry.pass_index], attribute(file, "format_version")
    scale, offset = file["scale"][ports], file["offset"][ports]
    return encode(shape, entry.pass_index, entry.first, [frames], epoch, scale, offset, version)


def _create(file: h5py.File, shards: Shards, count: int, compression: str | None) -> None:
    sizes, types = sizes_of(shards.shape, count), {array.name: array.type for array in ARRAYS}
    for array in OF_A_SHOT:
        shape = tuple(sizes[axis] for axis in array.axes)
        options: dict[str, Any] = {}
        if array.name == "frames":
            options = {"chunks": (min(count, shards.rows_per_block), *shape[1:]), "compression": compression}
        file.create_dataset(array.name, shape, array.type or shards.shape.dtype, **options)
    file.create_dataset("shots", (count,), SHOTS_DTYPE)
    for name, values in (constants(shards) | {"shot": shards.complete}).items():
        file.create_dataset(name, data=np.asarray(values, types[name]))
    for axis, name in SCALES.items():
        file[name].make_scale(axis)
