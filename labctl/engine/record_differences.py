"""What records differ by: mean squares of their samples, times the noise, and what is usual among such differences."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

SIGMAS_OF_MEDIAN_DEVIATION = 1.4826
"""Standard deviation of what is normal, in median deviations."""


def part_of(lit: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.float64]:
    """How much of how records with light vary from sample to sample other ones hold: 1 if all, 0 if nothing."""
    lit, other = (values - values.mean(axis=2, keepdims=True) for values in (lit, other))
    varies = np.maximum(np.einsum("nij,nij->n", lit, lit), 1e-9)
    return np.asarray(np.einsum("nij,nij->n", lit, other) / varies, np.float64)


def variation(values: NDArray[np.float32]) -> NDArray[np.float64]:
    """By how much records vary from sample to sample, in the mean of their channels; one photon makes no difference."""
    return np.asarray(np.abs(values - np.median(values, axis=-1, keepdims=True)).mean(axis=(-1, -2)), np.float64)


def mean_squares(values: NDArray[np.float32]) -> NDArray[np.float64]:
    """Mean squares of the samples of each channel."""
    return np.asarray(np.einsum("...ij,...ij->...i", values, values) / values.shape[-1], np.float64)


def times_noise(squares: NDArray[np.float64], noise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rms over the channels of records, each by its own noise."""
    return np.asarray(np.sqrt(mean(squares / noise**2)), np.float64)


def median_and_scatter(values: Sequence[float]) -> tuple[float, float]:
    """Of values with some far off: the standard deviation as the median deviation has it."""
    median = quantile(values, 0.5)
    return median, SIGMAS_OF_MEDIAN_DEVIATION * quantile(np.abs(np.subtract(values, median)), 0.5)


def mean(values: NDArray[Any]) -> NDArray[Any]:
    """`np.mean` along the last axis, in a third of its time where values are few, as those of one record."""
    return np.asarray(np.add.reduce(values, axis=-1) / values.shape[-1])


def quantile(values: ArrayLike, part: float) -> float:
    """`np.quantile` of numbers in a row, in a tenth of its time where they are few."""
    ordered = np.sort(values)
    place = part * (ordered.size - 1)
    below = int(place)
    low, high = ordered[below], ordered[min(below + 1, ordered.size - 1)]
    return float(low + (place - below) * (high - low))


def rms(squares: NDArray[np.float64]) -> float:
    """Over channels and samples of a record, in codes."""
    return math.sqrt(squares.mean())
