"""Readouts that follow: linear readouts that learn from every shot as it comes, and forget what is long past.

Where the bench drifts, a readout that was trained once tells classes apart by features that no longer are what they
were. An adaptive filter takes each shot with its label, corrects its weights by the error it would have made, and so
stays with the bench. Two rules say how: recursive least squares and normalised least mean squares.

Sources: S. Haykin, Adaptive Filter Theory (5th ed.), ch. 6 (NLMS) and 10 (RLS). A P that stays symmetric forgets its
rounding errors where lambda < 1: S. and L. Ljung, Automatica 21 (1985) 157; M. Verhaegen, Automatica 25 (1989) 437.
The bound on its trace: K. J. Astrom and B. Wittenmark, Adaptive Control (2nd ed.), section 11.5.
"""

import math
from collections.abc import Callable
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin, RegressorMixin
from sklearn.utils import Tags
from sklearn.utils.multiclass import check_classification_targets, unique_labels
from sklearn.utils.validation import check_is_fitted, validate_data

from labctl.analysis.standardisation import units

SHOTS_PER_WEIGHT = 20
"""How long readouts remember by default: so many shots for each weight of an output. RLS fits that many weights to
what it remembers, so few of them would be learnt by heart."""
LEAST_SHOTS_PER_WEIGHT = 2
"""Below this the weights fit the noise of the last shots: in trials 1 was no better than guessing."""

Gain = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Told of the inputs of a shot (weights,), how much each weight moves for an error of 1 (weights,)."""


class RecursiveLeastSquares(BaseEstimator):  # type: ignore[misc]  # scikit-learn ships no types
    """Rule: the weights that are best for all shots so far, one that is n shots old counting lambda^n.

    P, the inverse of the weighted sum of u u^T, is kept exactly symmetric. Its trace never exceeds what it was at the
    beginning: where the shots stop to say anything new, P would otherwise grow without end (wind-up). An update takes
    O(weights^2).

    Args:
        forgetting: lambda, 0..1; it remembers 1 / (1 - lambda) shots. None = `SHOTS_PER_WEIGHT` for each weight.
        penalty: Of the sum of squared weights, at the beginning; it is forgotten as shots are.
    """

    def __init__(self, forgetting: float | None = None, penalty: float = 1.0) -> None:
        self.forgetting = forgetting
        self.penalty = penalty

    def gain(self, weights: int) -> Gain:
        """The rule at its beginning, for so many weights.

        Raises:
            ValueError: `forgetting` is no such factor or forgets too soon, or there is no penalty.
        """
        chosen = 1 - 1 / (SHOTS_PER_WEIGHT * weights) if self.forgetting is None else self.forgetting
        longest = 1 - 1 / (LEAST_SHOTS_PER_WEIGHT * weights)
        if not longest <= chosen <= 1:
            raise ValueError(
                f"forgetting = {chosen:g}: {weights} weights need a memory of {LEAST_SHOTS_PER_WEIGHT * weights} "
                f"shots at least: choose from {math.ceil(longest * 1e6) / 1e6:.6f} to 1"
            )
        if self.penalty <= 0:
            raise ValueError(f"penalty = {self.penalty:g}: choose one above 0")
        return _LeastSquares(weights, chosen, self.penalty)


class NormalisedLeastMeanSquares(BaseEstimator):  # type: ignore[misc]  # scikit-learn ships no types
    """Rule: a step along u that takes away the part `step` of the error. An update takes O(weights).

    Where features are correlated, as neighbouring samples are, some directions are learnt slowly.

    Args:
        step: 0..2, small: of white features it remembers weights / step shots. Its default is as long as RLS's.
    """

    def __init__(self, step: float = 1 / SHOTS_PER_WEIGHT) -> None:
        self.step = step

    def gain(self, weights: int) -> Gain:
        """The rule, for so many weights.

        Raises:
            ValueError: such a step does not settle.
        """
        if not 0 < self.step < 2:
            raise ValueError(f"step = {self.step:g}: choose one between 0 and 2")
        return _LeastMeanSquares(self.step)


Rule = RecursiveLeastSquares | NormalisedLeastMeanSquares


class OnlineClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn ships no types
    """Linear classifier that learns shot by shot: one output for each class, target 1 for its own and 0 for others.

    Features are standardised by the shots of the first call alone (`fit` or `partial_fit`), which therefore should be
    some dozens; nothing looks ahead, and what moves later is followed by the weights.

    Args:
        rule: How weights follow; None = `RecursiveLeastSquares()`.

    Attributes:
        classes_: (k,) the classes.
        n_features_in_: Number of features.

    Example:
        >>> import numpy as np
        >>> from labctl.analysis.online import OnlineClassifier
        >>> generator = np.random.default_rng(1)
        >>> labels = generator.integers(0, 2, 400)
        >>> features = generator.normal(size=(400, 3)) + 2 * labels[:, np.newaxis]
        >>> readout = OnlineClassifier().partial_fit(features[:50], labels[:50])
        >>> bool(np.mean(readout.follow(features[50:], labels[50:]) == labels[50:]) > 0.9)
        True
    """

    def __init__(self, rule: Rule | None = None) -> None:
        self.rule = rule

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:  # noqa: N803  # scikit-learn's own name
        """Forget everything, then learn from the shots in their order.

        Raises:
            ValueError: too few shots, not of two classes, or settings of the rule that are wrong.
        """
        if hasattr(self, "filter_"):
            del self.filter_
        return self.partial_fit(X, y)

    def partial_fit(self, X: ArrayLike, y: ArrayLike, classes: ArrayLike | None = None) -> Self:  # noqa: N803
        """Learn from further shots in their order.

        Args:
            X: (shots, features).
            y: (shots,) classes.
            classes: All classes there will be; needed at the first call if its shots lack one of them.

        Raises:
            ValueError: a class that was not named, other features, too few shots at the first call.
        """
        self._learn(X, y, classes)
        return self

    def follow(self, X: ArrayLike, y: ArrayLike) -> NDArray[Any]:  # noqa: N803
        """Predict each shot, then learn from it: the prediction (shots,) for each before its label was known.

        Raises:
            ValueError: as in `partial_fit`.
            sklearn.exceptions.NotFittedError: There were no shots to begin with.
        """
        check_is_fitted(self)
        return np.asarray(self.classes_[self._learn(X, y, None).argmax(axis=1)])

    def predict(self, X: ArrayLike) -> NDArray[Any]:  # noqa: N803
        """The class (shots,) of each shot."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(self.classes_[self.filter_.outputs(features).argmax(axis=1)])

    def _learn(self, X: ArrayLike, y: ArrayLike, classes: ArrayLike | None) -> NDArray[np.float64]:  # noqa: N803
        first = not hasattr(self, "filter_")
        features, labels = validate_data(self, X, y, dtype=np.float64, reset=first, ensure_min_samples=1 + first)
        check_classification_targets(labels)
        if first:
            self.classes_ = unique_labels(labels if classes is None else classes)
            if self.classes_.size < 2:
                raise ValueError(f"only one class, {self.classes_[0]}: there is nothing to tell apart")
            self.filter_ = _Filter(features, self.classes_.size, self.rule or RecursiveLeastSquares())
        if unknown := set(np.unique(labels).tolist()) - set(self.classes_.tolist()):
            raise ValueError(f"class {min(unknown)} is not among {self.classes_.tolist()}: name all at the first call")
        return self.filter_.learn(features, (labels[:, np.newaxis] == self.classes_).astype(np.float64))


class OnlineRegressor(RegressorMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn ships no types
    """Linear regression that learns shot by shot, of one target or several; features as in `OnlineClassifier`.

    Args:
        rule: How weights follow; None = `RecursiveLeastSquares()`.

    Attributes:
        n_features_in_: Number of features.
    """

    def __init__(self, rule: Rule | None = None) -> None:
        self.rule = rule

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:  # noqa: N803
        """Forget everything, then learn from the shots in their order.

        Raises:
            ValueError: too few shots, or settings of the rule that are wrong.
        """
        if hasattr(self, "filter_"):
            del self.filter_
        return self.partial_fit(X, y)

    def partial_fit(self, X: ArrayLike, y: ArrayLike) -> Self:  # noqa: N803
        """Learn from further shots (shots, features), targets (shots,) or (shots, outputs), in their order.

        Raises:
            ValueError: other features or outputs, too few shots at the first call.
        """
        self._learn(X, y)
        return self

    def follow(self, X: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """Predict each shot, then learn from it: the prediction for each, shaped as `y`, before its target was known.

        Raises:
            ValueError: as in `partial_fit`.
            sklearn.exceptions.NotFittedError: There were no shots to begin with.
        """
        check_is_fitted(self)
        return self._learn(X, y)

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """The targets of each shot, (shots,) or (shots, outputs) as they were given."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=np.float64, reset=False)
        return self._shaped(self.filter_.outputs(features))

    def _learn(self, X: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        first = not hasattr(self, "filter_")
        features, given = validate_data(
            self, X, y, dtype=np.float64, reset=first, ensure_min_samples=1 + first, multi_output=True, y_numeric=True
        )
        targets = np.asarray(given, np.float64).reshape(len(given), -1)
        if first:
            self.filter_ = _Filter(features, targets.shape[1], self.rule or RecursiveLeastSquares())
            self._flat = given.ndim == 1
        return self._shaped(self.filter_.learn(features, targets))

    def _shaped(self, outputs: NDArray[np.float64]) -> NDArray[np.float64]:
        return outputs[:, 0] if self._flat else outputs

    def __sklearn_tags__(self) -> Tags:
        """What scikit-learn may ask of it."""
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        return tags


class _Filter:
    """Outputs W u of u = (1, standardised features): (outputs, weights) W, and the gain by which it follows."""

    def __init__(self, features: NDArray[np.float64], outputs: int, rule: Rule) -> None:
        self._mean = features.mean(axis=0)
        self._scale = units(features.std(axis=0), self._mean, len(features))
        self._gain = rule.gain(1 + features.shape[1])
        self._weights = np.zeros((outputs, 1 + features.shape[1]))

    def outputs(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """(shots, outputs)."""
        return np.asarray(self._inputs(features) @ self._weights.T)

    def learn(self, features: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64]:
        """The outputs (shots, outputs) of each shot before it is learnt; shots are learnt in their order.

        Raises:
            ValueError: not as many targets as there were.
        """
        if targets.shape[1] != len(self._weights):
            raise ValueError(
                f"{targets.shape[1]} targets a shot, the first call had {len(self._weights)}: give as many"
            )
        before = np.empty_like(targets)
        for place, (inputs, target) in enumerate(zip(self._inputs(features), targets, strict=True)):
            before[place] = self._weights @ inputs
            self._weights += np.outer(target - before[place], self._gain(inputs))
        return before

    def _inputs(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack((np.ones(len(features)), (features - self._mean) / self._scale))


class _LeastSquares:
    def __init__(self, weights: int, forgetting: float, penalty: float) -> None:
        self._forgetting = forgetting
        self._inverse = np.eye(weights) / penalty
        self._most = weights / penalty

    def __call__(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        root = self._inverse @ inputs
        divisor = np.sqrt(self._forgetting + inputs @ root)
        root /= divisor
        self._inverse -= np.outer(root, root)
        self._inverse *= min(1 / self._forgetting, self._most / np.trace(self._inverse))
        return np.asarray(root / divisor)


class _LeastMeanSquares:
    def __init__(self, step: float) -> None:
        self._step = step

    def __call__(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._step / (inputs @ inputs) * inputs
