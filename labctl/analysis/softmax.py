"""Multinomial logistic regression in few steps, however alike the features are, of many training parts at once."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import fmin_l_bfgs_b
from scipy.special import softmax
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils.validation import check_is_fitted, validate_data

from labctl.analysis.splits import Split
from labctl.analysis.standardisation import units

SHOTS_OF_CURVATURE = 10_000
"""The curvature is estimated from so many shots, evenly spread: it decides how fast the optimum is found, not which."""
LEAST_GAIN = 64.0
"""Relative gain of a step, in units of the machine's precision, below which the optimum is found; scikit-learn's."""
LINE_SEARCH = 50
"""Trials for the length of a step; scikit-learn's."""
BLOCK_SCORES = 1 << 17
"""So many scores are calculated at a time, which a processor's cache holds: memory does not grow with the shots."""
BLOCK_FEATURES = 16
"""So many are looked at in double precision at a time: all of many shots would take more memory than their records."""
WIDER = 1.5
"""Features so many times as many as shots, and the root of the number of parts, cost less part by part: `_of_wide`."""
TOLERANCE = 1e-4
"""It ends where no element of the gradient exceeds this, in coordinates in which no curvature exceeds one."""
MOST_STEPS = 1000


class SoftmaxRegression(ClassifierMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn ships no types
    """y = softmax(W x + b), with the least mean cross-entropy + sum(W^2) / (2 C shots).

    Calculates in float32 on float32 features, else in float64; always in that where C exceeds one: weights are large
    then, and the loss is small. `_optimum` says how.

    Args:
        C: Inverse of the penalty.
        tol: It ends where no element of the gradient exceeds this, in coordinates in which no curvature exceeds one.
        max_iter: Most steps; if they do not suffice, a `ConvergenceWarning` says so.

    Attributes:
        classes_: (k,) class labels, ascending.
        coef_: (k, features) W.
        intercept_: (k,) b, without penalty.
        n_iter_: Steps taken.
    """

    def __init__(self, C: float = 1.0, tol: float = TOLERANCE, max_iter: int = MOST_STEPS) -> None:  # noqa: N803  # as in scikit-learn
        self.C = C
        self.tol = tol
        self.max_iter = max_iter

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:  # noqa: N803
        """Find W and b for features (shots, features) and the class of each shot.

        Raises:
            ValueError: All shots are of one class, or a feature is not finite.
        """
        features, labels = validate_data(self, X, y, dtype=self._kinds)
        self.classes_, members = np.unique(labels, return_inverse=True)
        if self.classes_.size < 2:
            raise ValueError("all shots are of one class: there is nothing to tell apart")
        shots, width = features.shape
        penalties = np.full((1, width), 1 / (self.C * shots))
        shares = np.full((1, shots), 1 / shots, features.dtype)
        found = _optimum(features, members, shares, penalties, tol=self.tol, max_iter=self.max_iter)
        self.n_iter_ = found.steps
        self.coef_, self.intercept_ = np.ascontiguousarray(found.weights[:, 0]), found.biases[:, 0].copy()
        return self

    def decision_function(self, X: ArrayLike) -> NDArray[np.floating]:  # noqa: N803
        """W x + b (shots, k)."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=self._kinds, reset=False)
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

    @property
    def _kinds(self) -> list[type[np.floating]]:
        """What it calculates in, the first unless the features are of another."""
        return [np.float64, np.float32] if self.C <= 1 else [np.float64]


def held_out_answers(
    features: NDArray[np.floating], members: NDArray[np.intp], splits: Sequence[Split], spreads: NDArray[np.float64]
) -> list[NDArray[np.intp]]:
    """Classes of the test part of each split, by a `SoftmaxRegression` of its training part, C = 1; all at once.

    Training parts overlap: their regressions share every pass over the features, which are not copied.

    Args:
        features: (shots, features).
        members: (shots,) class of each shot, 0, 1, ...
        splits: Training and test positions; a class that a training part lacks is never its answer.
        spreads: (splits, features) unit of each feature in the penalty: `deviations` = as if it were standardised.
    """
    shares = np.zeros((len(splits), len(features)), features.dtype)
    for share, (train, _) in zip(shares, splits, strict=True):
        share[train] = 1 / train.size
    sizes = np.array([train.size for train, _ in splits])
    found = _optimum(features, members, shares, spreads**2 / sizes[:, np.newaxis], tol=TOLERANCE, max_iter=MOST_STEPS)
    weights, biases = found.weights.astype(features.dtype), found.biases.astype(features.dtype)
    return [
        np.argmax(features[test] @ weights[:, part].T + biases[:, part], axis=1)
        for part, (_, test) in enumerate(splits)
    ]


def deviations(features: NDArray[np.floating], splits: Sequence[Split]) -> NDArray[np.float64]:
    """Standard deviation of each feature over each training part, (splits, features); 1 where it is constant."""
    found = np.empty((len(splits), features.shape[1]))
    for first in range(0, features.shape[1], BLOCK_FEATURES):
        some = slice(first, first + BLOCK_FEATURES)
        for deviation, (train, _) in zip(found, splits, strict=True):
            deviation[some] = features[:, some][train].std(axis=0, dtype=np.float64)
    return np.array(
        [units(deviation, features[train[0]], train.size) for deviation, (train, _) in zip(found, splits, strict=True)]
    )


@dataclass(frozen=True)
class _Optimum:
    """W (k, parts, features) and b (k, parts), -inf for a class that a part lacks, after so many steps."""

    weights: NDArray[np.float64]
    biases: NDArray[np.float64]
    steps: int


def _optimum(
    features: NDArray[np.floating],
    members: NDArray[np.intp],
    shares: NDArray[np.floating],
    penalties: NDArray[np.float64],
    *,
    tol: float,
    max_iter: int,
) -> _Optimum:
    """The least sum over the parts of: mean cross-entropy, and half the sum of `penalties` W^2.

    Neighbouring samples of a trace are alike, so that curvatures differ by a factor of 10^4 and plain L-BFGS takes
    hundreds of steps over all shots. Here it works in coordinates in which no curvature exceeds one: the Hessian is at
    most half the second moments of the features, one block a class (Böhning, Ann. Inst. Stat. Math. 44, 197, 1992), and
    one Cholesky factor of these is all that is needed.

    shares: (parts, shots) of the mean over a part; 0 = not in it. penalties: (parts, features).
    """
    parts, k, width = len(shares), int(members.max()) + 1, features.shape[1]
    if width > WIDER * np.sqrt(parts) * len(features):
        ones = [_of_wide(features, members, *one, tol, max_iter) for one in zip(shares, penalties, strict=True)]
        return _Optimum(
            np.stack([one.weights for one in ones], axis=1),
            np.stack([one.biases for one in ones], axis=1),
            max(one.steps for one in ones),
        )
    rows, kind = k * parts, features.dtype
    back = _coordinates(features, penalties.mean(axis=0))
    step = max(1, BLOCK_SCORES // rows)
    blocks = [slice(first, first + step) for first in range(0, len(features), step)]
    moments = _moments(features, members, shares, k, blocks)
    absent = np.where(moments[..., -1] > 0, 0, -np.inf)

    def objective(flat: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        weights = (flat.reshape(rows, -1) @ back).reshape(k, parts, -1)
        slope = -moments
        slope[..., :-1] += penalties * weights[..., :-1]
        loss = float(np.sum(penalties * weights[..., :-1] ** 2) / 2 - np.sum(moments * weights))
        slopes, biases = weights[..., :-1].reshape(rows, -1).astype(kind), (weights[..., -1] + absent).astype(kind)
        for block in blocks:
            some, share = features[block], shares[:, block]
            scores = (slopes @ some.T).reshape(k, parts, -1)
            scores += biases[..., np.newaxis]
            entropies = scores.max(axis=0)
            scores -= entropies
            np.exp(scores, out=scores)
            totals = scores.sum(axis=0)
            entropies += np.log(totals)
            loss += float(np.sum(entropies * share, dtype=np.float64))
            scores *= share / totals
            slope[..., :-1] += (scores.reshape(rows, -1) @ some).reshape(k, parts, -1)
            slope[..., -1] += scores.sum(axis=-1)
        return loss, (slope.reshape(rows, -1) @ back.T).ravel()

    best, _, report = fmin_l_bfgs_b(
        objective,
        np.zeros(rows * (width + 1)),
        factr=LEAST_GAIN,
        pgtol=tol,
        maxiter=max_iter,
        maxls=LINE_SEARCH,
    )
    steps = int(report["nit"])
    if steps >= max_iter:
        warnings.warn(f"{max_iter} steps did not find the optimum: allow more", ConvergenceWarning, stacklevel=3)
    weights = (best.reshape(rows, -1) @ back).reshape(k, parts, -1)
    return _Optimum(weights[..., :-1], weights[..., -1] + absent, steps)


def _of_wide(
    features: NDArray[np.floating],
    members: NDArray[np.intp],
    share: NDArray[np.floating],
    penalty: NDArray[np.float64],
    tol: float,
    max_iter: int,
) -> _Optimum:
    """The same of one part, with W (k, features) and b (k,), where shots are fewer than features.

    With features in units in which their penalty is one, W is a sum of shots: what is at right angles to all of them
    costs penalty and tells nothing apart. So it is looked for in as many coordinates as there are shots.
    """
    scale = np.sqrt(penalty)
    basis, shots = np.linalg.qr((features / scale).T)
    rotated = shots.T.astype(features.dtype)
    found = _optimum(rotated, members, share[np.newaxis], np.ones((1, len(shots))), tol=tol, max_iter=max_iter)
    return _Optimum(found.weights[:, 0] @ basis.T / scale, found.biases[:, 0], found.steps)


def _moments(
    features: NDArray[np.floating],
    members: NDArray[np.intp],
    shares: NDArray[np.floating],
    k: int,
    blocks: Sequence[slice],
) -> NDArray[np.float64]:
    """Sum of the features of each class, and share of the class, in each part: (k, parts, features + 1)."""
    moments = np.zeros((k, len(shares), features.shape[1] + 1))
    for block in blocks:
        own = (members[block] == np.arange(k)[:, np.newaxis, np.newaxis]) * shares[:, block]
        moments[..., :-1] += own @ features[block]
        moments[..., -1] += own.sum(axis=-1)
    return moments


def _coordinates(features: NDArray[np.floating], penalty: NDArray[np.float64]) -> NDArray[np.float64]:
    """What turns rows of coordinates into rows of W and b: the inverse Cholesky factor of what bounds the curvature."""
    some = features[:: -(-len(features) // SHOTS_OF_CURVATURE)].astype(np.float64)
    some = np.column_stack([some, np.ones(len(some))])
    bound = some.T @ some / (2 * len(some))
    bound[np.diag_indices(len(bound) - 1)] += penalty
    factor = cholesky(bound, lower=True, overwrite_a=True)
    inverse: NDArray[np.float64] = solve_triangular(factor, np.eye(len(factor)), lower=True)
    return inverse
