"""How accuracy grows with the number of training images."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.analysis.evaluation import validate
from labctl.analysis.splits import random_splits
from labctl.errors import AnalysisError


@dataclass(frozen=True)
class LearningPoint:
    """Accuracy with one number of training images.

    Attributes:
        images: Number of training images; shots that repeat an image come with it and are not counted.
        scores: (splits,) accuracy on the test shots of each split, 0..1.
    """

    images: int
    scores: NDArray[np.float64]


def learning_curve(
    features: NDArray[Any],
    labels: NDArray[Any],
    groups: NDArray[Any],
    sizes: Sequence[int],
    *,
    splits: int = 10,
    test_size: float | int = 0.1,
    seed: int,
    readout: Any = None,
) -> tuple[LearningPoint, ...]:
    """Accuracy against the number of training images, always on the same test shots.

    In each split a smaller training set is part of every larger one, with the classes in proportion.

    Args:
        features: (shots, features), or records for a readout that starts with `WindowFeatures`.
        labels: (shots,) class of each shot.
        groups: (shots,) the image each shot shows.
        sizes: Numbers of training images.
        splits: How many random splits.
        test_size: Part of the images in the test set, or number of test shots.
        seed: Seed of splits and subsets.
        readout: Unfitted estimator; None = the softmax classifier.

    Returns:
        One point for each of `sizes`, in their order.

    Raises:
        AnalysisError: There are not that many training images, or so few that a class has none.
    """
    generator = np.random.default_rng(seed)
    chosen = [
        (_dealt(labels[train], groups[train], generator), train, test)
        for train, test in random_splits(labels, groups, splits=splits, test_size=test_size, seed=seed)
    ]
    points = []
    for size in sizes:
        parts = [(_part(order, train, labels, groups, size), test) for order, train, test in chosen]
        points.append(LearningPoint(size, validate(features, labels, parts, readout=readout).scores))
    return tuple(points)


def _dealt(labels: NDArray[Any], groups: NDArray[Any], generator: np.random.Generator) -> NDArray[Any]:
    """The groups in random order, dealt so that every beginning of the list has the classes in proportion."""
    names, first = np.unique(groups, return_index=True)
    shuffled = generator.permutation(names.size)
    classes = labels[first][shuffled]
    turn = np.empty(names.size)
    for label in np.unique(classes):
        own = np.flatnonzero(classes == label)
        turn[own] = (np.arange(own.size) + 0.5) / own.size
    return np.asarray(names[shuffled[np.argsort(turn, kind="stable")]])


def _part(
    order: NDArray[Any], train: NDArray[np.intp], labels: NDArray[Any], groups: NDArray[Any], size: int
) -> NDArray[np.intp]:
    """Positions of the training shots of the first `size` groups."""
    if not 1 <= size <= order.size:
        raise AnalysisError(f"{size} training images of {order.size}: ask for 1 to {order.size}, or measure more")
    part = train[np.isin(groups[train], order[:size])]
    if missing := set(labels[train].tolist()) - set(labels[part].tolist()):
        raise AnalysisError(f"{size} training images leave class {min(missing)} without any: use more")
    return part
