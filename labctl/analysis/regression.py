"""Linear regression of values from features, and how far off it is."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.linear_model import RidgeCV
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from labctl.errors import AnalysisError

ALPHAS = tuple(10.0 ** (exponent / 2) for exponent in range(-8, 13))
"""Penalties to choose from, 1e-4 to 1e6 in half decades; one equal to the number of shots halves a lone feature."""


def ridge_readout(alphas: Sequence[float] = ALPHAS) -> Pipeline:
    """Ridge regression on standardised features, with a free bias: y = W x + b, penalty alpha sum(W^2).

    `fit` chooses alpha by the leave-one-out error inside the training set (in closed form, one decomposition for all
    of `alphas`), one alpha for all outputs. Targets may be (shots,) or (shots, outputs).
    """
    return make_pipeline(StandardScaler(), RidgeCV(alphas=list(alphas)))


def nmse(target: ArrayLike, predicted: ArrayLike) -> float:
    """Mean squared error over variance of the target: 0 is perfect, 1 is what predicting the mean reaches.

    Both of one shape; where they have several columns, errors and variances are summed over them.

    Raises:
        AnalysisError: The shapes differ, nothing is given, or the target is constant.

    Example:
        >>> from labctl.analysis.regression import nmse
        >>> nmse([1, 2, 3], [1, 2, 3]), nmse([1, 2, 3], [2, 2, 2])
        (0.0, 1.0)
    """
    wanted, found = _alike(target, predicted)
    variance = float(np.mean((wanted - wanted.mean(axis=0)) ** 2))
    if variance == 0:
        raise AnalysisError("the target is constant, so an error has nothing to be compared with: give one that varies")
    return float(np.mean((wanted - found) ** 2)) / variance


def rmse(images: ArrayLike, predicted: ArrayLike) -> float:
    """Root of the mean squared error over all pixels and images, in units of the pixels; both of one shape.

    Raises:
        AnalysisError: The shapes differ, or nothing is given.
    """
    wanted, found = _alike(images, predicted)
    return float(np.sqrt(np.mean((wanted - found) ** 2)))


def _alike(target: ArrayLike, predicted: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    wanted, found = np.asarray(target, np.float64), np.asarray(predicted, np.float64)
    if wanted.shape != found.shape or not wanted.size:
        raise AnalysisError(
            f"a target of shape {wanted.shape} and predictions of shape {found.shape} cannot be compared: give one "
            "prediction for each target"
        )
    return wanted, found
