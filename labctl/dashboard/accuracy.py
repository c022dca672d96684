"""Accuracy of a run as it grows: the softmax readout, trained on the images that are there.

A point is a pure function of the run's first images: a curve says the same whenever it is computed. That of a run that
is complete ends with a point of all its images.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from labctl.errors import AnalysisError, LabctlError
from labctl.runs.read.follower import Follower

LEAST = 40
"""Images of the first point."""
GROWTH = 1.3
"""Each point has so many times the images of the one before: all of them are little more work than the last."""
MOST_SHOTS = 6000
"""From the start of the run; what comes after does not move the curve."""
SPLITS = 3
TEST_PART = 0.2
WINDOW_S = 0.4e-9
"""Acquisition time, or the whole frame where that is shorter."""


@dataclass(frozen=True)
class Curve:
    """Accuracy on unseen images (mean of random splits) against how many images were there, on which ports.

    `chance` is the share of the largest class; None before the first point.
    """

    images: tuple[int, ...] = ()
    accuracy: tuple[float, ...] = ()
    ports: tuple[int, ...] = ()
    chance: float | None = None
    seen: int = 0


def curve(directory: Path, known: Curve) -> Curve:
    """The curve of a run as far as it is now; points that are `known`, on the same ports, are not computed again.

    A run that nothing can be learnt from, such as one of scenes or of one class, has no points.
    """
    from labctl.analysis.evaluation import cross_validated_accuracy
    from labctl.runs.read.records import read_records

    try:
        following = Follower(directory)
        while following.look():
            pass
        run = following.measured(LEAST, MOST_SHOTS)
        records = None if run is None else read_records(run)
    except (LabctlError, KeyError):
        return known
    if records is None or np.unique(records.labels).size < 2:
        return known
    known = known if known.ports == records.ports else Curve(ports=records.ports)
    available = records.labels.size
    samples = min(records.traces.shape[-1], max(1, round(WINDOW_S / records.sample_interval_s)))
    features = records.traces[:, :, :samples].reshape(available, -1)
    points = dict(zip(known.images, known.accuracy, strict=True))
    whole = min(following.done) == following.shape.shots
    for count in sorted({*counts(available), *([available] if whole and available >= LEAST else ())}):
        if count not in points:
            labels, groups = records.labels[:count], records.groups[:count]
            try:
                scores = cross_validated_accuracy(
                    features[:count], labels, groups, splits=SPLITS, test_size=TEST_PART, seed=1
                )
            except AnalysisError:  # too few of a class so far
                continue
            points[count] = float(np.mean(scores))
    chance = float(np.bincount(records.labels[records.labels >= 0]).max() / available)
    return Curve(tuple(sorted(points)), tuple(points[n] for n in sorted(points)), records.ports, chance, available)


def counts(available: int) -> list[int]:
    """How many images the points have that a run of so many has."""
    found, count = [], float(LEAST)
    while round(count) <= available:
        found.append(round(count))
        count *= GROWTH
    return found
