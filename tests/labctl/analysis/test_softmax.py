import tracemalloc

import numpy as np
import pytest
from sklearn.datasets import load_digits
from sklearn.linear_model import LogisticRegression
from sklearn.preprocessing import StandardScaler

from labctl.analysis.readouts import softmax_classifier
from labctl.analysis.softmax import SoftmaxRegression

Data = tuple[np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def smooth() -> Data:
    """Real digits behind running sums: neighbouring features are much alike, as neighbouring samples of a trace are."""
    images, labels = load_digits(return_X_y=True)
    sums = np.cumsum(np.cumsum(images - images.mean(axis=0), axis=1), axis=1)
    return StandardScaler().fit_transform(sums).astype(np.float32), labels


def loss(model: SoftmaxRegression | LogisticRegression, features: np.ndarray, labels: np.ndarray) -> float:
    scores = features.astype(np.float64) @ model.coef_.T + model.intercept_
    scores -= scores.max(axis=1, keepdims=True)
    entropy = np.log(np.exp(scores).sum(axis=1)) - scores[np.arange(labels.size), labels]
    return float(entropy.mean() + (model.coef_**2).sum() / (2 * model.C * labels.size))


def test_it_finds_the_same_optimum_as_newtons_method(smooth: Data) -> None:
    features, labels = smooth
    exact = LogisticRegression(solver="newton-cholesky", tol=1e-10).fit(features.astype(np.float64), labels)
    found = SoftmaxRegression(tol=1e-7).fit(features.astype(np.float64), labels)
    assert loss(found, features, labels) == pytest.approx(loss(exact, features, labels), rel=1e-6)
    np.testing.assert_allclose(found.predict_proba(features), exact.predict_proba(features), atol=2e-4)


@pytest.mark.parametrize("weak", [1e2, 1e4, 1e6])
def test_a_weak_penalty_is_balanced_too(weak: float) -> None:
    """Where all shots are recognised, the loss alone is soon below any tolerance: the penalty decides the optimum."""
    images, labels = (some[::6] for some in load_digits(return_X_y=True))
    features = images.astype(np.float32)
    scaler, found = softmax_classifier(weak).fit(features, labels)
    standard = scaler.transform(features)
    exact = LogisticRegression(C=weak, solver="newton-cholesky", tol=1e-12, max_iter=1000)
    exact.fit(standard.astype(np.float64), labels)
    assert found.score(standard, labels) == 1
    assert loss(found, standard, labels) == pytest.approx(loss(exact, standard, labels), rel=0.01)


def test_features_that_are_alike_cost_few_steps(smooth: Data) -> None:
    """What plain L-BFGS does in several times as many steps, to a loss that is no lower."""
    features, labels = smooth
    plain = LogisticRegression(max_iter=10_000).fit(features, labels)
    found = SoftmaxRegression().fit(features, labels)
    assert found.n_iter_ < plain.n_iter_[0] / 2
    assert loss(found, features, labels) < 1.01 * loss(plain, features, labels)


def test_units_of_the_features_cost_no_steps() -> None:
    images, labels = load_digits(return_X_y=True)
    millivolts = SoftmaxRegression(C=1e9, max_iter=60, tol=1e-3).fit(images * 1e-3, labels)
    volts = SoftmaxRegression(C=1e3, max_iter=60, tol=1e-3).fit(images, labels)
    np.testing.assert_array_equal(millivolts.predict(images * 1e-3), volts.predict(images))


def test_two_classes_are_told_apart_like_any_others() -> None:
    images, labels = load_digits(return_X_y=True)
    names = np.where(labels % 2, "odd", "even")
    found = SoftmaxRegression().fit(images / 16, names)
    assert found.coef_.shape == (2, 64)
    assert found.score(images / 16, names) > 0.9
    np.testing.assert_allclose(found.predict_proba(images / 16).sum(axis=1), 1)


def test_one_class_cannot_be_learnt() -> None:
    with pytest.raises(ValueError, match="one class"):
        SoftmaxRegression().fit(np.eye(3), np.zeros(3, int))


def test_too_few_steps_are_told() -> None:
    images, labels = load_digits(return_X_y=True)
    with pytest.warns(UserWarning, match="2 steps"):
        SoftmaxRegression(max_iter=2).fit(images, labels)


def wide(shots: int, features: int) -> Data:
    """Noise whose neighbouring features are alike, and two classes that one of them knows."""
    labels = np.arange(shots) % 2
    noise = np.cumsum(np.random.default_rng(1).standard_normal((shots, features)), axis=1)
    noise[:, 0] += 3 * labels
    return StandardScaler().fit_transform(noise), labels


def test_more_features_than_shots_give_what_each_shot_several_times_gives() -> None:
    """Which changes nothing in what is minimised, and leaves fewer features than shots."""
    features, labels = wide(24, 180)
    found = SoftmaxRegression(tol=1e-10).fit(features, labels)
    often = SoftmaxRegression(C=1 / 10, tol=1e-10).fit(np.tile(features, (10, 1)), np.tile(labels, 10))
    np.testing.assert_allclose(found.coef_, often.coef_, atol=1e-8)
    np.testing.assert_allclose(found.intercept_, often.intercept_, atol=1e-8)
    np.testing.assert_allclose(found.predict_proba(features), often.predict_proba(features), atol=1e-8)


def test_many_more_features_than_shots_take_no_memory_for_each_pair_of_features() -> None:
    features, labels = wide(20, 3000)
    tracemalloc.start()
    try:
        SoftmaxRegression().fit(features, labels)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 10 * features.nbytes
