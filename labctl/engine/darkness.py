"""What dark records tell of a bench: its codes without light, and how much of what records differ by is noise."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from labctl.engine.record_differences import mean, mean_squares, times_noise

LEAST_NOISE = 0.5
"""Codes that quantisation alone makes two records differ by."""
SURE = 2.5
"""Standard deviations by which two records of one picture may differ more than noise has it."""


class Known(NamedTuple):
    """The record of a shot, shape (channels, samples)."""

    shot: int
    values: NDArray[Any]


class Darkness:
    """The last dark record of a pass, and the noise as it and the ones before tell it.

    Attributes:
        record: the last one; None as long as there is none.
        level: its mean code in each channel.
        noise: of the difference of two dark records, in each channel: what they differ by, or what each of them varies
            by, whichever is less.
        most_noise: the same, whichever is more.
        least_noise: the least of `most_noise` that there was: a stray photon makes a record noisier.
    """

    def __init__(self) -> None:
        """None yet."""
        self.record: Known | None = None
        self.level: NDArray[Any] | float = 0.0
        self.noise = self.most_noise = np.ones(1)
        self.least_noise = np.full(1, np.inf)

    def take(self, record: Known) -> NDArray[np.float64] | None:
        """Hold a record as the last one; mean squares of what it differs by from the one before, if there was one."""
        before, self.record = self.record, record
        self.level = mean(record.values)
        return None if before is None else mean_squares(record.values - before.values)

    def learn(self, record: Known, pair: NDArray[np.float64] | None) -> None:
        """The noise of a record that was taken and differs from the one before by `pair`."""
        varies = 2 * record.values.var(axis=1, dtype=np.float64)
        pair = varies if pair is None else pair
        self.noise = np.sqrt(np.maximum(np.minimum(pair, varies), LEAST_NOISE**2))
        self.most_noise = np.sqrt(np.maximum(np.maximum(pair, varies), LEAST_NOISE**2))
        self.least_noise = np.minimum(self.least_noise, self.most_noise)

    def forget(self, first: int) -> None:
        """The last record is of a shot from `first` on, which will be measured again; what is noise remains."""
        if self.record is not None and self.record.shot >= first:
            self.record, self.level = None, 0.0

    def times_from(self, values: NDArray[np.float32]) -> float:
        """So many times the noise that a record differs from the last dark one; nan where there was none."""
        if self.record is None:
            return math.nan
        return float(times_noise(mean_squares(values - self.record.values), self.most_noise))

    def holds(self, values: NDArray[np.float32]) -> bool:
        """Whether a record is dark, within noise; False where there was no dark one."""
        return within_noise(self.times_from(values), values.size)


def within_noise(times: float, size: int) -> bool:
    """Whether two records of `size` values that differ by so many times the noise may be of one picture."""
    return times <= 1 + SURE / math.sqrt(size)
