"""Multinomial logistic regression that takes few steps, however alike the features are."""

import warnings
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import fmin_l_bfgs_b
from scipy.special import softmax
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils.validation import check_is_fitted, validate_data

SHOTS_OF_CURVATURE = 10_000
"""The curvature is estimated from so many shots, evenly spread: it decides how fast the optimum is found, not which."""
LEAST_GAIN = 64.0
"""Relative gain of a step, in units of the machine's precision, below which the optimum is found; scikit-learn's."""
LINE_SEARCH = 50
"""Trials for the length of a step; scikit-learn's."""


class SoftmaxRegression(ClassifierMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn ships no types
    """y = softmax(W x + b), with the least mean cross-entropy + sum(W^2) / (2 C shots).

    Neighbouring samples of a trace are alike, so that curvatures differ by a factor of 10^4 and plain L-BFGS takes
    hundreds of steps over all shots. Here it works in coordinates in which no curvature exceeds one: the Hessian is at
    most half the second moments of the features, one block a class (Böhning, Ann. Inst. Stat. Math. 44, 197, 1992), and
    one Cholesky factor of these is all that is needed. Calculates in float32 on float32 features, else in float64.

    Args:
        C: Inverse of the penalty.
        tol: It ends where no element of the gradient, in those coordinates, exceeds this.
        max_iter: Most steps; if they do not suffice, a `ConvergenceWarning` says so.

    Attributes:
        classes_: (k,) class labels, ascending.
        coef_: (k, features) W.
        intercept_: (k,) b, without penalty.
        n_iter_: Steps taken.
    """

    def __init__(self, C: float = 1.0, tol: float = 1e-4, max_iter: int = 1000) -> None:  # noqa: N803  # as in scikit-learn
        self.C = C
        self.tol = tol
        self.max_iter = max_iter

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:  # noqa: N803
        """Find W and b for features (shots, features) and the class of each shot.

        Raises:
            ValueError: All shots are of one class, or a feature is not finite.
        """
        features, labels = validate_data(self, X, y, dtype=[np.float64, np.float32])
        self.classes_, members = np.unique(labels, return_inverse=True)
        if self.classes_.size < 2:
            raise ValueError("all shots are of one class: there is nothing to tell apart")
        shots, k = features.shape[0], self.classes_.size
        penalty = 1 / (self.C * shots)
        factor = _factor(features, penalty)
        rows = np.arange(shots)

        def objective(flat: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            weights = solve_triangular(factor, flat.reshape(-1, k), lower=True, trans=1)
            scores = features @ weights[:-1].astype(features.dtype)
            scores += weights[-1].astype(features.dtype)
            scores -= scores.max(axis=1, keepdims=True)
            own = scores[rows, members].mean(dtype=np.float64)
            np.exp(scores, out=scores)
            total = scores.sum(axis=1, keepdims=True)
            scores /= total
            scores[rows, members] -= 1
            slope = np.vstack([features.T @ scores, scores.sum(axis=0)]).astype(np.float64) / shots
            slope[:-1] += penalty * weights[:-1]
            entropy = np.log(total).mean(dtype=np.float64) - own
            loss = float(entropy + penalty / 2 * np.sum(weights[:-1] ** 2))
            return loss, solve_triangular(factor, slope, lower=True).ravel()

        start = np.zeros((features.shape[1] + 1) * k)
        best, _, report = fmin_l_bfgs_b(
            objective, start, factr=LEAST_GAIN, pgtol=self.tol, maxiter=self.max_iter, maxls=LINE_SEARCH
        )
        self.n_iter_ = int(report["nit"])
        if self.n_iter_ >= self.max_iter:
            message = f"{self.max_iter} steps did not find the optimum: allow more"
            warnings.warn(message, ConvergenceWarning, stacklevel=2)
        weights = solve_triangular(factor, best.reshape(-1, k), lower=True, trans=1)
        self.coef_ = np.ascontiguousarray(weights[:-1].T)
        self.intercept_ = weights[-1].copy()
        return self

    def decision_function(self, X: ArrayLike) -> NDArray[np.floating]:  # noqa: N803
        """W x + b (shots, k)."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=[np.float64, np.float32], reset=False)
        scores: NDArray[np.floating] = features @ self.coef_.T.astype(features.dtype)
        scores += self.intercept_.astype(features.dtype)
        return scores

    def predict_proba(self, X: ArrayLike) -> NDArray[np.floating]:  # noqa: N803
        """Probability (shots, k) of each class, in the order of `classes_`."""
        probability: NDArray[np.floating] = softmax(self.decision_function(X), axis=1)
        return probability

    def predict(self, X: ArrayLike) -> NDArray[Any]:  # noqa: N803
        """The most probable class (shots,)."""
        return np.asarray(self.classes_[np.argmax(self.decision_function(X), axis=1)])


def _factor(features: NDArray[np.floating], penalty: float) -> NDArray[np.float64]:
    """Lower Cholesky factor of what bounds the curvature of W and b, (features + 1, features + 1)."""
    some = features[:: -(-len(features) // SHOTS_OF_CURVATURE)].astype(np.float64)
    some = np.column_stack([some, np.ones(len(some))])
    bound = some.T @ some / (2 * len(some))
    bound[np.diag_indices(len(bound) - 1)] += penalty
    factor: NDArray[np.float64] = cholesky(bound, lower=True, overwrite_a=True)
    return factor
