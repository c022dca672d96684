"""What a readout is trained on, from a run: volts on the grid that starts at the trigger, labels, groups."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from labctl.errors import AnalysisError
from labctl.runs.read.run import Run, volts

KERNEL_HALF_WIDTH = 16
KERNEL_SHAPE = 8.0
BLOCK_SAMPLES = 1 << 20
"""So many are moved at a time: what is in memory besides the records does not grow with their number."""
GRID_TOLERANCE = 0.01
"""A trigger offset may exceed a sample by this part of it: it is never exact."""


@dataclass(frozen=True)
class Records:
    """The shots of one kind, in the order of the plan; some may have been measured again later.

    traces: (shots, ports, samples) V, at the times of the run's `time`. labels, groups: (shots,). ports: waveguide of
    each entry of the second axis. sample_interval_s: s. indices: (shots,) place of each shot in the run. time_s:
    (shots,) when each was completed, s after the run began.
    """

    traces: NDArray[np.floating]
    labels: NDArray[np.int64]
    groups: NDArray[np.int64]
    ports: tuple[int, ...]
    sample_interval_s: float
    indices: NDArray[np.int64]
    time_s: NDArray[np.float64]


def read_records(run: Run, kind: str = "image", *, most: int | None = None) -> Records:
    """The shots of `kind` of a run, "image", "reference" or "dark"; of more than `most` so many, evenly spread.

    The run is read block by block: nothing grows with it but the records.

    Raises:
        AnalysisError: the run holds none.
    """
    shots: NDArray[Any] = run.shots
    chosen = np.flatnonzero(shots["kind"] == kind)
    if not chosen.size:
        raise AnalysisError(f"{run.path}: holds no {kind} shots: acquire some first")
    if most is not None and chosen.size > most:
        chosen = chosen[np.linspace(0, chosen.size - 1, most).round().astype(np.intp)]
    interval = run.shape.sample_interval_s
    frames, (ports, samples) = run.frames, run.frames.shape[1:]
    traces = np.empty((chosen.size, ports, samples), np.float32)
    step = max(1, BLOCK_SAMPLES // max(1, ports * samples))
    for first in range(int(chosen[0]), len(frames), step):
        begin, end = np.searchsorted(chosen, (first, first + step))
        if begin == end:
            continue
        some = chosen[begin:end]
        codes = frames[int(some[0]) : int(some[-1]) + 1]
        moved = volts(codes[some - some[0]], run.scale, run.offset)
        traces[begin:end] = resample(moved, run.trigger_offset_s[some], sample_interval_s=interval)
    return Records(
        traces=traces,
        labels=shots["label"][chosen].astype(np.int64),
        groups=shots["group"][chosen].astype(np.int64),
        ports=run.ports,
        sample_interval_s=interval,
        indices=chosen,
        time_s=shots["time_s"][chosen].astype(np.float64),
    )


def resample(frames: NDArray[Any], trigger_offset_s: ArrayLike, *, sample_interval_s: float) -> NDArray[np.floating]:
    """Records on a grid that the trigger fixes: sample k at k * sample_interval_s, whatever the phase was.

    The oscilloscope reports for each record the time between the trigger and its sampling grid; sample k was taken at
    k * sample_interval_s + offset. Band-limited interpolation by a Kaiser-windowed sinc of 33 taps, good up to 0.8 of
    the Nyquist frequency and normalised so that a constant stays a constant. Beyond the ends the record is continued by
    point reflection, so within 16 samples of an end the accuracy is that of the continuation.
    A window that is cut afterwards holds a little of the light behind its end.
    Source: Oppenheim & Schafer, Discrete-Time Signal Processing, ch. 4 and 7.

    Args:
        frames: (shots, ports, samples), codes or volts.
        trigger_offset_s: (shots,) or (shots, ports), s, at most one sample interval either way.
        sample_interval_s: s.

    Returns:
        (shots, ports, samples), float64 for float64 frames and else float32. Records without offset are copied exactly.

    Raises:
        AnalysisError: The shapes do not fit, or an offset exceeds one sample.
    """
    records = np.asarray(frames)
    shots, ports, samples = records.shape
    offsets = np.asarray(trigger_offset_s, np.float64)
    if offsets.shape not in {(shots,), (shots, ports)}:
        raise AnalysisError(
            f"trigger offsets have shape {offsets.shape}, frames {records.shape}: give one for each shot, or for each "
            "shot and port"
        )
    shifts = np.broadcast_to(offsets.reshape(shots, -1) / sample_interval_s, (shots, ports))
    if not np.all(np.abs(shifts) <= 1 + GRID_TOLERANCE):
        raise AnalysisError(
            f"a trigger offset of {np.max(np.abs(offsets)):g} s is more than one sample of {sample_interval_s:g} s: "
            "cut the record at whole samples first"
        )
    result: NDArray[np.floating] = records.astype(np.float64 if records.dtype == np.float64 else np.float32)
    step = max(1, BLOCK_SAMPLES // max(1, ports * samples))
    for first in range(0, shots, step):
        block = slice(first, first + step)
        moved = shifts[block] != 0
        if moved.any():
            result[block][moved] = _moved(result[block][moved], shifts[block][moved])
    return result


def _moved(rows: NDArray[np.floating], shifts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows (n, samples), each by its own part of a sample."""
    half = min(KERNEL_HALF_WIDTH, rows.shape[1] - 1)
    exact = rows.astype(np.float64)
    padded = np.pad(exact, ((0, 0), (half, half)), mode="reflect", reflect_type="odd") if half else exact
    taps = np.arange(-half, half + 1)
    distance = taps + shifts[:, np.newaxis]
    taper = np.i0(KERNEL_SHAPE * np.sqrt(np.clip(1 - (distance / (half + 1)) ** 2, 0, None)))
    kernel = np.sinc(distance) * taper
    kernel /= kernel.sum(axis=1, keepdims=True)
    moved: NDArray[np.float64] = np.einsum("rnk,rk->rn", sliding_window_view(padded, taps.size, axis=1), kernel)
    return moved
