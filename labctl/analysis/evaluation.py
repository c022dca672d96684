"""How good a readout is: accuracy over many splits, confusion, accuracy against acquisition time, controls."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.preprocessing import StandardScaler

from labctl.analysis.softmax import deviations, held_out_answers
from labctl.analysis.splits import OTHER_CLASSES, Split, random_splits
from labctl.analysis.threads import one_thread
from labctl.analysis.windows import WindowFeatures, as_float, compressive_ratio
from labctl.errors import AnalysisError, TooFewImages

STANDARD_ERRORS = 4.0
"""A control counts as chance up to this many standard errors above it: an honest one fails once in 30000 times."""


@dataclass(frozen=True)
class CrossValidation:
    """Outcome of training and testing over several splits.

    Attributes:
        scores: (splits,) accuracy on the test shots of each split, 0..1.
        classes: (k,) the class labels.
        confusion: (k, k) test shots over all splits, true class by row, predicted class by column.
        right: (shots,) part of the splits that tested a shot in which it was recognised; NaN where none did.
    """

    scores: NDArray[np.float64]
    classes: NDArray[Any]
    confusion: NDArray[np.int64]
    right: NDArray[np.float64]


@dataclass(frozen=True)
class WindowAccuracy:
    """Accuracy at one acquisition time.

    Attributes:
        window_s: T_N, s.
        features: Number of features M N.
        compressive_ratio: N / 784.
        scores: (splits,) accuracy on the test shots of each split, 0..1.
    """

    window_s: float
    features: int
    compressive_ratio: float
    scores: NDArray[np.float64]


@dataclass(frozen=True)
class Control:
    """Accuracy of something that must not be recognisable.

    Attributes:
        accuracy: Mean of `shares_of_images`.
        chance: Share of the most frequent class: what guessing reaches.
        tolerance: How far it may lie above chance, `STANDARD_ERRORS` standard errors over the images tested.
    """

    accuracy: float
    chance: float
    tolerance: float

    @property
    def limit(self) -> float:
        """The highest accuracy that counts as chance."""
        return self.chance + self.tolerance

    @property
    def at_chance(self) -> bool:
        """True if nothing was recognised."""
        return self.accuracy <= self.limit


def validate(
    features: NDArray[Any], labels: NDArray[Any], splits: Iterable[Split], *, readout: Any = None
) -> CrossValidation:
    """Train and test a readout on every split, on one thread.

    Args:
        features: (shots, features), or records (shots, ports, samples) for a readout that starts with `WindowFeatures`.
        labels: (shots,) class of each shot.
        splits: Training and test positions.
        readout: Unfitted estimator; None = `softmax_classifier()`, of all splits at once.

    Raises:
        TooFewImages: All shots of a training part are of one class.
        AnalysisError: A feature is not finite.
    """
    if readout is None:
        standard = _standardised(features)
        return validate_softmax(standard, labels, splits, spreads=deviations)

    def answers(members: NDArray[np.intp], ways: Sequence[Split]) -> list[NDArray[np.intp]]:
        trained = ((clone(readout).fit(features[train], members[train]), test) for train, test in ways)
        return [np.asarray(one.predict(features[test]), np.intp) for one, test in trained]

    return _judged(labels, splits, answers)


def validate_softmax(
    features: NDArray[np.floating],
    labels: NDArray[Any],
    splits: Iterable[Split],
    *,
    spreads: Callable[[NDArray[np.floating], Sequence[Split]], NDArray[np.float64]],
) -> CrossValidation:
    """Train and test `SoftmaxRegression` on all splits at once, on one thread.

    Args:
        features: (shots, features), float32 or float64.
        labels: (shots,) class of each shot.
        splits: Training and test positions.
        spreads: Unit of each feature in the penalty, for the features and the splits, as in `held_out_answers`.

    Raises:
        TooFewImages: All shots of a training part are of one class.
    """

    def answers(members: NDArray[np.intp], ways: Sequence[Split]) -> list[NDArray[np.intp]]:
        return held_out_answers(features, members, ways, spreads(features, ways))

    return _judged(labels, splits, answers)


def _judged(
    labels: NDArray[Any],
    splits: Iterable[Split],
    answers: Callable[[NDArray[np.intp], Sequence[Split]], Sequence[NDArray[np.intp]]],
) -> CrossValidation:
    """What comes of a readout's answers to the test part of each split; labels are places of the classes for it."""
    ways = list(splits)
    classes, members = np.unique(labels, return_inverse=True)
    for train, _ in ways:
        if not np.ptp(members[train]):
            advice = OTHER_CLASSES if classes.size == 1 else "acquire more images"
            raise TooFewImages(f"all {train.size} shots to train on are of one class: {advice}")
    with one_thread():
        answered = answers(members, ways)
    confusion = np.zeros((classes.size, classes.size), np.int64)
    scores = []
    right, tested = np.zeros(members.size), np.zeros(members.size)
    for (_, test), answer in zip(ways, answered, strict=True):
        np.add.at(confusion, (members[test], answer), 1)
        scores.append(float(np.mean(answer == members[test])))
        right[test] += answer == members[test]
        tested[test] += 1
    share = np.divide(right, tested, out=np.full(members.size, np.nan), where=tested > 0)
    return CrossValidation(np.array(scores), classes, confusion, share)


def _standardised(features: NDArray[Any]) -> NDArray[np.floating]:
    """Features of mean 0 and deviation 1 over all shots, for the sake of the arithmetic: no readout depends on it."""
    if not np.isfinite(features).all():
        raise AnalysisError("features hold values that are not finite: leave the broken shots out")
    standard: NDArray[np.floating] = StandardScaler().fit_transform(as_float(features))
    return standard


def shares_of_images(right: NDArray[np.float64], groups: NDArray[Any]) -> NDArray[np.float64]:
    """Part of its tests in which each image was recognised, (images that any split tested,): each counts once.

    Args:
        right: (shots,) as in `CrossValidation`.
        groups: (shots,) the image each shot shows.
    """
    tested = np.flatnonzero(~np.isnan(right))
    _, image = np.unique(groups[tested], return_inverse=True)
    shares: NDArray[np.float64] = np.bincount(image, right[tested]) / np.bincount(image)
    return shares


def cross_validated_accuracy(
    features: NDArray[Any],
    labels: NDArray[Any],
    groups: NDArray[Any],
    *,
    splits: int = 10,
    test_size: float | int = 0.1,
    seed: int,
    readout: Any = None,
) -> NDArray[np.float64]:
    """Accuracy (splits,) of a readout, as of `validate`, on (shots, features); the rest as in `random_splits`."""
    chosen = random_splits(labels, groups, splits=splits, test_size=test_size, seed=seed)
    return validate(features, labels, chosen, readout=readout).scores


def accuracy_against_window(
    frames: NDArray[Any],
    labels: NDArray[Any],
    groups: NDArray[Any],
    *,
    windows_s: Sequence[float],
    window: WindowFeatures,
    splits: int = 10,
    test_size: float | int = 0.1,
    seed: int,
    readout: Any = None,
) -> tuple[WindowAccuracy, ...]:
    """Accuracy of a readout at each acquisition time, over the same random splits.

    Args:
        frames: (shots, ports, samples).
        labels: (shots,) class of each shot.
        groups: (shots,) the image each shot shows.
        windows_s: Acquisition times T_N, s.
        window: Ports, sample interval and start of the window; its own `window_s` is not used.
        splits: How many random splits.
        test_size: Part of the images in the test set, or number of test shots.
        seed: Seed of the splits.
        readout: As of `validate`.

    Raises:
        AnalysisError: A window does not fit into the records, or the shots cannot be split.
    """
    chosen = list(random_splits(labels, groups, splits=splits, test_size=test_size, seed=seed))
    table = []
    for window_s in windows_s:
        features = clone(window).set_params(window_s=window_s).fit_transform(frames)
        scores = validate(features, labels, chosen, readout=readout).scores
        tau_s = window.tau_s if window.tau_s is not None else window.sample_interval_s
        table.append(WindowAccuracy(window_s, features.shape[1], compressive_ratio(window_s, tau_s), scores))
    return tuple(table)


def windows_to_try(samples: int, sample_interval_s: float) -> list[float]:
    """Acquisition times, s, from two samples to a whole record of so many, about doubling."""
    counts = [count for count in (2, 4, 6, 8, 10, 14, 20, 25, 50, 100, 250, 500) if count < samples] + [samples]
    return [count * sample_interval_s for count in counts]


def window_key(window_s: float) -> str:
    """The acquisition time as the text that keys results: nanoseconds with at least one decimal ("0.08", "1.0")."""
    return repr(round(window_s * 1e9, 6))


def mean_and_sd(scores: NDArray[np.float64]) -> dict[str, float]:
    """Mean and sample standard deviation (0 for a single score) as a JSON object."""
    return {"mean": float(np.mean(scores)), "sd": float(np.std(scores, ddof=1)) if scores.size > 1 else 0.0}


def control(
    features: NDArray[Any],
    labels: NDArray[Any],
    groups: NDArray[Any],
    *,
    splits: int = 10,
    test_size: float | int = 0.1,
    seed: int,
    readout: Any = None,
) -> Control:
    """Accuracy of a readout, as of `validate`, and of chance, on shots that say nothing about `labels`.

    Such as those of a fixed image, dark ones, and any with shuffled labels.
    """
    chosen = random_splits(labels, groups, splits=splits, test_size=test_size, seed=seed)
    shares = shares_of_images(validate(features, labels, chosen, readout=readout).right, groups)
    chance = chance_of(labels)
    tolerance = STANDARD_ERRORS * float(np.sqrt(chance * (1 - chance) / shares.size))
    return Control(float(shares.mean()), chance, tolerance)


def chance_of(labels: NDArray[Any]) -> float:
    """Share of the most frequent class among the labels (shots,): what guessing reaches."""
    return float(np.max(np.unique_counts(labels).counts) / labels.size)


def shuffled_labels(labels: NDArray[Any], groups: NDArray[Any], *, seed: int) -> NDArray[Any]:
    """The labels (shots,) dealt out anew among the groups, so that they say nothing about the shots."""
    names, first, member = np.unique(groups, return_index=True, return_inverse=True)
    dealt = np.random.default_rng(seed).permutation(names.size)
    return np.asarray(labels[first][dealt][member])
