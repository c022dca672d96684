from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import mahalanobis
from sklearn.covariance import LedoitWolf
from sklearn.datasets import load_digits
from sklearn.metrics import roc_auc_score
from sklearn.utils.estimator_checks import parametrize_with_checks

from labctl.analysis.anomaly import CovarianceScore, NormalityScore, roc
from labctl.errors import AnalysisError


@parametrize_with_checks([NormalityScore(), CovarianceScore(), CovarianceScore(shrinkage=0.2)])  # type: ignore[untyped-decorator]
def test_they_are_estimators_like_any_other(estimator: Any, check: Any) -> None:
    check(estimator)


@pytest.fixture(scope="module")
def speckle() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Digit 0 as the normal image and all others as abnormal ones, through random masks and a square-law detector."""
    images, labels = load_digits(return_X_y=True)
    generator = np.random.default_rng(1)
    masks = generator.normal(size=(64, 20)) + 1j * generator.normal(size=(64, 20))
    features = np.abs(images @ masks) ** 2
    normal = features[labels == 0]
    return normal[:120], normal[120:], features[labels != 0]


def test_normal_shots_score_low_and_others_high(speckle: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    train, normal, abnormal = speckle
    features = np.vstack([normal, abnormal])
    truth = np.arange(len(features)) >= len(normal)
    for estimator in (NormalityScore(), CovarianceScore()):
        scores = estimator.fit(train).score_samples(features)
        assert scores.shape == (len(features),)
        assert scores.min() >= 0
        assert np.median(scores[truth]) > np.median(scores[~truth])
    assert roc(CovarianceScore().fit(train).score_samples(features), truth).auc > 0.95


def test_the_weights_are_those_of_the_closed_form(speckle: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    train, normal, _ = speckle
    score = NormalityScore(alpha=0.05).fit(train)
    scaled = train / train.mean(axis=0)
    gram = scaled.T @ scaled
    weights = np.linalg.solve(gram + 0.05 * np.trace(gram) / 20 * np.eye(20), scaled.sum(axis=0))
    np.testing.assert_allclose(score.coef_, weights)
    np.testing.assert_allclose(score.output(normal), normal / train.mean(axis=0) @ weights)
    np.testing.assert_allclose(score.score_samples(normal), (score.output(normal) - 1) ** 2)


def test_the_answer_is_not_in_a_bias(speckle: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """With a free bias the readout would answer 1 to everything, darkness included."""
    train, _, abnormal = speckle
    score = NormalityScore().fit(train)
    np.testing.assert_array_equal(score.output(np.zeros((1, 20))), [0])
    np.testing.assert_allclose(score.output(2 * train), 2 * score.output(train))
    assert np.abs(score.output(train).mean() - 1) < 0.05
    assert score.score_samples(abnormal).std() > 1e-3


@given(st.lists(st.floats(0.01, 100), min_size=4, max_size=4))
def test_the_gain_of_a_port_does_not_matter(gains: list[float]) -> None:
    features = np.random.default_rng(2).exponential(size=(30, 4))
    fresh = np.random.default_rng(3).exponential(size=(5, 4))
    for estimator in (NormalityScore(), CovarianceScore()):
        plain = estimator.fit(features).score_samples(fresh)
        scaled = estimator.fit(features * gains).score_samples(fresh * gains)
        np.testing.assert_allclose(scaled, plain, rtol=1e-6)


@given(st.integers(0, 2**32 - 1))
def test_without_shrinkage_the_distance_is_the_same_in_all_linear_combinations(seed: int) -> None:
    generator = np.random.default_rng(seed)
    features, fresh = generator.normal(size=(40, 3)), generator.normal(size=(6, 3))
    turned = np.linalg.qr(generator.normal(size=(3, 3)))[0] @ np.diag([0.1, 1, 10])
    shift = generator.normal(size=3)
    score = CovarianceScore(shrinkage=0.0)
    plain = score.fit(features).score_samples(fresh)
    mapped = score.fit(features @ turned + shift).score_samples(fresh @ turned + shift)
    np.testing.assert_allclose(mapped, plain, rtol=1e-6)


def test_the_distance_is_mahalanobis_and_the_shrinkage_ledoit_and_wolfs(
    speckle: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    train, normal, _ = speckle
    inverse = np.linalg.inv(np.cov(train.T, bias=True))
    expected = [mahalanobis(shot, train.mean(axis=0), inverse) for shot in normal]
    np.testing.assert_allclose(CovarianceScore(shrinkage=0.0).fit(train).score_samples(normal), expected)
    standard = (train - train.mean(axis=0)) / train.std(axis=0)
    score = CovarianceScore().fit(train)
    assert score.shrinkage_ == pytest.approx(LedoitWolf(assume_centered=True).fit(standard).shrinkage_)
    few = CovarianceScore().fit(train[:10])
    assert few.shrinkage_ > score.shrinkage_
    assert np.isfinite(few.score_samples(normal)).all()
    assert score.score_samples(train.mean(axis=0, keepdims=True)) == 0


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(AnalysisError, match="use one above zero"):
        NormalityScore(alpha=0).fit(np.ones((3, 2)))
    with pytest.raises(AnalysisError, match="use 0 to 1"):
        CovarianceScore(shrinkage=1.5).fit(np.ones((3, 2)))


@given(st.lists(st.tuples(st.integers(-5, 5), st.booleans()), min_size=2, max_size=40))
def test_the_area_is_that_of_ranks_and_of_scikit_learn(shots: list[tuple[int, bool]]) -> None:
    scores = np.array([score for score, _ in shots])
    truth = np.array([abnormal for _, abnormal in shots])
    if truth.all() or not truth.any():
        with pytest.raises(AnalysisError, match="one kind"):
            roc(scores, truth)
        return
    curve = roc(scores, truth)
    assert curve.auc == pytest.approx(roc_auc_score(truth, scores))
    pairs = np.subtract.outer(scores[truth], scores[~truth])
    assert curve.auc == pytest.approx(np.mean(pairs > 0) + np.mean(pairs == 0) / 2)
    assert roc(-scores, truth).auc == pytest.approx(1 - curve.auc)
    assert (curve.false_positive[0], curve.true_positive[0]) == (0, 0)
    assert (curve.false_positive[-1], curve.true_positive[-1]) == (1, 1)
    assert np.all(np.diff(curve.false_positive) >= 0)
    for threshold, share in zip(curve.thresholds, curve.true_positive, strict=True):
        assert share == pytest.approx(np.mean(scores[truth] >= threshold))


def test_scores_that_make_no_curve_are_refused() -> None:
    with pytest.raises(AnalysisError, match="one score a shot"):
        roc([1.0, 2.0], [True])
    with pytest.raises(AnalysisError, match="not finite"):
        roc([1.0, np.nan], [True, False])
