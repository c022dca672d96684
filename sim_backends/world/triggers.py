"""When the oscilloscope's trigger fires: edges of a periodic signal, and the order they come in."""

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


def upcoming(
    phases: NDArray[np.float64], period: float, *, after: float, count: int, holdoff: float
) -> NDArray[np.float64]:
    """The next `count` times of events that happen at `phases` of every period.

    Args:
        phases: at least one, s, sorted, within the period.
        period: s.
        after: the first time is at or after this (s).
        count: how many.
        holdoff: each time is at least this much later than the one before (s).
    """
    slack = 1e-6 * period  # rounding of a large virtual time must not lose an event
    if phases.size == 1:
        first = np.ceil((after - slack - phases[0]) / period)
        every = max(1.0, np.ceil((holdoff - slack) / period))
        return np.asarray((first + every * np.arange(count)) * period + phases[0])
    times = np.empty(count)
    earliest = after - slack
    for number in range(count):
        cycle = np.floor(earliest / period)
        candidates = ((cycle + np.arange(2))[:, None] * period + phases).ravel()
        times[number] = candidates[np.searchsorted(candidates, earliest)]
        earliest = times[number] + max(holdoff - slack, slack)
    return times
