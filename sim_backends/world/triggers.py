"""Edges of a periodic signal: where the oscilloscope's trigger may fire."""

import numpy as np
from numpy.typing import NDArray


def marker_edges(marker: NDArray[np.bool_], *, rising: bool) -> NDArray[np.float64]:
    """Positions (in samples, 0 <= p < n) at which a periodic marker rises or falls."""
    before = np.roll(marker, 1)
    return np.flatnonzero(marker & ~before if rising else before & ~marker).astype(np.float64)


def level_crossings(volts: NDArray[np.float32], level: float, *, rising: bool) -> NDArray[np.float64]:
    """Positions (in grid points, 0 <= p < n) at which a periodic trace crosses `level`, interpolated linearly."""
    here = volts.astype(np.float64) if rising else -volts.astype(np.float64)
    level = level if rising else -level
    following = np.roll(here, -1)
    index = np.flatnonzero((here < level) & (following >= level))
    return np.asarray(index + (level - here[index]) / (following[index] - here[index]))
