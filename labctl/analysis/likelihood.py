"""Largest likelihood of traces that are Gaussian about zero, each with a brightness of its own."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from labctl.analysis.errors import AnalysisError

IMPOSSIBLE = 1e12
MOST_EVALUATIONS = 3000
APART = 0.3
"""From which the curvature is read, in the parameters' steps."""
KNOWN = 10.0
"""How well a parameter is known beforehand, one standard deviation in its steps: where the traces do not tell."""

Model = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Covariance (k, k) of traces of unit brightness, from the parameters."""


def largest_likelihood(
    traces: NDArray[np.float64],
    model: Model,
    start: NDArray[np.float64],
    steps: NDArray[np.float64],
    *,
    noise: NDArray[np.float64] | float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Parameters (p,), their covariance (p, p), and minus the logarithm of the likelihood.

    The covariance is the inverse of the likelihood's curvature at its maximum (Cramer-Rao).

    Args:
        traces: (n, k), independent of each other.
        model: Their covariance.
        start: Where the search begins.
        steps: About how far each parameter may be off there.
        noise: Variance of the white noise in each trace beyond what `model` has, in parts of its brightness, (n,).

    Raises:
        AnalysisError: The traces do not tell every parameter.
    """

    def cost(moved: NDArray[np.float64]) -> float:
        return float(_costs(model(start + steps * moved), traces, noise).sum()) + float(moved @ moved) / (2 * KNOWN**2)

    size = start.size
    found = minimize(
        cost,
        np.zeros(size),
        method="Nelder-Mead",
        options={
            "initial_simplex": np.vstack([np.zeros(size), 2 * np.eye(size)]),
            "maxfev": MOST_EVALUATIONS,
            "xatol": 0.02,
            "fatol": 1e-3,
            "adaptive": True,
        },
    )
    best = np.asarray(found.x)
    curvature = np.empty((size, size))
    unit = APART * np.eye(size)
    for row in range(size):
        for column in range(row, size):
            one, other = unit[row], unit[column]
            apart = cost(best + one + other) - cost(best + one - other) - cost(best - one + other)
            curvature[row, column] = curvature[column, row] = (apart + cost(best - one - other)) / (4 * APART**2)
    try:
        covariance = np.linalg.inv(curvature)
        if not np.all(np.diagonal(covariance) > 0):
            raise np.linalg.LinAlgError
    except np.linalg.LinAlgError:
        raise AnalysisError("these traces do not tell every parameter: show more images, average more") from None
    return start + steps * best, covariance * np.outer(steps, steps), float(found.fun)


def _costs(
    covariance: NDArray[np.float64], traces: NDArray[np.float64], noise: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """Minus the logarithm of each trace's likelihood, its brightness at its own best, (n,)."""
    count, size = traces.shape
    try:
        variances, directions = np.linalg.eigh(covariance)
    except np.linalg.LinAlgError:
        return np.full(count, IMPOSSIBLE)
    spread = variances + np.broadcast_to(noise, count)[:, np.newaxis]
    if not np.all(spread > 0):
        return np.full(count, IMPOSSIBLE)
    squares = np.sum((traces @ directions) ** 2 / spread, axis=1)
    found: NDArray[np.float64] = np.log(spread).sum(axis=1) / 2 + size / 2 * np.log(squares)
    return found
