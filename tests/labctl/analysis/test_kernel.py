import numpy as np
import pytest
from sklearn.datasets import load_digits
from sklearn.kernel_ridge import KernelRidge

from labctl.analysis import kernel
from labctl.analysis.kernel import KernelClassifier

IMAGES, LABELS = load_digits(return_X_y=True)


def test_with_every_shot_a_landmark_it_is_kernel_ridge_regression(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel, "JITTER", 0.0)
    train, test = IMAGES[:500], IMAGES[500:]
    found = KernelClassifier(landmarks=500, gammas=(1.0,), alphas=(1e-3,)).fit(train, LABELS[:500])
    indicators = LABELS[:500, np.newaxis] == np.arange(10)
    shares = indicators.mean(axis=0)
    exact = KernelRidge(alpha=1e-3 * 500, kernel="rbf", gamma=1 / train.var(axis=0).sum())
    answers = exact.fit(train, indicators - shares).predict(test) + shares
    assert np.mean(found.predict(test) == np.argmax(answers, axis=1)) > 0.995


def test_it_sees_what_no_line_divides() -> None:
    generator = np.random.default_rng(1)
    points = generator.normal(size=(1500, 2))
    rings = np.where(np.linalg.norm(points, axis=1) > 1.2, "outer", "inner")
    found = KernelClassifier(landmarks=100).fit(points[:1000], rings[:1000])
    assert found.score(points[1000:], rings[1000:]) > 0.95


def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = KernelClassifier(landmarks=200).fit(IMAGES[:900], LABELS[:900])
    monkeypatch.setattr(kernel, "BLOCK_SHOTS", 77)
    parts = KernelClassifier(landmarks=200).fit(IMAGES[:900], LABELS[:900])
    assert (parts.gamma_, parts.alpha_) == (whole.gamma_, whole.alpha_)
    np.testing.assert_array_equal(parts.predict(IMAGES[900:]), whole.predict(IMAGES[900:]))
    assert whole.score(IMAGES[900:], LABELS[900:]) > 0.93


def test_units_of_the_features_change_nothing() -> None:
    volts = KernelClassifier(landmarks=200).fit(IMAGES[:900], LABELS[:900])
    millivolts = KernelClassifier(landmarks=200).fit(1000 * IMAGES[:900], LABELS[:900])
    assert millivolts.gamma_ == volts.gamma_
    np.testing.assert_array_equal(millivolts.predict(1000 * IMAGES[900:]), volts.predict(IMAGES[900:]))


def test_images_all_alike_are_no_failure() -> None:
    found = KernelClassifier().fit(np.ones((10, 3)), np.arange(10) % 2)
    assert set(found.predict(np.ones((4, 3)))) <= {0, 1}


def test_one_class_cannot_be_learnt() -> None:
    with pytest.raises(ValueError, match="one class"):
        KernelClassifier().fit(np.eye(3), np.zeros(3, int))
