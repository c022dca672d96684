"""Readouts that follow: what they are at rest, that they follow, and that nothing makes them lose their way."""

import re
import warnings
from typing import Any

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import Ridge
from sklearn.utils.estimator_checks import parametrize_with_checks

from labctl.analysis.online import (
    NormalisedLeastMeanSquares,
    OnlineClassifier,
    OnlineRegressor,
    RecursiveLeastSquares,
)

NLMS = NormalisedLeastMeanSquares(step=0.2)


ESTIMATORS = [OnlineClassifier(), OnlineClassifier(NLMS), OnlineRegressor(), OnlineRegressor(NLMS)]


@parametrize_with_checks(ESTIMATORS)  # type: ignore[untyped-decorator]
def test_they_keep_scikit_learns_conventions(estimator: Any, check: Any) -> None:
    check(estimator)


def shots(count: int, features: int = 6, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Features of another mean and scale each, and targets of two outputs that are linear in them but for noise."""
    generator = np.random.default_rng(seed)
    x = generator.normal(size=(count, features)) * 10.0 ** np.arange(-features // 2, features - features // 2) + 3
    weights = generator.normal(size=(features, 2)) / x.std(axis=0)[:, np.newaxis]
    return x, x @ weights + 0.1 * generator.normal(size=(count, 2))


def test_least_squares_are_those_of_all_shots_by_their_age() -> None:
    """What one would find by weighted ridge regression of everything that was seen, at any time."""
    x, y = shots(400)
    forgetting, penalty = 0.99, 0.5
    readout = OnlineRegressor(RecursiveLeastSquares(forgetting, penalty)).partial_fit(x[:50], y[:50])
    for row in range(50, 400):
        readout.partial_fit(x[row : row + 1], y[row : row + 1])
    inputs = np.column_stack((np.ones(400), (x - x[:50].mean(axis=0)) / x[:50].std(axis=0)))
    age = forgetting ** np.arange(399, -1, -1)
    expected = Ridge(alpha=penalty * forgetting**400, fit_intercept=False, tol=1e-12).fit(inputs, y, sample_weight=age)
    np.testing.assert_allclose(readout.predict(x), expected.predict(inputs), rtol=0, atol=1e-8)


@pytest.mark.parametrize("rule", [RecursiveLeastSquares(), NLMS])
def test_one_call_or_many_are_the_same_and_each_prediction_comes_before_its_label(
    rule: RecursiveLeastSquares | NormalisedLeastMeanSquares,
) -> None:
    x, y = shots(120)
    at_once, one_by_one = (OnlineRegressor(clone(rule)).partial_fit(x[:40], y[:40]) for _ in range(2))
    predictions = []
    for row in range(40, 120):
        predictions.append(one_by_one.predict(x[row : row + 1])[0])
        one_by_one.partial_fit(x[row : row + 1], y[row : row + 1])
    np.testing.assert_allclose(at_once.follow(x[40:], y[40:]), predictions, rtol=1e-9)
    with pytest.raises(NotFittedError):
        OnlineRegressor().follow(x, y)


@pytest.mark.parametrize("rule", [RecursiveLeastSquares(), NormalisedLeastMeanSquares()])
def test_they_follow_what_a_frozen_readout_loses(
    rule: RecursiveLeastSquares | NormalisedLeastMeanSquares,
) -> None:
    """Two classes whose difference turns round slowly: in the end each has the features of the other."""
    generator = np.random.default_rng(2)
    labels = generator.integers(0, 2, 4000)
    angle = np.linspace(0, np.pi, 4000)
    direction = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    features = generator.normal(size=(4000, 2)) + 4 * (labels - 0.5)[:, np.newaxis] * direction
    readout = OnlineClassifier(rule).partial_fit(features[:100], labels[:100])
    frozen = clone(readout).fit(features[:100], labels[:100])
    followed = readout.follow(features[100:], labels[100:]) == labels[100:]
    assert followed[-500:].mean() > 0.95
    assert np.mean(frozen.predict(features[-500:]) == labels[-500:]) < 0.1


def test_shots_that_say_nothing_new_do_not_wind_it_up() -> None:
    """A blocked beam: one feature vector for longer than 1 / lambda^n can be told from infinity, then light again."""
    x, y = shots(300)
    readout = OnlineRegressor(RecursiveLeastSquares(forgetting=0.95)).partial_fit(x[:100], y[:100])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        readout.partial_fit(np.repeat(x[:1], 20_000, axis=0), np.repeat(y[:1], 20_000, axis=0))
        readout.partial_fit(x[100:], y[100:])
    assert np.abs(readout.predict(x[100:]) - y[100:]).max() < 1


@pytest.mark.parametrize(
    ("rule", "told"),
    [
        (RecursiveLeastSquares(forgetting=0.9), r"7 weights need a memory of 14 shots.*choose from 0.928572 to 1"),
        (RecursiveLeastSquares(forgetting=1.1), "choose from"),
        (RecursiveLeastSquares(penalty=0), "choose one above 0"),
        (NormalisedLeastMeanSquares(step=2), "choose one between 0 and 2"),
    ],
)
def test_settings_that_lose_their_way_are_refused(
    rule: RecursiveLeastSquares | NormalisedLeastMeanSquares, told: str
) -> None:
    with pytest.raises(ValueError, match=told):
        OnlineRegressor(rule).fit(*shots(30))


@pytest.mark.parametrize("weights", [7, 51, 1000])
def test_the_least_memory_that_is_named_is_taken(weights: int) -> None:
    with pytest.raises(ValueError, match="choose from") as refused:
        RecursiveLeastSquares(forgetting=0.5).gain(weights)
    named = re.search(r"choose from ([0-9.]+) to 1", str(refused.value))
    assert named is not None
    RecursiveLeastSquares(forgetting=float(named[1])).gain(weights)


def test_a_class_that_was_not_named_is_refused() -> None:
    x, _ = shots(30)
    readout = OnlineClassifier().partial_fit(x, np.arange(30) % 2, classes=[0, 1, 2])
    readout.partial_fit(x[:1], [2])
    with pytest.raises(ValueError, match="class 7 is not among"):
        readout.partial_fit(x[:1], [7])


def test_as_many_targets_as_at_first() -> None:
    x, y = shots(30)
    with pytest.raises(ValueError, match="1 targets a shot, the first call had 2"):
        OnlineRegressor().fit(x, y).partial_fit(x, y[:, 0])
