"""A readout that follows a run: it predicts each image as it comes, and then learns from it.

What it recognised is a pure function of the run's images in their order: of a run that was not watched the same comes
out as of one that was. Only shots that are new are read.
"""

from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from labctl.dashboard.accuracy import LEAST, WINDOW_S
from labctl.errors import LabctlError
from labctl.runs.read.follower import Follower

if TYPE_CHECKING:
    from labctl.analysis.online import OnlineClassifier

BLOCK = 100
"""Images of a point of the curve."""
MOST_AT_ONCE = 200
"""Shots that are learnt from in one step: some tenths of a second of a processor where features are many."""
LAST = 500
"""Images of the number beside it."""
MOST_CLASSES, MOST_FEATURES = 100, 1000
"""Of a run that is followed: a stranger's may have any number, and memory grows with the square of the features."""


@dataclass(frozen=True)
class Following:
    """How a readout has fared on `ports`, and where it goes on.

    Attributes:
        ports: Ports of its features.
        right: (n,) whether it recognised each image that it had not seen before, in the order they were measured.
        next_shot: Place in the run of the shot that it sees next.
        seen: (m,) the images that it has seen.
        readout: The readout.
    """

    ports: tuple[int, ...] = ()
    right: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    next_shot: int = 0
    seen: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    readout: "OnlineClassifier | None" = None

    @property
    def points(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """After how many images, and which part of the `BLOCK` before was recognised."""
        blocks = self.right[: self.right.size // BLOCK * BLOCK].reshape(-1, BLOCK)
        return LEAST + BLOCK * np.arange(1, len(blocks) + 1), blocks.mean(axis=1)


def follow(directory: Path, known: Following) -> tuple[Following, bool]:
    """Follow a run from where `known` is for `MOST_AT_ONCE` shots, and whether it may go on from there.

    It begins anew where the run has more ports now. A run that nothing can be learnt from, such as one of scenes or of
    one class, is not followed.
    """
    try:
        following = Follower(directory)
        while following.look():
            pass
        found = _followed(following, known)
    except (LabctlError, KeyError, ValueError):
        return known, False
    return found, found is not known


def _followed(following: Follower, known: Following) -> Following:
    """What comes of the next images, as many as are read at once; `known` itself where there are none yet."""
    from labctl.analysis.online import OnlineClassifier
    from labctl.analysis.prequential import first_showings
    from labctl.runs.read.records import read_records

    run = following.measured(LEAST, MOST_AT_ONCE, known.next_shot)
    if run is None or not 2 <= following.classes.size <= MOST_CLASSES:
        return known
    if known.readout is not None and run.ports != known.ports:
        return _followed(following, Following())
    records = read_records(run)
    places = run.shots["index"][records.indices]
    new = np.flatnonzero(places >= known.next_shot)
    samples = min(records.traces.shape[-1], max(1, round(WINDOW_S / records.sample_interval_s)))
    if new.size < (LEAST + 1 if known.readout is None else 1) or samples * len(records.ports) > MOST_FEATURES:
        return known
    features = records.traces[new, :, :samples].reshape(new.size, -1)
    labels, groups = records.labels[new], records.groups[new]
    if known.readout is None:
        readout = OnlineClassifier().partial_fit(features[:LEAST], labels[:LEAST], following.classes)
        known = replace(known, ports=records.ports, seen=np.unique(groups[:LEAST]))
        features, labels, groups = features[LEAST:], labels[LEAST:], groups[LEAST:]
    else:
        readout = deepcopy(known.readout)
    right = readout.follow(features, labels) == labels
    return replace(
        known,
        right=np.concatenate((known.right, right[first_showings(groups, known.seen)])),
        next_shot=int(places[-1]) + 1,
        seen=np.union1d(known.seen, groups),
        readout=readout,
    )
