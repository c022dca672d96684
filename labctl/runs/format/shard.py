"""A shard: the file that holds some shots of one pass.

It is a small HDF5 file built in memory, so that it reaches the disk in one write and its sha256 is known without
reading it back. It carries no times of writing: the same shots give the same bytes. Inside:

    /frames            (shot, port, sample)  digitiser codes
    /trigger_offset_s  (shot, port)          s
    /clipped           (shot, port)
    /rows              (shot,)               compound: shot, and the columns of /shots that are measured
    /scale  /offset    (port,)               volts = scale * code + offset
    attributes: format_version, pass, first, ports
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d
from numpy.typing import ArrayLike, NDArray

from instruments.values import Frames
from labctl.errors import RunError
from labctl.runs.format.columns import ROWS_DTYPE, ShotFlag, in_this_version
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS, LIBVER, attribute, check_plain, set_text, stored_array, walked
from labctl.runs.format.shape import RunShape
from labctl.runs.format.version import FORMAT_VERSION, check_version

MOST_BYTES = 1 << 30  # of one shard, as a file and unpacked: a burst of 1000 shots, 14 ports, 2500 samples has 35 MB

MOST_KEPT = 1 << 20
"""Bytes of codes of a shard that an empty one is kept for."""


def encode(
    shape: RunShape,
    pass_index: int,
    first: int,
    parts: Sequence[Frames],
    epoch: ArrayLike,
    scale: NDArray[np.float64],
    offset: NDArray[np.float64],
    version: str = FORMAT_VERSION,
) -> memoryview:
    """The bytes of the shard of the shots of a pass from `first` on; their codes are copied once.

    `parts` follow one another, times in s since the run began. `epoch` is one for all shots or one each. Formats from
    1.2 on differ in nothing but the `version` that a shard names.
    """
    ports = shape.passes[pass_index]
    clipped = np.concatenate([part.clipped for part in parts], dtype=np.bool_)
    rows = np.zeros(len(clipped), ROWS_DTYPE)
    rows["shot"] = first + np.arange(rows.size)
    rows["time_s"] = np.concatenate([part.time_s for part in parts])
    rows["epoch"] = epoch
    rows["flags"] = np.where(clipped.any(axis=1), int(ShotFlag.CLIPPED), 0)
    codes = rows.size * len(ports) * shape.samples * shape.dtype.itemsize
    image, places = (_from_kept if codes <= MOST_KEPT else _empty)(shape, pass_index, rows.size, version)
    with h5py.File(image, "r+", libver=LIBVER) as file:
        h5a.open(file.id, b"first").write(np.array(first, np.int64))
    content = image.getbuffer()
    np.concatenate([part.codes for part in parts], out=_codes(content, places["frames"], rows.size, len(ports), shape))
    for name, values in {
        "trigger_offset_s": np.concatenate([part.trigger_offset_s for part in parts], dtype="<f8"),
        "clipped": clipped,
        "rows": rows,
        "scale": np.asarray(scale, "<f8"),
        "offset": np.asarray(offset, "<f8"),
    }.items():
        content[places[name] : places[name] + values.nbytes] = values.tobytes()
    return content


def _empty(shape: RunShape, pass_index: int, shots: int, version: str) -> tuple[BytesIO, dict[str, int]]:
    """A shard whose arrays are still zero, and where in its bytes each of them begins."""
    ports, image = shape.passes[pass_index], BytesIO()
    with h5py.File(image, "w", libver=LIBVER) as file:
        size = shots, len(ports)
        file.create_dataset("frames", (*size, shape.samples), shape.dtype, dcpl=_in_place())
        file.create_dataset("trigger_offset_s", data=np.zeros(size, "<f8"))
        file.create_dataset("clipped", data=np.zeros(size, np.bool_))
        file.create_dataset("rows", data=np.zeros(shots, ROWS_DTYPE))
        file.create_dataset("scale", data=np.zeros(len(ports), "<f8"))
        file.create_dataset("offset", data=np.zeros(len(ports), "<f8"))
        places = {name: data.id.get_offset() for name, data in file.items()}
        set_text(file, "format_version", version)
        attributes = file.attrs  # making it costs as much as an attribute
        attributes["pass"] = np.int64(pass_index)
        attributes["first"] = np.int64(0)
        attributes["ports"] = np.asarray(ports, "<i8")
    return image, places


@lru_cache(maxsize=16)
def _kept(shape: RunShape, pass_index: int, shots: int, version: str) -> tuple[bytes, dict[str, int]]:
    """`_empty`, which takes HDF5 milliseconds: the next shard of the run is the same but for its numbers."""
    image, places = _empty(shape, pass_index, shots, version)
    return image.getvalue(), places


def _from_kept(shape: RunShape, pass_index: int, shots: int, version: str) -> tuple[BytesIO, dict[str, int]]:
    image, places = _kept(shape, pass_index, shots, version)
    return BytesIO(image), places


@dataclass(frozen=True)
class Shard:
    """What is in a shard; shapes as in the module's description."""

    pass_index: int
    first: int
    scale: NDArray[np.float64]
    offset: NDArray[np.float64]
    frames: NDArray[Any]
    trigger_offset_s: NDArray[np.float64]
    clipped: NDArray[np.bool_]
    rows: NDArray[Any]

    @classmethod
    def decode(cls, image: bytes, shape: RunShape, origin: str) -> "Shard":
        """What `encode` put into `image`, whose codes are not copied; `origin` names the file in messages.

        Raises:
            RunError: not a whole shard, or not one of a run of this shape.
        """
        try:
            with walked(image) as file:
                check_version(attribute(file, "format_version"), Path(origin))
                check_plain(file, MOST_BYTES)
                pass_index, first = int(attribute(file, "pass")), int(attribute(file, "first"))
                if not 0 <= pass_index < len(shape.passes):
                    raise RunError(f"{origin}: pass {pass_index} is not one of this run")
                ports = len(shape.passes[pass_index])
                rows = in_this_version(stored_array(file, "rows"), ROWS_DTYPE)
                expected = {
                    "frames": (shape.dtype, (rows.size, ports, shape.samples)),
                    "trigger_offset_s": (np.dtype("<f8"), (rows.size, ports)),
                    "clipped": (np.dtype(np.bool_), (rows.size, ports)),
                    "scale": (np.dtype("<f8"), (ports,)),
                    "offset": (np.dtype("<f8"), (ports,)),
                }
                frames = h5d.open(file.id, b"frames")
                arrays = {name: stored_array(file, name) for name in expected if name != "frames"}
                for name, (kind, size) in expected.items():
                    stored = arrays.get(name, frames)
                    if stored.dtype != kind or stored.shape != size:
                        raise RunError(f"{origin}: {name} are not of this run's shape")
                codes = _codes(image, frames.get_offset(), rows.size, ports, shape)
                shard = cls(pass_index, first, frames=codes, rows=rows, **arrays)
        except HDF5_ERRORS as error:
            raise RunError(f"{origin}: damaged shard ({error})") from error
        last = first + rows.size
        if not 0 <= first < last <= shape.shots or rows["shot"].tolist() != list(range(first, last)):
            raise RunError(f"{origin}: its shots are not a range of this run's")
        return shard


def _in_place() -> h5py.h5p.PropDCID:
    """Of a data set that has its place in the file from the beginning, and nothing in it."""
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    properties.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    return properties


def _codes(image: bytes | memoryview, place: int | None, shots: int, ports: int, shape: RunShape) -> NDArray[Any]:
    """The codes at their place in a shard, (shots, ports, samples).

    Raises:
        ValueError: they do not lie there in one piece.
    """
    if place is None:
        raise ValueError("its frames do not lie in one piece")
    codes = np.frombuffer(image, shape.dtype, shots * ports * shape.samples, place)
    return codes.reshape(shots, ports, shape.samples)
