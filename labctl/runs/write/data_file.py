"""data.h5: all complete shots of a run as one plain HDF5 file, made once from the shards.

    /frames            (shot, port, sample)  codes; chunks of about 1 MB, each of whole shots
    /scale  /offset    (port,)               volts = scale * code + offset
    /ports  /pass_of_port  (port,)           which port, and the pass that measured it
    /wavelength_of_port    (port,)           nm, 0 where the run does not say
    /shots             (shot,)               compound: index, kind, dataset_index, label, wavelength_nm, group and,
                                             of the pass that completed the shot, epoch and time_s; flags of all passes
    /trigger_offset_s  /clipped  (shot, port)
    /epoch  /measured_at_s       (shot, pass)
    /time              (sample,)             s, relative to the trigger
    /drive                                   samples, marker; attribute sample_rate in S/s
    attributes: format_version, manifest (JSON), complete, shots_planned, evidence

It holds the shots that are complete on all passes and no others. That of an interrupted run therefore has fewer shots
than planned, tells them apart by `/shots.index` and has `complete` false; the shards stay, and when the run is resumed
and ends, data.h5 is made again. The axes are HDF5 dimension scales, so that xarray knows them.
"""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

from instruments.values import Frames
from labctl.runs.format.durable import replacing
from labctl.runs.format.hdf5_target import Hdf5Target
from labctl.runs.format.journal import Entry
from labctl.runs.format.layout import FORMAT_VERSION, HDF5_ERRORS, LIBVER, Manifest, RunPaths
from labctl.runs.format.plan import write_drive
from labctl.runs.format.shards import Shard, Shards
from labctl.runs.format.shots import SHOTS_DTYPE, PlayedDrive, RunShape

AXES = {
    "frames": ("shot", "port", "sample"),
    "trigger_offset_s": ("shot", "port"),
    "clipped": ("shot", "port"),
    "epoch": ("shot", "pass"),
    "measured_at_s": ("shot", "pass"),
    "shots": ("shot",),
}
UNITS = {
    "trigger_offset_s": "s",
    "measured_at_s": "s",
    "time": "s",
    "scale": "V",
    "offset": "V",
    "wavelength_of_port": "nm",
}


def write_data_file(
    shards: Shards, manifest: Manifest, drive: PlayedDrive | None, *, compression: str | None = None
) -> int:
    """Write data.h5 from `shards` and fsync it; returns the number of shots in it.

    Without a single complete shot there is no data.h5. `compression` is h5py's ("gzip", "lzf").

    Raises:
        RunError: a shard is missing or damaged (an existing data.h5 is then left alone), or the disk is full.
    """
    count = len(shards.complete)
    if not count:
        return 0
    path = shards.paths.data
    with replacing(path) as raw:
        target = Hdf5Target(raw)
        try:
            with h5py.File(target, "w", libver=LIBVER) as file:
                _create(file, shards, count, compression)
                _describe(file, shards, manifest, drive, complete=count == shards.shape.shots)
                for start, block in shards.blocks():
                    for name, values in block.items():
                        file[name][start : start + len(values)] = values
                    target.check()
        except HDF5_ERRORS:
            target.check()
            raise
        target.check()
    return count


def shard_in_data_file(file: h5py.File, shards: Shards, entry: Entry) -> bytes:
    """The shard that the journal's `entry` names, made again from data.h5.

    Its bytes are those of the shard wherever their sha256 is the entry's; they are of no use where it is not.

    Raises:
        KeyError: data.h5 has not all of its shots.
    """
    index, shape = file["shots"]["index"], shards.shape
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
    epoch = file["epoch"][rows, entry.pass_index]
    scale, offset = file["scale"][ports], file["offset"][ports]
    return Shard.of(entry.pass_index, entry.first, frames, epoch, scale, offset).encode(shape)


def data_file_headers(shape: RunShape) -> int:
    """Bytes of data.h5 beside what it holds of each shot and the manifest; frames and drive are as short as can be."""
    shape = replace(shape, shots=1, samples=1)
    drive = PlayedDrive(np.zeros(0, np.float32), np.zeros(0, np.bool_), 1.0)
    nothing = Shards(RunPaths(Path()), shape, np.zeros(1, SHOTS_DTYPE), ())
    with h5py.File("data", "w", driver="core", backing_store=False, libver=LIBVER) as file:
        _create(file, nothing, 1, None)  # HDF5 gives a data set its place when it is written to
        _describe(file, nothing, Manifest({}), drive, complete=False)
        file.flush()
        return len(file.id.get_file_image())


def _create(file: h5py.File, shards: Shards, count: int, compression: str | None) -> None:
    shape = shards.shape
    rows, ports, passes = min(count, shards.rows_per_block), len(shape.ports), len(shape.passes)
    file.create_dataset(
        "frames",
        (count, ports, shape.samples),
        shape.dtype,
        chunks=(rows, ports, shape.samples),
        compression=compression,
    )
    file.create_dataset("trigger_offset_s", (count, ports), "<f8")
    file.create_dataset("clipped", (count, ports), np.bool_)
    file.create_dataset("epoch", (count, passes), "<i4")
    file.create_dataset("measured_at_s", (count, passes), "<f8")
    file.create_dataset("shots", (count,), SHOTS_DTYPE)


def _describe(
    file: h5py.File, shards: Shards, manifest: Manifest, drive: PlayedDrive | None, *, complete: bool
) -> None:
    shape = shards.shape
    scale, offset = shards.all_scales()
    scales = {
        "shot": file.create_dataset("shot", data=shards.complete),
        "port": file.create_dataset("ports", data=np.asarray(shape.ports, "<i8")),
        "sample": file.create_dataset("time", data=shape.time),
        "pass": file.create_dataset("passes", data=np.arange(len(shape.passes), dtype="<i8")),
    }
    for axis, dataset in scales.items():
        dataset.make_scale(axis)
    file.create_dataset("scale", data=scale)
    file.create_dataset("offset", data=offset)
    file.create_dataset(
        "pass_of_port", data=np.repeat(np.arange(len(shape.passes)), [len(ports) for ports in shape.passes])
    )
    file.create_dataset("wavelength_of_port", data=np.asarray(shape.wavelength_of_port, "<f8"))
    by_port = dict.fromkeys(("scale", "offset", "pass_of_port", "wavelength_of_port"), ("port",))
    for name, axes in (AXES | by_port).items():
        for dimension, axis in zip(file[name].dims, axes, strict=True):
            dimension.label = axis
            dimension.attach_scale(scales[axis])
    for name, unit in UNITS.items():
        file[name].attrs["units"] = unit
    write_drive(file, drive)
    file.attrs["format_version"] = FORMAT_VERSION
    file.attrs["manifest"] = json.dumps(dict(manifest.values))
    file.attrs["complete"] = complete
    file.attrs["shots_planned"] = np.int64(shape.shots)
    file.attrs["evidence"] = shards.evidence
