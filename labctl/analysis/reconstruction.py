"""Images from features: ridge regression to all pixels at once, plain and with a Gaussian kernel.

Features (shots, features) come from one shot an image: with repeats of an image in the training set, leaving one shot
out leaves its repeats in, and the regularisation comes out too weak. Images are (shots, pixels).
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted, validate_data
from threadpoolctl import threadpool_limits

from labctl.analysis.regression import ALPHAS

GAMMAS = (0.03, 0.1, 0.3, 1.0)
"""Widths to choose from: a pair of images differs by 2 in the mean square of its standardised features."""
SHARES = tuple(10.0 ** (exponent / 2) for exponent in range(-12, 5))
"""Penalties to choose from, as shares of the kernel's mean variance: 1e-6 to 100 in half decades."""
NEGLIGIBLE = 1e-10
"""Directions that hold less than this share of the kernel's variance, or of the images' spread, are rounding."""


class LinearReconstruction(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]  # no types there
    """Each pixel a linear function of the standardised features, with ridge penalty and a free bias.

    The penalty is the same for all pixels and chosen by the leave-one-out error inside the training set, which is
    taken to have one valley over it: what `ridge_readout` does, without the weights of every penalty that is not
    chosen, which cost the most by far where there are hundreds of pixels.

    Args:
        alphas: Penalties to choose from.
        clip: Limit predictions to the range of the training images, 0..1 for binary ones: no image lies outside, so
            what is cut off is error, 0.005 to 0.01 in RMSE. False = the plain regression.

    Attributes:
        pipeline_: The fitted standardisation and ridge regression.
        alpha_: The penalty chosen.
        range_: Least and greatest value in the training images.
        n_features_in_: Number of features.
    """

    def __init__(self, alphas: Sequence[float] = ALPHAS, clip: bool = True) -> None:
        self.alphas = alphas
        self.clip = clip

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:  # noqa: N803  # scikit-learn's own name
        """Learn from features (shots, features) and images (shots, pixels), or (shots,) values."""
        features, images = _checked(self, X, y)
        targets = images.reshape(len(images), -1)
        with threadpool_limits(1):
            shots = StandardScaler().fit_transform(features)
            of_pixels = _left_out(_split(shots @ shots.T, targets - targets.mean(axis=0)))
            errors = _over_penalties(lambda alpha, _: of_pixels(alpha, slice(None)).sum(), self.alphas, 1)
            self.alpha_ = float(self.alphas[int(errors.argmin())])
            self.pipeline_ = make_pipeline(StandardScaler(), Ridge(self.alpha_)).fit(features, images)
        self.range_ = (float(images.min()), float(images.max()))
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """Images of features (shots, features), shaped as in training."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=np.float64, reset=False)
        with threadpool_limits(1):
            images = np.asarray(self.pipeline_.predict(features))
        return images.clip(*self.range_) if self.clip else images


class KernelReconstruction(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """The best readout found for images: ridge regression with a Gaussian kernel, a penalty for each image component.

    A detector sees |a v|^2, quadratic in the image v, so the image is no linear function of the features. The kernel
    k(x, x') = exp(-gamma |x - x'|^2 / p) of p standardised features fits a smooth one. The images are split into their
    principal components, and each has its own penalty: strokes are clear in the features where fine detail drowns in
    noise. Width and penalties are chosen by the leave-one-out error inside the training set, in closed form: one
    eigendecomposition a width serves all penalties and components. Over the penalty it is taken to have one valley.
    Cost and memory go with the square of the shots and more: for a few thousand.

    Sources: Saunders, Gammerman & Vovk, Proc. ICML 1998, 515; Rifkin & Lippert, MIT-CSAIL-TR-2007-025 (leave-one-out).

    Args:
        gammas: Widths to choose from.
        alphas: Penalties to choose from, shares of the mean variance of the kernel's directions.
        clip: Limit predictions to the range of the training images, as in `LinearReconstruction`.

    Attributes:
        gamma_: The width chosen.
        alphas_: (components,) the penalty of each principal component that the images have, strongest component first.
        dual_coef_: (shots, pixels) weight of each training shot.
        mean_: (pixels,) mean training image.
        range_: Least and greatest value in the training images.
        n_features_in_: Number of features.
    """

    def __init__(
        self,
        gammas: Sequence[float] = GAMMAS,
        alphas: Sequence[float] = SHARES,
        clip: bool = True,
    ) -> None:
        self.gammas = gammas
        self.alphas = alphas
        self.clip = clip

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:  # noqa: N803
        """Learn from features (shots, features) and images (shots, pixels), or (shots,) values."""
        features, images = _checked(self, X, y)
        with threadpool_limits(1):
            self._scaler = StandardScaler().fit(features)
            self._shots = self._scaler.transform(features)
            self.mean_, scores, components = _components(images.tobytes(), len(images))
            distances = _distances(self._shots, self._shots)
            fits = [_fit(np.exp(-gamma * distances), scores, np.asarray(self.alphas)) for gamma in self.gammas]
            best = min(range(len(fits)), key=lambda position: fits[position].error)
            self.gamma_ = float(self.gammas[best])
            self.alphas_ = fits[best].alphas
            self.dual_coef_ = fits[best].weights @ components
            self._column_means = np.exp(-self.gamma_ * distances).mean(axis=0)
        self._pixels = images.shape[1:]
        self.range_ = (float(images.min()), float(images.max()))
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """Images of features (shots, features), shaped as in training."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=np.float64, reset=False)
        with threadpool_limits(1):
            kernel = np.exp(-self.gamma_ * _distances(self._scaler.transform(features), self._shots))
            images = (kernel - self._column_means) @ self.dual_coef_ + self.mean_
        shaped = np.asarray(images.reshape(len(features), *self._pixels))
        return shaped.clip(*self.range_) if self.clip else shaped


@lru_cache(maxsize=2)
def _components(images: bytes, shots: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mean (pixels,), scores (shots, components) and principal components (components, pixels) of images, float64.

    The images of two splits are the same for every acquisition time and number of wavelengths.
    """
    targets = np.frombuffer(images).reshape(shots, -1)
    mean = targets.mean(axis=0)
    turned, spreads, components = np.linalg.svd(targets - mean, full_matrices=False)
    some = spreads > NEGLIGIBLE * spreads[0]  # pixels that no training image lights leave many without any
    found = mean, turned[:, some] * spreads[some], components[some]
    for one in found:
        one.flags.writeable = False
    return found


class _Split(NamedTuple):
    """Centred targets (shots, columns) in the directions of a centred kernel of the shots.

    values: (directions,) eigenvalues. vectors: (shots, directions) eigenvectors. coordinates: (directions, columns) of
    the targets. outside: (shots, columns) what of the targets lies in none of the directions.
    """

    values: NDArray[np.float64]
    vectors: NDArray[np.float64]
    coordinates: NDArray[np.float64]
    outside: NDArray[np.float64]


class _Fit(NamedTuple):
    """Kernel ridge at one width: leave-one-out error, penalties (components,), weights (shots, components)."""

    error: float
    alphas: NDArray[np.float64]
    weights: NDArray[np.float64]


def _split(kernel: NDArray[np.float64], targets: NDArray[np.float64]) -> _Split:
    """In the directions that hold more of the kernel's variance than rounding does."""
    row_means = kernel.mean(axis=0)
    values, vectors = np.linalg.eigh(kernel - row_means - row_means[:, np.newaxis] + row_means.mean())
    kept = values > NEGLIGIBLE * max(float(values.sum()), NEGLIGIBLE)
    values, vectors = values[kept], vectors[:, kept]
    coordinates = vectors.T @ targets
    complete = values.size == len(kernel) - 1  # all but that of the mean, in which nothing that is centred lies
    outside = np.zeros_like(targets) if complete else targets - vectors @ coordinates
    return _Split(values, vectors, coordinates, outside)


def _left_out(split: _Split) -> Callable[[float, Any], NDArray[np.float64]]:
    """Mean squared leave-one-out error of ridge regression at a penalty, for some columns of the targets.

    With the centred kernel K = Q diag(w) Q', the fit is 1/n + Q diag(w / (w + a)) Q' =: H, and leaving shot i out gives
    the error (y - H y)_i / (1 - H_ii).
    """
    values = split.values
    shots = len(split.vectors)
    squared = split.vectors**2
    narrow_vectors, narrow_coordinates, outside = (  # a choice needs no more than single precision
        one.astype(np.float32) for one in (split.vectors, split.coordinates, split.outside)
    )

    def error(penalty: float, columns: Any) -> NDArray[np.float64]:
        if not values.size:  # a single shot, or all alike: nothing but the mean can be learnt
            return np.asarray(np.mean(split.outside[:, columns] ** 2, axis=0))
        missed = penalty / (values + penalty)
        left = 1 - 1 / shots - squared @ (1 - missed)
        residual = narrow_vectors @ (missed.astype(np.float32)[:, np.newaxis] * narrow_coordinates[:, columns])
        residual += outside[:, columns]
        residual /= left.astype(np.float32)[:, np.newaxis]
        return np.asarray(np.einsum("nc,nc->c", residual, residual) / shots)

    return error


def _fit(kernel: NDArray[np.float64], scores: NDArray[np.float64], alphas: NDArray[np.float64]) -> _Fit:
    """The penalty of least leave-one-out error for each column of `scores` (shots, components), and the weights."""
    split = _split(kernel, scores)
    penalties = alphas * split.values.sum() / len(kernel)
    errors = _over_penalties(_left_out(split), penalties, scores.shape[1])
    best = errors.argmin(axis=0)
    weights = split.vectors @ (split.coordinates / (split.values[:, np.newaxis] + penalties[best]))
    return _Fit(float(errors.min(axis=0).sum()), alphas[best], weights - weights.mean(axis=0))


def _over_penalties(
    error: Callable[[float, Any], ArrayLike], penalties: Sequence[float] | NDArray[np.float64], columns: int
) -> NDArray[np.float64]:
    """Errors (penalties, columns) around the least of each column; inf where nobody looked.

    Over the penalty an error has one valley, looked for in steps of four, of two and of one.
    """
    errors = np.full((len(penalties), columns), np.inf)
    for position in range(0, len(penalties), 4):
        errors[position] = error(penalties[position], slice(None))
    for step in (2, 1):
        best = errors.argmin(axis=0)
        for position, penalty in enumerate(penalties):
            beside = np.flatnonzero(np.abs(best - position) == step)
            if beside.size:
                errors[position, beside] = error(penalty, beside)
    return errors


def _distances(shots: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over the features of the squared difference of each shot (n, p) from each other (m, p): (n, m)."""
    squares = np.sum(shots**2, axis=1)[:, np.newaxis] + np.sum(others**2, axis=1)
    return np.asarray((squares - 2 * (shots @ others.T)).clip(min=0) / shots.shape[1])


def _checked(estimator: Any, X: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # noqa: N803
    features, images = validate_data(estimator, X, y, dtype=np.float64, multi_output=True, y_numeric=True)
    return features, np.asarray(images, np.float64)
