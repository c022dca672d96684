import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.datasets import load_digits

from labctl.analysis.evaluation import (
    STANDARD_ERRORS,
    accuracy_against_window,
    control,
    cross_validated_accuracy,
    mean_and_sd,
    shuffled_labels,
    validate,
    window_key,
)
from labctl.analysis.readouts import softmax_classifier
from labctl.analysis.splits import enough_splits, forward_in_time_split, own_split, random_splits
from labctl.analysis.windows import WindowFeatures
from labctl.errors import AnalysisError, TooFewImages

TAU = 40e-12


@pytest.fixture(scope="module")
def digits() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Real images of digits 0-3, seen through a complex random matrix and a square-law detector."""
    images, labels = load_digits(return_X_y=True)
    images, labels = images[labels < 4], labels[labels < 4]
    generator = np.random.default_rng(1)
    masks = generator.normal(size=(64, 5 * 25)) + 1j * generator.normal(size=(64, 5 * 25))
    frames = np.abs(images @ masks).reshape(-1, 5, 25) ** 2
    return (120 * frames / frames.max()).astype(np.int8), labels, np.arange(labels.size)


def test_a_thousand_shots_give_900_and_100() -> None:
    labels, groups = np.arange(1000) % 4, np.arange(1000)
    splits = list(random_splits(labels, groups, splits=3, seed=1))
    assert [(train.size, test.size) for train, test in splits] == [(900, 100)] * 3
    assert all(np.bincount(labels[test]).tolist() == [25] * 4 for _, test in splits)
    again = list(random_splits(labels, groups, splits=3, test_size=100, seed=1))
    assert all(np.array_equal(one[1], other[1]) for one, other in zip(splits, again, strict=True))
    other_seed = next(random_splits(labels, groups, splits=3, seed=2))
    assert not np.array_equal(splits[0][1], other_seed[1])


@given(st.integers(0, 99), st.lists(st.integers(1, 5), min_size=30, max_size=40))
def test_repeats_of_an_image_stay_on_one_side(seed: int, repeats: list[int]) -> None:
    generator = np.random.default_rng(seed)
    groups = generator.permutation(np.repeat(np.arange(len(repeats)), repeats))
    labels = groups % 3
    for train, test in random_splits(labels, groups, splits=4, test_size=0.2, seed=seed):
        assert not set(groups[train]) & set(groups[test])
        assert sorted([*train, *test]) == list(range(groups.size))
        assert set(labels[test]) == {0, 1, 2}


def test_splits_that_cannot_be_are_refused() -> None:
    with pytest.raises(AnalysisError, match="group 0 have different labels"):
        list(random_splits(np.array([0, 1, 0, 1]), np.array([0, 0, 1, 2]), seed=1))
    with pytest.raises(AnalysisError, match="cannot be split"):
        list(random_splits(np.arange(20) % 4, np.arange(20), seed=1))
    with pytest.raises(AnalysisError, match="change the test part"):
        list(random_splits(np.arange(20) % 4, np.arange(20), test_size=2, seed=1))
    with pytest.raises(AnalysisError, match="leaves nothing on one side"):
        list(random_splits(np.arange(20) % 4, np.arange(20), test_size=20, seed=1))
    with pytest.raises(TooFewImages, match="all images are of one class: acquire images of other classes too"):
        list(random_splits(np.zeros(1), np.arange(1), test_size=0.5, seed=1))


@pytest.mark.parametrize(("classes", "test_size"), [(2, 0.1), (3, 0.1), (4, 0.1), (10, 0.1), (3, 0.75)])
def test_as_many_images_as_are_asked_for_can_be_split(classes: int, test_size: float) -> None:
    with pytest.raises(TooFewImages, match="images, two or more of each, are enough") as refused:
        list(random_splits(np.arange(classes), np.arange(classes), test_size=test_size, seed=1))
    named = re.search(r"(\d+) images, two or more", str(refused.value))
    assert named is not None
    images = np.arange(int(named[1]))
    assert list(random_splits(images % classes, images, splits=1, test_size=test_size, seed=1))


@given(st.integers(20, 1_000_000))
def test_large_sets_are_split_less_often(images: int) -> None:
    splits = enough_splits(images)
    assert 2 <= splits <= 10
    assert splits == 10 or splits * 0.1 * images >= 4000


def test_a_set_may_have_a_split_of_its_own() -> None:
    train, test = own_split(np.array([7, 2, 5, 2, 9]), 6)
    assert (train.tolist(), test.tolist()) == ([1, 2, 3], [0, 4])
    with pytest.raises(AnalysisError, match=r"all 5 shots are of the data set's training part: show images of both"):
        own_split(np.arange(5), 5)
    with pytest.raises(AnalysisError, match="test part"):
        own_split(np.arange(5), 0)


def test_the_future_is_not_trained_on() -> None:
    order = np.random.default_rng(0).permutation(50)
    train, test = forward_in_time_split(np.arange(50), test_size=0.2, order=order)
    assert (train.size, test.size) == (40, 10)
    assert order[train].max() < order[test].min()
    repeated = np.arange(50) % 30
    train, test = forward_in_time_split(repeated, test_size=10)
    assert test.tolist() == list(range(40, 50))
    assert not set(repeated[train]) & set(repeated[test])
    with pytest.raises(AnalysisError, match="no shot is left"):
        forward_in_time_split(np.zeros(50))


def test_real_digits_are_recognised_better_with_longer_windows(
    digits: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    frames, labels, groups = digits
    windows = (0.08e-9, 0.4e-9, 1e-9)
    table = accuracy_against_window(
        frames, labels, groups, windows_s=windows, window=WindowFeatures(sample_interval_s=TAU), splits=3, seed=2
    )
    means = [float(row.scores.mean()) for row in table]
    assert [row.features for row in table] == [10, 50, 125]
    assert table[1].compressive_ratio == 10 / 784
    assert means[0] < means[1] <= means[2]
    assert means[0] > 0.6
    assert means[2] > 0.95


def test_every_acquisition_time_is_judged_by_the_readout_that_is_asked_about(
    digits: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    frames, labels, groups = digits
    window = WindowFeatures(sample_interval_s=TAU, window_s=0.4e-9)
    strict = softmax_classifier().set_params(softmaxregression__C=1e-6)
    settings = {"splits": 3, "seed": 2, "readout": strict}
    features = window.fit_transform(frames)
    expected = cross_validated_accuracy(features, labels, groups, **settings)
    (row,) = accuracy_against_window(frames, labels, groups, windows_s=[0.4e-9], window=window, **settings)
    assert np.array_equal(row.scores, expected)
    assert expected.mean() < cross_validated_accuracy(features, labels, groups, splits=3, seed=2).mean()
    strict_control = control(features, labels, groups, **settings)
    assert strict_control.accuracy < control(features, labels, groups, splits=3, seed=2).accuracy


def test_confusion_counts_every_test_shot(digits: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    frames, labels, groups = digits
    features = WindowFeatures().fit_transform(frames)
    splits = list(random_splits(labels, groups, splits=2, seed=3))
    outcome = validate(features, labels, splits)
    assert outcome.confusion.sum() == sum(test.size for _, test in splits)
    assert np.trace(outcome.confusion) / outcome.confusion.sum() == pytest.approx(outcome.scores.mean())
    np.testing.assert_array_equal(outcome.classes, [0, 1, 2, 3])
    scores = cross_validated_accuracy(features, labels, groups, splits=2, seed=3)
    np.testing.assert_array_equal(scores, outcome.scores)


def test_an_accuracy_forward_in_time(digits: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    frames, labels, groups = digits
    outcome = validate(WindowFeatures().fit_transform(frames), labels, [forward_in_time_split(groups)])
    assert outcome.scores.shape == (1,)
    assert outcome.scores[0] > 0.85


def test_shuffled_labels_are_at_chance_and_true_ones_are_not(
    digits: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    frames, labels, groups = digits
    features = WindowFeatures(window_s=0.2e-9).fit_transform(frames)
    dealt = shuffled_labels(labels, groups, seed=4)
    assert np.bincount(dealt).tolist() == np.bincount(labels).tolist()
    assert control(features, dealt, groups, splits=4, seed=4).at_chance
    honest = control(features, labels, groups, splits=4, seed=4)
    assert not honest.at_chance
    assert honest.chance == np.bincount(labels).max() / labels.size


@pytest.mark.parametrize(("splits", "shots"), [(2, 1), (10, 1), (2, 3)])
def test_honest_noise_scatters_about_chance_as_its_tolerance_says(splits: int, shots: int) -> None:
    """Two splits test a fifth of the images, ten some of them again; shots of one image are alike."""
    off = []
    for seed in range(80):
        generator = np.random.default_rng((splits, shots, seed))
        groups = np.repeat(np.arange(600), shots)
        found = control(generator.standard_normal((600, 2))[groups], groups % 4, groups, splits=splits, seed=seed)
        off.append((found.accuracy - found.chance) / (found.tolerance / STANDARD_ERRORS))
    assert np.std(off) < 1 + 4 / np.sqrt(2 * len(off)), "four standard errors of a standard deviation"
    assert abs(np.mean(off)) < 4 / np.sqrt(len(off))


def test_shuffling_keeps_repeats_together() -> None:
    groups = np.repeat(np.arange(20), 3)
    dealt = shuffled_labels(groups % 4, groups, seed=1)
    assert all(np.unique(dealt[groups == group]).size == 1 for group in range(20))


@pytest.mark.parametrize(
    ("window_s", "key"),
    [
        (0.08e-9, "0.08"),
        (0.16e-9, "0.16"),
        (0.24e-9, "0.24"),
        (0.32e-9, "0.32"),
        (0.4e-9, "0.4"),
        (0.56e-9, "0.56"),
        (0.8e-9, "0.8"),
        (1e-9, "1.0"),
        (2e-9, "2.0"),
        (14 * TAU, "0.56"),
    ],
)
def test_the_key_of_a_window(window_s: float, key: str) -> None:
    assert window_key(window_s) == key


def test_a_single_score_has_no_spread() -> None:
    assert mean_and_sd(np.array([0.5])) == {"mean": 0.5, "sd": 0.0}


def test_all_splits_at_once_are_what_each_is_by_itself(digits: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    frames, labels, groups = digits
    features = frames[:, :, :6].reshape(labels.size, -1)
    ways = [*random_splits(labels, groups, splits=4, seed=3), forward_in_time_split(groups, test_size=0.3)]
    together, alone = validate(features, labels, ways), validate(features, labels, ways, readout=softmax_classifier())
    for (_, test), one, other in zip(ways, together.scores, alone.scores, strict=True):
        assert abs(one - other) * test.size < 1.5  # either ends near the same optimum: an image now and then
    assert np.abs(together.confusion - alone.confusion).sum() <= 4
    assert together.classes.tolist() == alone.classes.tolist()


def test_a_class_that_a_training_part_lacks_is_never_answered(
    digits: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    frames, labels, _ = digits
    places = np.arange(labels.size)
    lacking = (places[labels != 3][::2], places)
    judged = validate(frames.reshape(labels.size, -1), labels, [(places, places), lacking])
    assert judged.confusion[:, 3].sum() == pytest.approx(np.count_nonzero(labels == 3), abs=2)
    assert judged.scores[1] <= np.mean(labels != 3)


def test_features_that_are_not_finite_are_one_error() -> None:
    with pytest.raises(AnalysisError, match="leave the broken shots out"):
        validate(np.array([[0.0], [np.nan], [1.0]]), np.array([0, 1, 0]), [(np.arange(2), np.arange(2, 3))])


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_more_features_than_shots_are_judged_like_any_others(kind: type[np.floating]) -> None:
    """Each shot several times changes nothing in what is minimised, and leaves fewer features than shots."""
    labels = np.arange(40) % 3
    features: NDArray[np.floating] = np.random.default_rng(2).standard_normal((40, 400)).astype(kind)
    features[:, :60] += np.repeat(np.eye(3, dtype=kind), 20, axis=1)[labels]
    groups = np.arange(40)
    once = validate(features, labels, random_splits(labels, groups, splits=5, test_size=0.3, seed=1))
    tiled, shown = np.tile(features, (10, 1)), np.tile(groups, 10)
    often = validate(tiled, labels[shown], random_splits(labels[shown], shown, splits=5, test_size=0.3, seed=1))
    assert once.scores.mean() > 0.8
    one_of_twelve = 1 / 11  # either ends near the same optimum
    np.testing.assert_allclose(once.scores, often.scores, atol=one_of_twelve)
    assert np.abs(10 * once.confusion - often.confusion).sum() <= 20
