"""Long records made fit for drawing: a figure of a thousand points across shows no more than that."""

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def reduced(x: ArrayLike, y: ArrayLike, *, bins: int = 1000) -> tuple[NDArray[Any], NDArray[Any]]:
    """A record (n,) thinned to the first, the last, and the lowest and highest point of each of `bins` stretches.

    Every peak stays. Records of at most 2 `bins` points come back as they are.
    """
    x, y = np.asarray(x), np.asarray(y)
    if y.size <= 2 * bins:
        return x, y
    kept = [0, y.size - 1]
    for first, last in pairwise(np.linspace(0, y.size, bins + 1).astype(int)):
        kept += [first + int(np.argmin(y[first:last])), first + int(np.argmax(y[first:last]))]
    positions = np.unique(kept)
    return x[positions], y[positions]


def envelope(x: ArrayLike, y: ArrayLike, *, bins: int = 400) -> NDArray[np.float64]:
    """Position, lowest, median and highest value of each of `bins` stretches, (4, bins); (4, n) for shorter series."""
    x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
    if y.size <= bins:
        return np.stack([x, y, y, y])
    edges = np.linspace(0, y.size, bins + 1).astype(int)
    stretches = [slice(first, last) for first, last in pairwise(edges)]
    return np.array([(x[s].mean(), y[s].min(), np.median(y[s]), y[s].max()) for s in stretches]).T


def volt_scale(volts: ArrayLike) -> tuple[float, str]:
    """Factor and unit in which signals (V) read well: V, or mV below 0.1 V."""
    return (1.0, "V") if float(np.nanmax(np.abs(volts))) >= 0.1 else (1e3, "mV")
