"""Splits of shots into a training and a test part that do not cheat.

Shots that show the same image share a group; a group is never on both sides of a split.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.model_selection import StratifiedShuffleSplit

from labctl.errors import AnalysisError, TooFewImages

SEEDS = 1 << 32
"""How many seeds a split can have: those of scikit-learn."""
MOST_SPLITS = 10
OTHER_CLASSES = "acquire images of other classes too, by --set classes="
"""What to do about images of one class: more of them say no more."""
TESTED = 5000
"""Images that random splits test in all: one standard error of the accuracy is then at most 0.7 points."""
Split = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Positions of the training shots and of the test shots, both ascending."""


def random_splits(
    labels: NDArray[Any], groups: NDArray[Any], *, splits: int = 10, test_size: float | int = 0.1, seed: int
) -> Iterator[Split]:
    """Random splits with every class in proportion and groups kept together.

    Args:
        labels: (shots,) class of each shot.
        groups: (shots,) what must stay together: the image a shot shows.
        splits: How many.
        test_size: Test part: below 1 a part of the shots, otherwise a number of shots.
        seed: Seed of the draw.

    Raises:
        AnalysisError: No such seed, or a group has shots of different classes.
        TooFewImages: Too few groups for such splits.
    """
    if not 0 <= seed < SEEDS:
        raise AnalysisError(f"seed {seed}: choose one from 0 to {SEEDS - 1}")
    names, first, member = np.unique(groups, return_index=True, return_inverse=True)
    group_labels = labels[first]
    if mixed := np.unique(groups[group_labels[member] != labels]).tolist():
        raise AnalysisError(f"shots of group {mixed[0]} have different labels: give each image a group of its own")
    share = _share(test_size, labels.size)
    test_groups = max(round(share * names.size), 1)
    fewest = np.unique_counts(group_labels).counts.min()
    classes = np.unique(group_labels).size
    if fewest < 2 or test_groups < classes or names.size - test_groups < classes:
        if classes == 1:
            raise TooFewImages(f"all images are of one class: {OTHER_CLASSES}")
        enough = math.ceil(round(classes / min(share, 1 - share), 6))
        advice = f"{enough} images, two or more of each, are enough" if test_size < 1 else "change the test part"
        raise TooFewImages(
            f"{names.size} images of {classes} classes cannot be split with a test part of {test_size:g}: every class "
            f"needs an image on both sides, {advice}"
        )
    splitter = StratifiedShuffleSplit(n_splits=splits, test_size=test_groups, random_state=seed)
    for _, test in splitter.split(names, group_labels):
        in_test = np.isin(member, test)
        yield np.flatnonzero(~in_test), np.flatnonzero(in_test)


def enough_splits(images: int, *, test_size: float | int = 0.1) -> int:
    """How many random splits of so many images say enough: they test `TESTED` in all, and are 2 to `MOST_SPLITS`.

    Example:
        >>> from labctl.analysis.splits import enough_splits
        >>> enough_splits(1000), enough_splits(10_000), enough_splits(60_000)
        (10, 5, 2)
    """
    tested = max(_share(test_size, images) * images, 1)
    return min(max(round(TESTED / tested), 2), MOST_SPLITS)


def own_split(rows: NDArray[np.integer], first_test: int) -> Split:
    """The data set's own split: train on the rows of its source before `first_test`, test on the others.

    Args:
        rows: (shots,) row in the source of the image that each shot shows.
        first_test: First row of the set's test part.

    Raises:
        AnalysisError: One of the parts is empty.
    """
    test = rows >= first_test
    if test.all() or not test.any():
        part = "test" if test.all() else "training"
        raise AnalysisError(f"all {rows.size} shots are of the data set's {part} part: show images of both")
    return np.flatnonzero(~test), np.flatnonzero(test)


def forward_in_time_split(
    groups: NDArray[Any], *, test_size: float | int = 0.1, order: NDArray[Any] | None = None
) -> Split:
    """Train on the earlier shots, test on the last ones: shows drift that random splits hide.

    Shots of an image that is also tested are left out of the training part.

    Args:
        groups: (shots,) the image each shot shows.
        test_size: Test part: below 1 a part of the shots, otherwise a number of shots.
        order: (shots,) time or number of each shot; None = they are in the order of acquisition.

    Raises:
        TooFewImages: One of the parts would be empty.

    Example:
        >>> import numpy as np
        >>> from labctl.analysis.splits import forward_in_time_split
        >>> images = np.array([1, 2, 3, 4, 5, 1])
        >>> forward_in_time_split(images, test_size=2)  # image 1 is tested, so its first shot is left out
        (array([1, 2, 3]), array([4, 5]))
    """
    by_time = np.arange(groups.size) if order is None else np.argsort(order, kind="stable")
    count = max(round(_share(test_size, groups.size) * groups.size), 1)
    test = np.sort(by_time[-count:])
    train = np.sort(by_time[:-count])
    train = train[~np.isin(groups[train], groups[test])]
    if not train.size:
        raise TooFewImages(
            f"no shot is left to train on: {groups.size} shots with a test part of {test_size:g} repeat the same images"
        )
    return train, test


def _share(test_size: float | int, shots: int) -> float:
    share = test_size if test_size < 1 else test_size / shots
    if not 0 < share < 1:
        raise TooFewImages(f"a test part of {test_size:g} of {shots} shots leaves nothing on one side: change it")
    return share
