"""Whether signals are worth learning from: how the digitiser's range is used, and how a bench drifts over a run."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

BINS = 256


@dataclass(frozen=True)
class CodeCounts:
    """How often each digitiser code occurs.

    Attributes:
        first_code: (BINS,) the first code of each bin; bins hold one code of int8, 256 of int16.
        counts: (ports, BINS).
    """

    first_code: NDArray[np.int64]
    counts: NDArray[np.int64]

    @property
    def used(self) -> NDArray[np.float64]:
        """(ports,) part of the digitiser's range between the lowest and the highest code that occurs; 0 for none."""
        occurs = self.counts > 0
        lowest, highest = occurs.argmax(axis=1), BINS - 1 - occurs[:, ::-1].argmax(axis=1)
        return np.where(occurs.any(axis=1), (highest - lowest + 1) / BINS, 0.0)

    def with_more(self, codes: NDArray[np.integer]) -> "CodeCounts":
        """With the codes (shots, ports, samples) of further shots."""
        low, width = _bins(codes.dtype)
        places = (codes.astype(np.int32) - low) // width
        more = np.stack([np.bincount(places[:, port].ravel(), minlength=BINS) for port in range(codes.shape[1])])
        return CodeCounts(self.first_code, self.counts + more)


def no_codes(ports: int, code_type: np.dtype[Any]) -> CodeCounts:
    """The counts of `ports` ports before the first shot; `code_type` is int8 or int16."""
    low, width = _bins(code_type)
    return CodeCounts(low + width * np.arange(BINS), np.zeros((ports, BINS), np.int64))


def _bins(code_type: np.dtype[Any]) -> tuple[int, int]:
    """Lowest code, and codes in a bin."""
    limits = np.iinfo(code_type)
    return int(limits.min), (int(limits.max) - int(limits.min) + 1) // BINS


@dataclass(frozen=True)
class Drift:
    """How the records of one picture change over a run.

    Attributes:
        level: (shots, ports) mean of each record, in the records' unit.
        correlation: (shots, ports) with the first record, 1 = same shape; NaN where a record is constant.
    """

    level: NDArray[np.float64]
    correlation: NDArray[np.float64]


def drift(records: ArrayLike) -> Drift:
    """Drift of records (shots, ports, samples) of one picture, in the order they were measured.

    The correlation is Pearson's over the samples of a port. Noise lowers it by as much from the first record on, a
    drift by more and more.
    """
    values = np.asarray(records, np.float64)
    level = values.mean(axis=2)
    around = values - level[..., np.newaxis]
    size = np.sqrt((around**2).sum(axis=2))
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = (around * around[:1]).sum(axis=2) / (size * size[:1])
    return Drift(level, correlation)
