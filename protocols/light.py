"""Is there light at all? Found out from the probe shots, before anything is recorded.

Light follows the drive: probes have a course in time in common, whatever they show, and noise has none (one-way
analysis of variance; groups are samples, repetitions are probes). Where few photons hide it, their level is held
against that of dark frames.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.errors import InstrumentError
from instruments.values import Frames

FEWEST_PROBES, FEWEST_SAMPLES = 24, 3
"""Fewer probes of pictures that are not alike may have little in common: then only the comparison of records with dark
ones finds that there is no light."""
DARK_FRAMES = 16
LEAST_SCATTER = 0.05
"""Codes: of levels that a coarse range shows always the same."""
SURE = 5.0
"""Standard deviations of what noise alone gives: a channel of ten samples exceeds that once in two thousand cases. 40
probes of ten samples show light of a third of the noise."""


Codes = NDArray[np.integer] | NDArray[np.floating]


def in_common(codes: Codes) -> NDArray[np.float64]:
    """How much more probes have in common than noise, shape (channels,): 1 for noise alone.

    The variance between samples by that between probes at a sample (F), both of codes less their probe's mean.

    Args:
        codes: (probes, channels, samples), two probes and two samples at least.
    """
    probes, _, samples = codes.shape
    course = np.asarray(codes - codes.mean(axis=2, keepdims=True), np.float64)
    mean = course.mean(axis=0)
    common = probes * np.square(mean).sum(axis=1) / (samples - 1)
    other = np.square(course - mean).sum(axis=(0, 2)) / ((probes - 1) * (samples - 1))
    times = np.where(common > 0, math.inf, 1.0)
    np.divide(common, other, out=times, where=other > 0)
    return times


def brighter(codes: Codes, dark: Codes) -> NDArray[np.float64]:
    """How far the level of probes is from that of dark frames, shape (channels,), in standard deviations by the latter.

    Args:
        codes: (probes, channels, samples).
        dark: (frames, channels, samples), in the same vertical ranges.
    """
    levels, resting = codes.mean(axis=2), dark.mean(axis=2)
    scatter = resting.std(axis=0, ddof=1) * math.sqrt(1 / len(codes) + 1 / len(dark))
    apart: NDArray[np.float64] = np.abs(levels.mean(axis=0) - resting.mean(axis=0)) / np.maximum(scatter, LEAST_SCATTER)
    return apart


def require_light(bench: Bench, probes: Sequence[Frames], dark: Callable[[], Frames] | None) -> None:
    """See that light reaches the oscilloscope; `bench`'s observer is warned of a channel that gets none.

    Few probes or samples say nothing. dark: takes a frame without light, where that can be.

    Raises:
        InstrumentError: no channel gets any.
    """
    codes = np.concatenate([frames.codes for frames in probes])
    count, _, samples = codes.shape
    if count < FEWEST_PROBES or samples < FEWEST_SAMPLES:
        return
    lit = in_common(codes) > 1 + SURE * math.sqrt(2 / (samples - 1))
    if not lit.any() and dark is not None:
        lit = brighter(codes, np.concatenate([dark().codes for _ in range(DARK_FRAMES)])) > SURE
    if not lit.any():
        raise InstrumentError(
            f"bench: no light: {count} probes show nothing but noise: see that the laser emits, its shutter is open, "
            f"the drive runs, the DMD shows images and all fibres are in"
        )
    for channel in np.array(list(bench.scope.channels))[~lit]:
        bench.observer.warning(f"scope: CH{channel} has no light that can be told from noise: see its fibre")
