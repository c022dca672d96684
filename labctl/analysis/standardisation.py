"""The units in which features are standardised."""

import numpy as np
from numpy.typing import NDArray


def units(deviation: NDArray[np.float64], level: NDArray[np.floating], shots: int) -> NDArray[np.float64]:
    """Standard deviations of features, 1 where a feature cannot be told from a constant one.

    Computed from equal values a deviation need not be exactly zero: what rounding may leave of it counts as that, by
    the bound of scikit-learn's `StandardScaler` (Chan, Golub & LeVeque, The American Statistician 37, 242, 1983).

    Args:
        deviation: (..., features) over the shots.
        level: (..., features) their mean; any one value does as well, since where it decides all are alike.
        shots: Over how many.
    """
    variance, eps = deviation**2, np.finfo(np.float64).eps
    constant = variance <= shots * eps * variance + (shots * eps * level) ** 2
    return np.where(constant, 1.0, deviation)
