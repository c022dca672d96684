"""A run as named arrays with dimensions and units: what `labctl.open_run` shows and `labctl export` writes.

The dimensions are `shot` (the shots that are complete on all passes), `port` (in the order of `/frames`: a port that is
measured at several wavelengths stands there once for each), `time` (samples), `pass` and `drive_sample`. Nothing is
read before a variable is asked for its values, and of `frames` and `volts` only what is asked for.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.runs.format.shots import PLAN_COLUMNS
from labctl.runs.read.run import Run

Key = tuple[Any, ...]
"""For each dimension a slice of positive step or ascending positions; at most one of them positions."""

MEANINGS = {
    "shot": "place of the shot in the plan",
    "kind": "image, reference, dark, scene or sequence",
    "dataset_index": "index in the data set, -1 for none",
    "label": "class, -1 for none",
    "wavelength_nm": "laser wavelength of the shot, the first one where it is measured at several",
    "group": "shots of one image share a group: keep groups together when data are split",
    "next_dataset_index": "index in the data set of what a scene's image changes to, -1 for other shots",
    "next_label": "class of what a scene's image changes to, -1 for other shots",
    "epoch": "stretch of an unchanged optical path, on the pass that completed the shot",
    "time_s": "when the shot was completed, after the run began, on the bench's clock",
    "flags": "bit 0: clipped; bit 1: measured again after an instrument error",
    "port": "waveguide of the chip; 0 is the fibre before it",
    "wavelength_of_port": "laser wavelength at which the port was measured, 0 where the run does not say",
    "pass_of_port": "pass that measured the port",
    "scale": "volts = scale * code + offset",
    "offset": "volts = scale * code + offset",
    "time": "time after the trigger",
    "frames": "digitiser codes: volts = scale * code + offset",
    "volts": "signal: scale * code + offset",
    "trigger_offset_s": "time from the trigger to the sample grid",
    "clipped": "whether the frame touches the end of the digitiser's range",
    "epoch_of_pass": "stretch of an unchanged optical path, on each pass",
    "measured_at_s": "when the shot was measured on each pass, after the run began, on the bench's clock",
    "drive": "one period of what the AWG played, full scale -1 to 1",
    "drive_marker": "marker of the AWG at each sample of the drive",
}
UNITS = {
    "wavelength_nm": "nm",
    "wavelength_of_port": "nm",
    "time_s": "s",
    "scale": "V",
    "offset": "V",
    "time": "s",
    "volts": "V",
    "trigger_offset_s": "s",
    "measured_at_s": "s",
}
OF_A_SHOT = ("epoch", "time_s", "flags")
"""Columns that are known when the shot is measured, and not before."""


@dataclass(frozen=True)
class Variable:
    """An array of a run that is read as far as it is asked for.

    Attributes:
        name: what it is called.
        dims: a name for each dimension.
        shape: its size.
        dtype: type of its values; text is `U`.
        read: the values at a `Key`; dimensions stay, also those of length 1.
        coordinate: it says where values are rather than what was measured.
        attributes: further facts, beside units and meaning.
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    read: Callable[[Key], NDArray[Any]]
    coordinate: bool = False
    attributes: Mapping[str, object] = field(default_factory=dict)

    @property
    def described(self) -> dict[str, object]:
        """The attributes, with `units` where it has one and `long_name`."""
        units = {"units": UNITS[self.name]} if self.name in UNITS else {}
        return {**units, "long_name": MEANINGS[self.name], **self.attributes}


def variables_of(run: Run) -> tuple[Variable, ...]:
    """Every array of a run, coordinates first.

    Raises:
        RunError: a shard or the data file is damaged; the variables may raise it too when they are read.
    """
    frames = run.frames.shape
    shots, ports, _ = frames
    planned, shape = run.planned, run.shape
    trace = ("shot", "port", "time")
    passes = np.repeat(np.arange(len(shape.passes)), [len(ports) for ports in shape.passes])
    variables = [
        _kept("shot", ("shot",), planned["index"], coordinate=True),
        *(_kept(name, ("shot",), planned[name], coordinate=True) for name in PLAN_COLUMNS[1:]),
        *(_column(run, name, ("shot",), (shots,), planned.dtype[name], coordinate=True) for name in OF_A_SHOT),
        _kept("port", ("port",), np.asarray(run.ports, np.int64), coordinate=True),
        _kept("wavelength_of_port", ("port",), np.asarray(shape.wavelength_of_port), coordinate=True),
        _kept("pass_of_port", ("port",), passes, coordinate=True),
        _kept("scale", ("port",), run.scale, coordinate=True),
        _kept("offset", ("port",), run.offset, coordinate=True),
        _kept("time", ("time",), run.time, coordinate=True),
        Variable("frames", trace, frames, shape.dtype, lambda key: np.asarray(run.frames[key])),
        Variable("volts", trace, frames, np.dtype(np.float64), lambda key: volts(run, key)),
        _column(run, "trigger_offset_s", ("shot", "port"), (shots, ports), np.dtype(np.float64)),
        _column(run, "clipped", ("shot", "port"), (shots, ports), np.dtype(np.bool_)),
        _column(run, "epoch_of_pass", ("shot", "pass"), (shots, len(shape.passes)), np.dtype(np.int32)),
        _column(run, "measured_at_s", ("shot", "pass"), (shots, len(shape.passes)), np.dtype(np.float64)),
    ]
    if run.drive is not None:
        rate = {"sample_rate": run.drive.sample_rate, "sample_rate_units": "S/s"}
        variables += [
            _kept("drive", ("drive_sample",), run.drive.samples, attributes=rate),
            _kept("drive_marker", ("drive_sample",), run.drive.marker, attributes=rate),
        ]
    return tuple(variables)


def volts(run: Run, key: Key) -> NDArray[np.float64]:
    """The signal in V at a `Key` of `frames`."""
    codes: NDArray[Any] = run.frames[key]
    return np.asarray(run.scale[key[1]][:, np.newaxis] * codes + run.offset[key[1]][:, np.newaxis])


def _kept(
    name: str,
    dims: tuple[str, ...],
    values: NDArray[Any],
    *,
    coordinate: bool = False,
    attributes: Mapping[str, object] | None = None,
) -> Variable:
    """A variable whose values are in memory: those that are small and cost nothing to have."""
    return Variable(name, dims, values.shape, values.dtype, lambda key: values[key], coordinate, attributes or {})


def _column(
    run: Run,
    name: str,
    dims: tuple[str, ...],
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    *,
    coordinate: bool = False,
) -> Variable:
    """A column of the run that is read as a whole when it is first asked for."""

    def read(key: Key) -> NDArray[Any]:
        if name in OF_A_SHOT:
            return np.asarray(run.shots[name][key])
        return np.asarray(getattr(run, "epoch" if name == "epoch_of_pass" else name)[key])

    return Variable(name, dims, shape, dtype, read, coordinate)
