"""Accuracy of a run as it grows: the softmax readout, trained on the images that are there.

A point is a pure function of the run's first images: a curve says the same whenever it is computed. That of a run that
is complete ends with a point of all its images.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from labctl.errors import AnalysisError, LabctlError
from labctl.runs.read.follower import Follower
from labctl.runs.read.run import Run

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


def curve(directory: Path, known: Curve) -> tuple[Curve, bool]:
    """The curve of a run as it is now with one point more than is `known` on the same ports, and whether others follow.

    A run that nothing can be learnt from, such as one of scenes or of one class, has no points.
    """
    try:
        following = Follower(directory)
        while following.look():
            pass
        run = following.measured(LEAST, MOST_SHOTS)
        shots = None if run is None else run.shots[run.shots["kind"] == "image"]
        if run is None or shots is None or np.unique(shots["label"]).size < 2:
            return known, False
        known = known if known.ports == run.ports else Curve(ports=run.ports)
        points = dict(zip(known.images, known.accuracy, strict=True))
        whole = min(following.done) == following.shape.shots and shots.size >= LEAST
        missing = sorted({*counts(shots.size), *([shots.size] if whole else ())} - points.keys())
        while missing and len(points) == len(known.images):
            count = missing.pop(0)
            point = _point(following.measured(LEAST, int(shots["index"][count - 1]) + 1), count)
            points |= {} if point is None else {count: point}
    except (LabctlError, KeyError):
        return known, False
    chance = float(np.bincount(shots["label"][shots["label"] >= 0]).max() / shots.size)
    found = Curve(tuple(sorted(points)), tuple(points[n] for n in sorted(points)), run.ports, chance, shots.size)
    return found, bool(missing)


def _point(run: Run | None, count: int) -> float | None:
    """Accuracy on the first `count` images of a run; None where they are too few of a class."""
    from labctl.analysis.evaluation import cross_validated_accuracy
    from labctl.runs.read.records import read_records

    if run is None:
        return None
    records = read_records(run)
    samples = min(records.traces.shape[-1], max(1, round(WINDOW_S / records.sample_interval_s)))
    features = records.traces[:count, :, :samples].reshape(count, -1)
    labels, groups = records.labels[:count], records.groups[:count]
    try:
        scores = cross_validated_accuracy(features, labels, groups, splits=SPLITS, test_size=TEST_PART, seed=1)
    except AnalysisError:
        return None
    return float(np.mean(scores))


def counts(available: int) -> list[int]:
    """How many images the points have that a run of so many has."""
    found, count = [], float(LEAST)
    while round(count) <= available:
        found.append(round(count))
        count *= GROWTH
    return found
