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

from labctl.analysis.regression import ALPHAS
from labctl.analysis.threads import one_thread

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
        with one_thread():
            directions = _directions_of(StandardScaler().fit_transform(features))
            of_pixels = _left_out(directions, targets - targets.mean(axis=0), np.asarray(self.alphas))
            errors = _over_penalties(lambda place, _: of_pixels(place, slice(None)).sum(), len(self.alphas), 1)
            self.alpha_ = float(self.alphas[int(errors.argmin())])
            self.pipeline_ = make_pipeline(StandardScaler(), Ridge(self.alpha_)).fit(features, images)
        self.range_ = (float(images.min()), float(images.max()))
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """Images of features (shots, features), shaped as in training."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=np.float64, reset=False)
        with one_thread():
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
        with one_thread():
            self._scaler = StandardScaler().fit(features)
            self._shots = self._scaler.transform(features)
            self.mean_, scores, components = _components(images.tobytes(), len(images))
            distances = _distances(self._shots, self._shots)
            alphas = np.asarray(self.alphas)
            best = min((_fit(distances, gamma, scores, alphas) for gamma in self.gammas), key=lambda fit: fit.error)
            self.gamma_, self.alphas_ = best.gamma, alphas[best.places]
            self.dual_coef_ = best.weights(scores) @ components
            self._column_means = np.exp(-self.gamma_ * distances).mean(axis=0)
        self._pixels = images.shape[1:]
        self.range_ = (float(images.min()), float(images.max()))
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """Images of features (shots, features), shaped as in training."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=np.float64, reset=False)
        with one_thread():
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


class _Directions(NamedTuple):
    """Eigenvalues (directions,) and eigenvectors (shots, directions) of a centred kernel of the shots."""

    values: NDArray[np.float64]
    vectors: NDArray[np.float64]


class _Fit(NamedTuple):
    """Kernel ridge at one width: its leave-one-out error, and which of the penalties each component has."""

    error: float
    gamma: float
    directions: _Directions
    penalties: NDArray[np.float64]
    places: NDArray[np.intp]

    def weights(self, scores: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of each shot in each component (shots, components)."""
        values, vectors = self.directions
        found = vectors @ (vectors.T @ scores / (values[:, np.newaxis] + self.penalties[self.places]))
        return np.asarray(found - found.mean(axis=0))


def _directions(kernel: NDArray[np.float64]) -> _Directions:
    """Of a kernel (shots, shots), those that hold more of its variance than rounding does."""
    row_means = kernel.mean(axis=0)
    return _above_rounding(*np.linalg.eigh(kernel - row_means - row_means[:, np.newaxis] + row_means.mean()))


def _directions_of(shots: NDArray[np.float64]) -> _Directions:
    """The same of the products of centred shots (shots, features): by way of the features where these are fewer."""
    if shots.shape[1] >= len(shots):
        return _directions(shots @ shots.T)
    vectors, spreads, _ = np.linalg.svd(shots, full_matrices=False)
    return _above_rounding(spreads**2, vectors)


def _above_rounding(values: NDArray[np.float64], vectors: NDArray[np.float64]) -> _Directions:
    kept = values > NEGLIGIBLE * max(float(values.sum()), NEGLIGIBLE)
    return _Directions(values[kept], vectors[:, kept])


def _left_out(
    directions: _Directions, targets: NDArray[np.float64], penalties: NDArray[np.float64]
) -> Callable[[int, Any], NDArray[np.float64]]:
    """Mean squared leave-one-out error of ridge regression at one of the penalties, for some columns of the targets.

    With the centred kernel K = Q diag(w) Q', the fit is 1/n + Q diag(w / (w + a)) Q' =: H, and leaving shot i out gives
    the error (y - H y)_i / (1 - H_ii).
    """
    values, vectors = directions
    shots = len(vectors)
    missed = penalties / (values[:, np.newaxis] + penalties)
    left = 1 - 1 / shots - vectors**2 @ (1 - missed)
    # A choice needs no more than single precision.
    missed, left, narrow = missed.astype(np.float32), left.astype(np.float32), vectors.astype(np.float32)
    outside = targets.astype(np.float32)  # what of the targets lies in none of the directions
    coordinates = narrow.T @ outside
    if values.size == shots - 1:  # all but that of the mean, in which nothing that is centred lies
        outside[:] = 0
    else:
        outside -= narrow @ coordinates

    def error(place: int, columns: Any) -> NDArray[np.float64]:
        if not values.size:  # a single shot, or all alike: nothing but the mean can be learnt
            return np.asarray(np.mean(targets[:, columns] ** 2, axis=0))
        residual = narrow @ (missed[:, place, np.newaxis] * coordinates[:, columns])
        residual += outside[:, columns]
        residual /= left[:, place, np.newaxis]
        return np.asarray(np.einsum("nc,nc->c", residual, residual) / shots)

    return error


def _fit(
    distances: NDArray[np.float64], gamma: float, scores: NDArray[np.float64], alphas: NDArray[np.float64]
) -> _Fit:
    """The penalty of least leave-one-out error for each column of `scores` (shots, components), at one width."""
    kernel = np.exp(-gamma * distances)
    directions = _directions(kernel)
    penalties = alphas * directions.values.sum() / len(kernel)
    errors = _over_penalties(_left_out(directions, scores, penalties), len(penalties), scores.shape[1])
    return _Fit(float(errors.min(axis=0).sum()), float(gamma), directions, penalties, errors.argmin(axis=0))


def _over_penalties(error: Callable[[int, Any], ArrayLike], penalties: int, columns: int) -> NDArray[np.float64]:
    """Errors (penalties, columns) around the least of each column; inf where nobody looked.

    Over the penalty an error has one valley, looked for in steps of four, of two and of one.
    """
    errors = np.full((penalties, columns), np.inf)
    for place in range(0, penalties, 4):
        errors[place] = error(place, slice(None))
    for step in (2, 1):
        best = errors.argmin(axis=0)
        for place in range(penalties):
            beside = np.flatnonzero(np.abs(best - place) == step)
            if beside.size:
                errors[place, beside] = error(place, beside)
    return errors


def _distances(shots: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over the features of the squared difference of each shot (n, p) from each other (m, p): (n, m)."""
    squares = np.sum(shots**2, axis=1)[:, np.newaxis] + np.sum(others**2, axis=1)
    return np.asarray((squares - 2 * (shots @ others.T)).clip(min=0) / shots.shape[1])


def _checked(estimator: Any, X: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # noqa: N803
    features, images = validate_data(estimator, X, y, dtype=np.float64, multi_output=True, y_numeric=True)
    return features, np.asarray(images, np.float64)
