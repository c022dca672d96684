"""Ghost imaging: masks from random patterns beside a reference, then images that nothing was ever trained on.

Up to the detector light is linear in the mirrors. Picture V sends the field E_V(t) = sum_p V_p e_p(t) to a detector,
the reference R, on other mirrors, sends E_R(t), and the detector sees

    I(V)     = |E_V|^2
    I(V + R) = |E_V + E_R|^2 = |E_V|^2 + |E_R|^2 + 2 Re(E_V conj(E_R))
    I(V + R) - I(V) - I(R) = sum_p V_p 2 Re(e_p conj(E_R)) = sum_p V_p A_p(t),

which is linear in V, whatever fibre, collection and chip do to the light: A_p(t) is pixel p's mask. Several collected
modes add their own masks, and what is linear behind the detector, its bandwidth for one, acts on A. What every record
holds, light or not, cancels in I(V + R) - I(R) and is taken off as the dark frame where I(V) is. With a single frame,
I(V + R) - I(R), the square |E_V|^2 remains: the part of it that is linear in V is learnt with the masks, the rest is
noise.
"""

from collections.abc import Iterator, Sequence
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted

from labctl.analysis.threads import one_thread
from labctl.analysis.total_variation import least_total_variation
from labctl.errors import AnalysisError

PENALTIES = tuple(10.0 ** (exponent / 2) for exponent in range(-2, 9))
"""Of the masks, to choose from: the noise of a sample, in units of what one pixel does to it."""
STRENGTHS = tuple(10.0 ** (exponent / 2) for exponent in range(-2, 5))
"""Of the total variation, to choose from, with measurements in units of their noise."""
ROUNDS = 3
"""How often noise and covariance of the masks are estimated anew: from the third on the masks' error stays the same."""


LEAST, LEAST_LEFT = 1e-30, 1e-6
"""Of the noise, and of what a round leaves of it: a sample that never changes must not divide by nothing."""


class GhostImaging(RegressorMixin, BaseEstimator):  # type: ignore[misc]  # no types there
    """Images from what detectors saw of them, by masks that random patterns reveal and by least total variation.

    `fit` knows random patterns only. Masks are a ridge regression of every sample on the pixels, without a bias. Its
    prior is what the masks themselves show: they share one covariance over the pixels, the speckle's, which is
    estimated from a first round (empirical Bayes). Patterns held out give the noise of each sample, the penalty of
    least error in what is measured, and the strength of the total variation of least error in the patterns; then all
    patterns give the masks anew.

    Args:
        held_out: Share of the patterns, the last ones, that choose.

    Attributes:
        masks_: (pixels, samples), in units of the noise.
        noise_: (samples,) what patterns held out differ by from what the masks predict, rms, in units of what was seen.
        penalty_: The penalty chosen.
        strength_: The strength chosen.
        pattern_rmse_: Error of the patterns held out, with that strength.
        n_features_in_: Number of samples.
    """

    def __init__(self, held_out: float = 0.2) -> None:
        self.held_out = held_out

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:  # noqa: N803
        """Learn from what was seen (patterns, samples) of random patterns (patterns, rows, columns).

        Raises:
            AnalysisError: They do not fit each other, or too few are left to learn from or to hold out.
        """
        seen, patterns = np.asarray(X, np.float64), np.asarray(y, np.float64)
        learnt = len(patterns) - round(self.held_out * len(patterns))
        if seen.ndim != 2 or patterns.ndim != 3 or len(seen) != len(patterns) or not 0 < learnt < len(patterns):
            raise AnalysisError(
                f"measurements {seen.shape} of patterns {patterns.shape}, {learnt} of them to learn from: give "
                "(patterns, samples) and (patterns, rows, columns), and hold out a part"
            )
        self.n_features_in_ = seen.shape[1]
        self._shape = (patterns.shape[1], patterns.shape[2])
        pixels = patterns.reshape(len(patterns), -1)
        with one_thread():
            covariance = self._calibrate(seen, pixels, learnt)
            self._choose_strength(seen[learnt:], patterns[learnt:])
            self.masks_ = next(_masks(pixels, seen / self.noise_, covariance, (self.penalty_,)))
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """Images (n, rows, columns) of 0..1 of what was seen (n, samples).

        Raises:
            AnalysisError: The samples are not as many as those of the patterns.
        """
        check_is_fitted(self)
        seen = np.asarray(X, np.float64)
        if seen.ndim != 2 or seen.shape[1] != self.n_features_in_:
            raise AnalysisError(
                f"measurements {seen.shape}, masks of {self.n_features_in_} samples: measure both alike"
            )
        with one_thread():
            return self._images(seen, self.strength_)

    def _calibrate(self, seen: NDArray[np.float64], pixels: NDArray[np.float64], learnt: int) -> NDArray[np.float64]:
        """Masks of the first `learnt` patterns, noise and penalty; returns the covariance (pixels, pixels) of masks."""
        known, held = pixels[:learnt], pixels[learnt:]
        self.noise_ = np.sqrt(np.mean(seen**2, axis=0)).clip(min=LEAST)
        covariance = np.eye(pixels.shape[1])
        for _ in range(ROUNDS):
            whitened = seen / self.noise_
            candidates = _masks(known, whitened[:learnt], covariance, PENALTIES)
            errors = [np.sum((whitened[learnt:] - held @ masks) ** 2) for masks in candidates]
            self.penalty_ = PENALTIES[int(np.argmin(errors))]
            masks = next(_masks(known, whitened[:learnt], covariance, (self.penalty_,)))
            left = np.sqrt(np.mean((whitened[learnt:] - held @ masks) ** 2, axis=0)).clip(min=LEAST_LEFT)
            self.noise_ = self.noise_ * left
            self.masks_ = masks / left
            shared = self.masks_ @ self.masks_.T
            prior, covariance = covariance, shared * (len(shared) / max(float(np.trace(shared)), LEAST))
        return prior

    def _choose_strength(self, seen: NDArray[np.float64], patterns: NDArray[np.float64]) -> None:
        """The strength with which patterns come back best."""
        errors = [float(np.sqrt(np.mean((self._images(seen, strength) - patterns) ** 2))) for strength in STRENGTHS]
        best = int(np.argmin(errors))
        self.strength_, self.pattern_rmse_ = STRENGTHS[best], errors[best]

    def _images(self, seen: NDArray[np.float64], strength: float) -> NDArray[np.float64]:
        normal = self.masks_ @ self.masks_.T
        return least_total_variation(normal, (seen / self.noise_) @ self.masks_.T, self._shape, strength)


def _masks(
    known: NDArray[np.float64],
    seen: NDArray[np.float64],
    covariance: NDArray[np.float64],
    penalties: Sequence[float],
) -> Iterator[NDArray[np.float64]]:
    """Masks (pixels, samples) for each penalty: C P' (P C P' + penalty)^-1 seen, of patterns P and covariance C.

    The mean of masks that have this covariance, given what was seen (samples) through noise of that variance.
    """
    values, vectors = np.linalg.eigh(known @ covariance @ known.T)
    answers, to_pixels = vectors.T @ seen, covariance @ known.T @ vectors
    for penalty in penalties:
        yield to_pixels @ (answers / (values + penalty)[:, np.newaxis])
