import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.datasets import load_digits
from sklearn.dummy import DummyClassifier

from labctl.analysis.evaluation import cross_validated_accuracy
from labctl.analysis.learning_curve import learning_curve
from labctl.errors import AnalysisError


class Listener(ClassifierMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn ships no types
    """Learns nothing; notes which shots it was shown. Features are the shots' own numbers."""

    seen: list[tuple[list[int], list[int]]] = []  # noqa: RUF012  # shared on purpose: every split works on a clone

    def fit(self, X: np.ndarray, y: np.ndarray) -> "Listener":  # noqa: N803
        self.classes_ = np.unique(y)
        self.train_ = X[:, 0].tolist()
        return self

    def predict(self, X: np.ndarray) -> np.ndarray:  # noqa: N803
        Listener.seen.append((self.train_, X[:, 0].tolist()))
        return np.zeros(len(X))


def test_more_images_recognise_better_up_to_all_of_them() -> None:
    images, labels = load_digits(n_class=6, return_X_y=True)
    images, labels = images[:500], labels[:500]
    groups = np.arange(500)
    curve = learning_curve(images, labels, groups, (20, 100, 450), splits=3, seed=1)
    means = [float(point.scores.mean()) for point in curve]
    assert [point.images for point in curve] == [20, 100, 450]
    assert means[0] + 0.02 < means[1] < means[2]
    whole = cross_validated_accuracy(images, labels, groups, splits=3, seed=1)
    np.testing.assert_array_equal(curve[2].scores, whole)
    again = learning_curve(images, labels, groups, (100,), splits=3, seed=1)
    np.testing.assert_array_equal(again[0].scores, curve[1].scores)


@settings(max_examples=25)
@given(st.integers(0, 99), st.lists(st.integers(1, 3), min_size=40, max_size=60))
def test_training_sets_are_nested_balanced_and_apart_from_the_test(seed: int, repeats: list[int]) -> None:
    groups = np.random.default_rng(seed).permutation(np.repeat(np.arange(len(repeats)), repeats))
    labels = groups % 4
    numbers = np.arange(groups.size)[:, np.newaxis]
    Listener.seen = []
    learning_curve(numbers, labels, groups, (8, 20), splits=2, seed=seed, readout=Listener())
    small, large = Listener.seen[:2], Listener.seen[2:]
    for (fewer, test), (more, same_test) in zip(small, large, strict=True):
        assert test == same_test
        assert set(fewer) < set(more)
        assert not set(groups[more]) & set(groups[test])
        assert (len(set(groups[fewer])), len(set(groups[more]))) == (8, 20)
        assert [len({group for group in groups[more] if group % 4 == label}) for label in range(4)] == pytest.approx(
            [5] * 4, abs=1
        )


def test_numbers_of_images_that_cannot_be_are_refused() -> None:
    labels, groups = np.arange(100) % 4, np.arange(100)
    features = np.zeros((100, 1))
    readout = DummyClassifier()
    for size in (0, 91):
        with pytest.raises(AnalysisError, match="ask for 1 to 90"):
            learning_curve(features, labels, groups, (size,), seed=1, readout=readout)
    with pytest.raises(AnalysisError, match=r"leave class \d without any"):
        learning_curve(features, labels, groups, (3,), seed=1, readout=readout)
    rare = np.where(np.arange(100) < 3, 1, 0)
    with pytest.raises(AnalysisError, match="leave class 1 without any"):
        learning_curve(features, rare, groups, (2,), splits=1, seed=1, readout=readout)
