"""How abnormal a shot is, learnt from normal shots alone. Bigger scores are more abnormal, everywhere in this module.

scikit-learn's own detectors count the other way round (`score_samples` there falls with abnormality); the estimators
here follow the paper's score, an error.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.covariance import LedoitWolf, ShrunkCovariance
from sklearn.metrics import auc, roc_curve
from sklearn.utils.validation import check_is_fitted, validate_data

from labctl.analysis.standardisation import units
from labctl.errors import AnalysisError


class NormalityScore(BaseEstimator):  # type: ignore[misc]  # scikit-learn ships no types
    """A linear readout trained to answer 1 to everything normal; the score is how far off it is, (y - 1)^2.

    y = w x with the features divided by their training mean, so that a normal shot is all ones but for what tells one
    from another, and with ridge penalty. There is no bias: a free one would answer 1 by itself with w = 0, and every
    score would be 0. Centred features would leave nothing to answer with, for the same reason.

    Args:
        alpha: Penalty as a fraction of the mean of the diagonal of X'X, above 0; 0.01 to 0.1 serve well.

    Attributes:
        mean_: (features,) training mean of each feature; 1 where that is zero.
        coef_: (features,) weights w of the divided features.
        n_features_in_: Number of features.
    """

    def __init__(self, alpha: float = 0.03) -> None:
        self.alpha = alpha

    def fit(self, X: ArrayLike, y: object = None) -> Self:  # noqa: N803  # scikit-learn's own name
        """Learn the weights from normal shots (shots, features).

        Raises:
            AnalysisError: `alpha` is not above zero.
        """
        if not self.alpha > 0:
            raise AnalysisError(f"a penalty of {self.alpha:g} leaves the weights undetermined: use one above zero")
        features = validate_data(self, X, dtype=np.float64)
        mean = features.mean(axis=0)
        self.mean_ = np.where(mean == 0, 1.0, mean)
        scaled = features / self.mean_
        shots, count = scaled.shape
        penalty = self.alpha * float(np.sum(scaled**2)) / count
        # Least squares with the penalty as further rows: the same as the normal equations, at half their condition.
        rows = np.vstack([scaled, np.sqrt(penalty) * np.eye(count)])
        targets = np.concatenate([np.ones(shots), np.zeros(count)])
        self.coef_ = np.linalg.lstsq(rows, targets)[0]
        return self

    def output(self, X: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """The readout's answer y (shots,): near 1 for normal shots."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray((features / self.mean_) @ self.coef_)

    def score_samples(self, X: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """Abnormality (y - 1)^2 of each shot (shots,): 0 is normal, bigger is more abnormal."""
        return (self.output(X) - 1) ** 2


class CovarianceScore(BaseEstimator):  # type: ignore[misc]
    """Mahalanobis distance of a shot from the normal ones: bigger is more abnormal.

    The features are standardised, their covariance is shrunk towards unity, (1 - s) C + s tr(C) / p, so that it can be
    inverted with few shots. Source of the default: Ledoit & Wolf, J. Multivariate Anal. 88, 365 (2004).

    Args:
        shrinkage: s from 0 to 1; None = Ledoit and Wolf's optimum. Only with 0 is the distance the same in all linear
            combinations of the features; it then needs more shots than features.

    Attributes:
        mean_: (features,) mean of each feature.
        scale_: (features,) standard deviation of each feature; 1 where it is constant.
        precision_: (features, features) inverse of the covariance of the standardised features.
        shrinkage_: The s that was used.
        n_features_in_: Number of features.
    """

    def __init__(self, shrinkage: float | None = None) -> None:
        self.shrinkage = shrinkage

    def fit(self, X: ArrayLike, y: object = None) -> Self:  # noqa: N803
        """Learn mean and covariance from normal shots (shots, features).

        Raises:
            AnalysisError: `shrinkage` is not from 0 to 1.
        """
        if self.shrinkage is not None and not 0 <= self.shrinkage <= 1:
            raise AnalysisError(f"a shrinkage of {self.shrinkage:g} is no mixture: use 0 to 1, or None for the optimum")
        features = validate_data(self, X, dtype=np.float64, ensure_min_samples=2)
        self.mean_ = features.mean(axis=0)
        self.scale_ = units(features.std(axis=0), self.mean_, len(features))
        standard = (features - self.mean_) / self.scale_
        if self.shrinkage is None:
            covariance = LedoitWolf(assume_centered=True).fit(standard)
            self.shrinkage_ = float(covariance.shrinkage_)
        else:
            covariance = ShrunkCovariance(assume_centered=True, shrinkage=self.shrinkage).fit(standard)
            self.shrinkage_ = float(self.shrinkage)
        self.precision_ = np.asarray(covariance.precision_)
        return self

    def score_samples(self, X: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """Distance of each shot (shots,) from the normal ones: about the root of the number of features if normal."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=np.float64, reset=False)
        standard = (features - self.mean_) / self.scale_
        return np.asarray(np.sqrt(np.sum((standard @ self.precision_) * standard, axis=1).clip(min=0)))


@dataclass(frozen=True)
class Roc:
    """Receiver operating characteristic: what is found against what is wrongly called abnormal.

    Attributes:
        false_positive: (n,) share of the normal shots that score at least the threshold, ascending from 0 to 1.
        true_positive: (n,) share of the abnormal shots that do.
        thresholds: (n,) falling, the first infinite.
        auc: Area under the curve: the probability that an abnormal shot scores above a normal one.
    """

    false_positive: NDArray[np.float64]
    true_positive: NDArray[np.float64]
    thresholds: NDArray[np.float64]
    auc: float


def roc(scores: ArrayLike, abnormal: ArrayLike) -> Roc:
    """The curve of scores (shots,), bigger = more abnormal, against what the shots are (shots,), True = abnormal.

    Raises:
        AnalysisError: The shapes differ, a score is not finite, or all shots are of one kind.
    """
    values, truth = np.asarray(scores, np.float64), np.asarray(abnormal, np.bool_)
    if values.ndim != 1 or values.shape != truth.shape:
        raise AnalysisError(f"scores of shape {values.shape} for shots of shape {truth.shape}: give one score a shot")
    if not np.isfinite(values).all():
        raise AnalysisError("some scores are not finite: leave the broken shots out")
    if truth.all() or not truth.any():
        raise AnalysisError(f"all {truth.size} shots are of one kind: a curve needs normal and abnormal ones")
    false_positive, true_positive, thresholds = roc_curve(truth, values)
    return Roc(false_positive, true_positive, thresholds, float(auc(false_positive, true_positive)))
