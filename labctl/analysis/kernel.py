"""A classifier with a Gaussian kernel whose memory does not grow with the number of shots that it learns from."""

from collections.abc import Iterator, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.validation import check_is_fitted, validate_data

GAMMAS = (0.03, 0.1, 0.3, 1.0, 3.0)
"""Widths to choose from, see `KernelClassifier`."""
ALPHAS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""Penalties to choose from."""
TRIAL_SHOTS, TRIAL_LANDMARKS, TRIAL_TEST = 6000, 500, 0.2
"""Width and penalty are chosen on so many of the training shots, with so many landmarks; that part of them tests."""
BLOCK_SHOTS = 2000
JITTER = 1e-4
"""Added to the kernel of a landmark with itself, which is 1: landmarks that are alike leave a solution."""


class KernelClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn ships no types
    """Kernel ridge regression of the classes' indicators on a subset of regressors; the largest answer is the class.

    f(x) = sum over the landmarks z of beta_z exp(-gamma d(x, z)^2 / V), d the distance, V the sum of the features'
    variances; beta has the least sum over the shots of (f - indicator)^2 + alpha shots beta' K beta, K the kernel of
    the landmarks. The landmarks are drawn from the training shots (Nystroem's approximation; Williams & Seeger, NIPS
    13, 2001; Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006, section 8.3.1). gamma and alpha are
    those of the best accuracy on a part of the training shots that is kept from their fit.

    Args:
        landmarks: How many landmarks; at most the number of shots.
        gammas: Values of gamma to choose from.
        alphas: Values of alpha to choose from.
        seed: Seed of landmarks and of the part that gamma and alpha are chosen on.

    Attributes:
        classes_: (k,) class labels, ascending.
        gamma_, alpha_: What was chosen.
    """

    def __init__(
        self,
        landmarks: int = 2000,
        gammas: Sequence[float] = GAMMAS,
        alphas: Sequence[float] = ALPHAS,
        seed: int = 0,
    ) -> None:
        self.landmarks = landmarks
        self.gammas = gammas
        self.alphas = alphas
        self.seed = seed

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:  # noqa: N803  # scikit-learn's own name
        """Learn from features (shots, features) and the class of each shot.

        Raises:
            ValueError: All shots are of one class, or a feature is not finite.
        """
        features, labels = validate_data(self, X, y, dtype=np.float32)
        self.classes_, members = np.unique(labels, return_inverse=True)
        if self.classes_.size < 2:
            raise ValueError("all shots are of one class: there is nothing to tell apart")
        generator = np.random.default_rng(self.seed)
        drawn = np.sort(generator.permutation(len(features))[:TRIAL_SHOTS])
        self._variance = float(features[drawn].var(axis=0, dtype=np.float64).sum()) or 1.0
        self._shares = np.bincount(members) / members.size
        self.gamma_, self.alpha_ = self._chosen(features[drawn], members[drawn], generator)
        chosen = np.sort(generator.choice(len(features), min(self.landmarks, len(features)), replace=False))
        self._landmarks = features[chosen]
        gram, moments = self._sums(features, members, self._landmarks, self.gamma_)
        self._weights = self._solved(gram, moments, self._landmarks, self.gamma_, self.alpha_ * len(features))
        return self

    def predict(self, X: ArrayLike) -> NDArray[Any]:  # noqa: N803
        """The class (shots,) of the largest answer."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=np.float32, reset=False)
        return np.asarray(self.classes_[self._answers(features, self._landmarks, self.gamma_, self._weights)])

    def _chosen(
        self, features: NDArray[np.float32], members: NDArray[np.intp], generator: np.random.Generator
    ) -> tuple[float, float]:
        """Width and penalty of the best accuracy on a part of these shots; the first ones where several are as good."""
        order = generator.permutation(len(features))
        kept = max(1, round(TRIAL_TEST * len(features)))
        test, train = order[:kept], order[kept:]
        landmarks = features[train[:TRIAL_LANDMARKS]]
        best, found = (self.gammas[0], self.alphas[0]), -1
        for gamma in self.gammas:
            gram, moments = self._sums(features[train], members[train], landmarks, gamma)
            for alpha in self.alphas:
                weights = self._solved(gram, moments, landmarks, gamma, alpha * train.size)
                answers = self._answers(features[test], landmarks, gamma, weights)
                right = int(np.count_nonzero(answers == members[test]))
                if right > found:
                    best, found = (gamma, alpha), right
        return best

    def _sums(
        self, features: NDArray[np.float32], members: NDArray[np.intp], landmarks: NDArray[np.float32], gamma: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Second moments of the kernels (landmarks, landmarks), and with the centred indicators (landmarks, k)."""
        gram = np.zeros((len(landmarks), len(landmarks)))
        moments = np.zeros((len(landmarks), self._shares.size))
        for block in _blocks(len(features)):
            kernel = self._kernel(features[block], landmarks, gamma).astype(np.float64)
            gram += kernel.T @ kernel
            moments += kernel.T @ ((members[block, np.newaxis] == np.arange(self._shares.size)) - self._shares)
        return gram, moments

    def _solved(
        self,
        gram: NDArray[np.float64],
        moments: NDArray[np.float64],
        landmarks: NDArray[np.float32],
        gamma: float,
        penalty: float,
    ) -> NDArray[np.float64]:
        own = self._kernel(landmarks, landmarks, gamma).astype(np.float64)
        own[np.diag_indices(len(own))] += JITTER
        weights: NDArray[np.float64] = cho_solve(cho_factor(gram + penalty * own), moments)
        return weights

    def _answers(
        self,
        features: NDArray[np.float32],
        landmarks: NDArray[np.float32],
        gamma: float,
        weights: NDArray[np.float64],
    ) -> NDArray[np.intp]:
        """Place (shots,) of the class with the largest answer."""
        answers = np.empty(len(features), np.intp)
        for block in _blocks(len(features)):
            kernel = self._kernel(features[block], landmarks, gamma)
            answers[block] = np.argmax(kernel @ weights + self._shares, axis=1)
        return answers

    def _kernel(
        self, features: NDArray[np.float32], landmarks: NDArray[np.float32], gamma: float
    ) -> NDArray[np.float32]:
        squares = np.sum(features**2, axis=1)[:, np.newaxis] + np.sum(landmarks**2, axis=1)
        squares -= 2 * (features @ landmarks.T)
        np.maximum(squares, 0, out=squares)
        squares *= -gamma / self._variance
        kernel: NDArray[np.float32] = np.exp(squares, out=squares)
        return kernel


def _blocks(shots: int) -> Iterator[slice]:
    return (slice(first, min(first + BLOCK_SHOTS, shots)) for first in range(0, shots, BLOCK_SHOTS))
