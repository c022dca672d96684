"""Test, then train: how readouts that follow fare from shot to shot, beside readouts that stay as they were trained.

All begin with the same first shots. Each later shot is predicted by all of them before anything learns from it; those
that follow then do, as they would while the bench runs. Source: A. P. Dawid, J. R. Stat. Soc. A 147 (1984) 278.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import RidgeClassifierCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from labctl.analysis.online import NormalisedLeastMeanSquares, OnlineClassifier
from labctl.analysis.readouts import softmax_classifier
from labctl.analysis.regression import ALPHAS
from labctl.analysis.splits import OTHER_CLASSES
from labctl.analysis.threads import one_thread
from labctl.errors import AnalysisError

FOLLOWING = {"rls": "recursive least squares", "nlms": "NLMS"}
FROZEN = {"softmax": "softmax, frozen", "ridge": "ridge, frozen"}
READOUTS = FOLLOWING | FROZEN
"""What is compared, by its key, in words."""


@dataclass(frozen=True)
class Prequential:
    """Which shots each readout recognised.

    Attributes:
        places: (n,) places of the shots that count, ascending.
        right: Key of `READOUTS` -> (n,) whether it was recognised.
    """

    places: NDArray[np.intp]
    right: Mapping[str, NDArray[np.bool_]]


def prequential(features: NDArray[Any], labels: NDArray[Any], groups: NDArray[Any], *, first: int) -> Prequential:
    """Begin with the `first` shots, then predict and follow the others, in the order they were measured.

    A shot counts if its image was not shown before: nothing is recognised because it was learnt.

    Args:
        features: (shots, features).
        labels: (shots,) class of each shot.
        groups: (shots,) the image each shot shows.
        first: How many shots all readouts begin with.

    Raises:
        AnalysisError: The first shots lack a class, or no later one has an image of its own.
    """
    missing = set(labels.tolist()) - set(labels[:first].tolist())
    if missing or np.unique(labels).size < 2:
        what = f"class {min(missing)} is missing" if missing else "all are of one class"
        advice = "acquire more images" if missing else OTHER_CLASSES
        raise AnalysisError(f"{what} among the {first} shots to begin with: {advice}")
    places = np.flatnonzero(first_showings(groups))
    places = places[places >= first]
    if not places.size:
        raise AnalysisError(f"all images after the first {first} shots were shown before: acquire more images")
    right = {}
    with one_thread():
        for name, readout in _readouts().items():
            readout.fit(features[:first], labels[:first])
            later = features[first:]
            found = readout.follow(later, labels[first:]) if name in FOLLOWING else readout.predict(later)
            right[name] = (found == labels[first:])[places - first]
    return Prequential(places, right)


def first_showings(groups: NDArray[Any], before: NDArray[Any] | None = None) -> NDArray[np.bool_]:
    """Which of the shots (shots,) show an image that neither an earlier one nor those `before` did."""
    first = np.zeros(groups.size, np.bool_)
    first[np.unique(groups, return_index=True)[1]] = True
    return first if before is None else first & ~np.isin(groups, before)


def _readouts() -> dict[str, Any]:
    """Unfitted readouts by their keys."""
    return {
        "rls": OnlineClassifier(),
        "nlms": OnlineClassifier(NormalisedLeastMeanSquares()),
        "softmax": softmax_classifier(),
        "ridge": make_pipeline(StandardScaler(), RidgeClassifierCV(alphas=list(ALPHAS))),
    }
