"""Largest likelihood: of traces that are Gaussian about zero, each with a brightness of its own, and of any model."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize

from labctl.errors import AnalysisError

IMPOSSIBLE = 1e12
MOST_EVALUATIONS = 3000
APART = 0.3
"""From which the curvature is read, in the parameters' steps."""
KNOWN = 10.0
"""How well a parameter is known beforehand, one standard deviation in its steps: where the traces do not tell."""

FIRST = 1e-2
LEAST_CURVATURE = 0.1
"""Of what hardly changes the likelihood, for the search: three of its standard deviations are one of the parameter."""
ROUNDS, MOVES = 3, 40
WIDER = 1.5
FARTHEST = 40
"""How often an end of an interval is looked for farther away."""

Cost = Callable[[NDArray[np.float64]], float]
"""Minus the logarithm of a likelihood, from the parameters; each of them of the order of 1."""

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


def lowest(cost: Cost, start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where a cost is lowest, near `start`: quasi-Newton (BFGS), each parameter in units that change it by one half.

    Those units differ by thousands here, and a search in others would not arrive.
    """
    best = start
    for _ in range(ROUNDS):
        origin, units = best, _units(cost, best)
        found = minimize(
            partial(_moved, cost, origin, units),
            np.zeros(best.size),
            method="BFGS",
            options={"gtol": 0.05, "eps": 1e-4, "maxiter": MOVES},
        )
        best = origin + units * found.x
        if found.nit < MOVES:
            break
    return best


def interval(cost: Cost, best: NDArray[np.float64], reach: float, least: float) -> tuple[float, float]:
    """Likelihood interval of the first parameter, `reach` standard deviations either way.

    Its ends are where the likelihood is lower than at its maximum by exp(-reach^2 / 2), the other parameters following
    as the curvature at the maximum has them follow; on a Gaussian likelihood that is `reach` standard deviations.
    Unlike those it is not symmetric where the parameter enters by its square (Cox & Hinkley, Theoretical Statistics,
    1974, 7.2). `least` is the lowest that the parameter can be.
    """
    curvature = _curvature(cost, best)
    way = np.concatenate([[1.0], -np.linalg.lstsq(curvature[1:, 1:], curvature[1:, 0])[0]])
    lowered = cost(best) + reach**2 / 2

    def above(apart: float) -> float:
        return cost(best + apart * way) - lowered

    deviation = 1 / math.sqrt(max(float(curvature[0] @ way), LEAST_CURVATURE))
    most = float(best[0]) - least
    tells = most > 0 and above(-most) > 0
    low = float(best[0] + brentq(above, -most, 0.0, xtol=0.01 * deviation)) if tells else least
    far = reach * deviation
    for _ in range(FARTHEST):
        if above(far) > 0:
            return low, float(best[0] + brentq(above, 0.0, far, xtol=0.01 * deviation))
        far *= WIDER
    return low, math.inf


def _moved(cost: Cost, origin: NDArray[np.float64], units: NDArray[np.float64], moved: NDArray[np.float64]) -> float:
    return cost(origin + units * moved)


def _units(cost: Cost, place: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far each parameter by itself goes to change the cost by one half."""
    here, units = cost(place), np.full(place.size, FIRST)
    for _ in range(2):
        ways = np.diag(units)
        bends = np.array([cost(place + way) + cost(place - way) - 2 * here for way in ways]) / units**2
        units = 1 / np.sqrt(np.maximum(np.abs(bends), LEAST_CURVATURE))
    return units


def _curvature(cost: Cost, place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Second derivatives of a cost, by differences over its units."""
    units = _units(cost, place)
    ways, here = np.diag(units), cost(place)
    found = np.empty((place.size, place.size))
    for row, one in enumerate(ways):
        found[row, row] = (cost(place + one) + cost(place - one) - 2 * here) / units[row] ** 2
        for column, other in enumerate(ways[:row]):
            apart = cost(place + one + other) - cost(place + one - other) - cost(place - one + other)
            bend = (apart + cost(place - one - other)) / (4 * units[row] * units[column])
            found[row, column] = found[column, row] = bend
    return found
