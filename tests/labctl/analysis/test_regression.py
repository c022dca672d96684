import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.datasets import load_diabetes
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.metrics import r2_score
from sklearn.model_selection import LeaveOneOut, cross_val_predict
from sklearn.preprocessing import StandardScaler

from labctl.analysis.regression import ALPHAS, nmse, ridge_readout, rmse
from labctl.errors import AnalysisError


@pytest.fixture(scope="module")
def diabetes() -> tuple[np.ndarray, np.ndarray]:
    features, target = load_diabetes(return_X_y=True, scaled=False)
    return features, target


@given(st.integers(2, 50), st.integers(0, 2**32 - 1))
def test_predicting_the_mean_has_an_nmse_of_one(size: int, seed: int) -> None:
    target = np.random.default_rng(seed).normal(3, 2, size)
    assert nmse(target, np.full(size, target.mean())) == pytest.approx(1)
    assert nmse(target, target) == 0
    assert nmse(10 * target - 7, np.zeros(size)) > 0


@given(st.floats(0.1, 100), st.floats(-100, 100))
def test_nmse_has_no_units(gain: float, level: float) -> None:
    generator = np.random.default_rng(5)
    target, predicted = generator.normal(size=(2, 30))
    assert nmse(gain * target + level, gain * predicted + level) == pytest.approx(nmse(target, predicted), rel=1e-6)


def test_nmse_is_one_minus_the_coefficient_of_determination() -> None:
    target, predicted = np.random.default_rng(2).normal(size=(2, 40))
    assert nmse(target, predicted) == pytest.approx(1 - r2_score(target, predicted))
    targets, many = np.random.default_rng(2).normal(size=(2, 40, 3))
    assert nmse(targets, many) == pytest.approx(1 - r2_score(targets, many, multioutput="variance_weighted"))


def test_rmse_is_over_all_pixels_and_images() -> None:
    images = np.zeros((2, 2, 2))
    assert rmse(images, images + 0.5) == 0.5
    predicted = images.copy()
    predicted[1, 1, 1] = 1.0
    assert rmse(images, predicted) == pytest.approx(np.sqrt(1 / 8))
    assert rmse(np.array([[0, 255]], np.uint8), np.array([[255, 0]], np.uint8)) == 255


def test_what_cannot_be_compared_is_refused() -> None:
    with pytest.raises(AnalysisError, match="one prediction for each target"):
        nmse(np.zeros(3), np.zeros((3, 1)))
    with pytest.raises(AnalysisError, match="one prediction for each target"):
        rmse(np.zeros(0), np.zeros(0))
    with pytest.raises(AnalysisError, match="constant"):
        nmse(np.ones(3), np.zeros(3))


def test_ridge_equals_the_closed_form(diabetes: tuple[np.ndarray, np.ndarray]) -> None:
    features, target = diabetes
    readout = ridge_readout(alphas=[30.0]).fit(features, target)
    standard = (features - features.mean(axis=0)) / features.std(axis=0)
    weights = np.linalg.solve(standard.T @ standard + 30 * np.eye(10), standard.T @ (target - target.mean()))
    np.testing.assert_allclose(readout.predict(features), standard @ weights + target.mean())


def test_the_penalty_is_the_best_when_each_shot_is_left_out(diabetes: tuple[np.ndarray, np.ndarray]) -> None:
    features, target = diabetes[0][:120], diabetes[1][:120]
    chosen = ridge_readout().fit(features, target)[-1].alpha_
    standard = StandardScaler().fit_transform(features)
    errors = {
        alpha: nmse(target, cross_val_predict(Ridge(alpha=alpha), standard, target, cv=LeaveOneOut()))
        for alpha in (*ALPHAS[::2], chosen)
    }
    assert min(errors, key=lambda alpha: errors[alpha]) == chosen


def test_nothing_is_learnt_from_noise_and_everything_from_a_line() -> None:
    generator = np.random.default_rng(1)
    features = generator.normal(size=(60, 50))
    unrelated, unseen = generator.normal(size=(2, 60))
    fresh = generator.normal(size=(60, 50))
    assert nmse(unseen, ridge_readout().fit(features, unrelated).predict(fresh)) < 1.2
    assert nmse(unseen, LinearRegression().fit(features, unrelated).predict(fresh)) > 2
    line = features @ generator.normal(size=50) + 5
    assert nmse(line, ridge_readout().fit(features, line).predict(features)) < 1e-6


def test_several_outputs_and_a_dead_feature() -> None:
    generator = np.random.default_rng(3)
    features = generator.normal(size=(50, 4))
    features[:, 2] = 7.0
    targets = np.column_stack([features[:, 0], features[:, 1] - 3])
    predicted = ridge_readout().fit(features, targets).predict(features)
    assert predicted.shape == (50, 2)
    assert nmse(targets, predicted) < 1e-6


def test_single_precision_features_serve_as_well() -> None:
    generator = np.random.default_rng(4)
    features = generator.normal(size=(3000, 3)) @ generator.normal(size=(3, 52)) + 0.07 * generator.normal(size=52)
    target = np.tanh(features[:, 0])
    double, single = (ridge_readout().fit(features.astype(kind), target) for kind in (np.float64, np.float32))
    assert single[-1].alpha_ == double[-1].alpha_
    np.testing.assert_allclose(single.predict(features), double.predict(features), atol=1e-3)
