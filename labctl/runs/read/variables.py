"""A run as named arrays with dimensions and units: what `labctl.open_run` shows and `labctl export` writes.

The dimensions are `shot` (the shots that are complete on all passes), `port` (in the order of `/frames`: a port that is
measured at several wavelengths appears once for each), `time` (samples), `pass` and `drive_sample`. Values are
read on demand, and of `frames` and `volts` only those that are needed.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.runs.format.columns import ARRAYS, MEASURED, OF_A_SHOT, PLANNED, SHOTS, Column, sizes_of
from labctl.runs.read.run import Run

Key = tuple[Any, ...]
"""For each dimension a slice of positive step or ascending positions; at most one of them positions."""

NAMES = {"ports": "port", "epoch": "epoch_of_pass", "drive/samples": "drive", "drive/marker": "drive_marker"}
"""Arrays that are not called as in data.h5: a coordinate has the name of its dimension, and none that of another."""
DIMENSIONS = {"sample": "time"}
"""Axes that are named by their coordinate."""


@dataclass(frozen=True)
class Variable:
    """An array of a run that is read as far as it is needed.

    Attributes:
        name: what it is called.
        dims: a name for each dimension.
        shape: its size.
        dtype: type of its values; text is `U`.
        read: the values at a `Key`; dimensions stay, also those of length 1.
        meaning: of its values, in a few words.
        unit: of its values, empty for none.
        coordinate: whether it describes the shots, ports and samples rather than what was measured.
        attributes: further facts, in addition to unit and meaning.
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    read: Callable[[Key], NDArray[Any]]
    meaning: str
    unit: str = ""
    coordinate: bool = False
    attributes: Mapping[str, object] = field(default_factory=dict)

    @property
    def described(self) -> dict[str, object]:
        """The attributes, with `units` where it has one and `long_name`."""
        units = {"units": self.unit} if self.unit else {}
        return {**units, "long_name": self.meaning, **self.attributes}


def variables_of(run: Run) -> tuple[Variable, ...]:
    """Every array of a run, coordinates first.

    Raises:
        RunError: a shard or the data file is damaged; the variables may raise it too when they are read.
    """
    arrays = {array.name: array for array in ARRAYS}
    planned, shape, frames = run.planned, run.shape, arrays["frames"]
    in_memory = {
        "ports": np.asarray(run.ports, np.int64),
        "wavelength_of_port": np.asarray(shape.wavelength_of_port),
        "pass_of_port": shape.pass_of_port,
        "scale": run.scale,
        "offset": run.offset,
        "time": run.time,
    }
    trace = _lazy(frames, run, shape.dtype, lambda key: np.asarray(run.frames[key]))
    variables = [
        _kept(arrays["shot"], planned["index"], coordinate=True),
        *(_kept(column, planned[column.name], coordinate=True) for column in PLANNED[1:]),
        *(_of_a_shot(column, run, planned.dtype[column.name]) for column in MEASURED),
        *(_kept(arrays[name], values, coordinate=True) for name, values in in_memory.items()),
        trace,
        replace(
            trace,
            name="volts",
            dtype=np.dtype(np.float64),
            read=run.volts,
            meaning="signal: scale * code + offset",
            unit="V",
        ),
        *(_of_a_frame(array, run) for array in OF_A_SHOT if array is not frames),
    ]
    if run.drive is not None:
        drive = run.drive
        about: dict[str, object] = {"name": drive.name, "sample_rate": drive.sample_rate, "sample_rate_units": "S/s"}
        if math.isfinite(drive.amplitude_vpp):  # runs before 1.2 do not have it
            about["amplitude_vpp"] = drive.amplitude_vpp
        variables += [
            _kept(arrays["drive/samples"], drive.samples, attributes=about),
            _kept(arrays["drive/marker"], drive.marker, attributes=about),
        ]
    return tuple(variables)


def _kept(
    column: Column,
    values: NDArray[Any],
    *,
    coordinate: bool = False,
    attributes: Mapping[str, object] | None = None,
) -> Variable:
    """A variable whose values are in memory: those that are small and cost nothing to have."""
    return Variable(
        _name(column),
        _dims(column),
        values.shape,
        values.dtype,
        lambda key: values[key],
        column.meaning,
        column.unit,
        coordinate,
        attributes or {},
    )


def _of_a_shot(column: Column, run: Run, dtype: np.dtype[Any]) -> Variable:
    """A measured column of `/shots`, read as a whole when it is first needed."""
    return replace(_lazy(column, run, dtype, lambda key: np.asarray(run.shots[column.name][key])), coordinate=True)


def _of_a_frame(array: Column, run: Run) -> Variable:
    """An array other than the frames, read as a whole when it is first needed."""
    return _lazy(array, run, np.dtype(array.type), lambda key: np.asarray(getattr(run, array.name)[key]))


def _lazy(column: Column, run: Run, dtype: np.dtype[Any], read: Callable[[Key], NDArray[Any]]) -> Variable:
    sizes = sizes_of(run.shape, len(run.frames))
    shape = tuple(sizes[axis] for axis in column.axes)
    return Variable(_name(column), _dims(column), shape, dtype, read, column.meaning, column.unit)


def _name(column: Column) -> str:
    return column.name if column in SHOTS else NAMES.get(column.name, column.name)


def _dims(column: Column) -> tuple[str, ...]:
    return tuple(DIMENSIONS.get(axis, axis) for axis in column.axes)
