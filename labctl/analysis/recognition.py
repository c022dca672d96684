"""How well a softmax readout recognises what a run shows: one number with its interval."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.analysis.evaluation import chance_of, shares_of_images, validate
from labctl.analysis.intervals import interval
from labctl.analysis.readouts import softmax_readout
from labctl.analysis.splits import enough_splits, random_splits

SEED = 1


@dataclass(frozen=True)
class Recognition:
    """Accuracy, its interval of 95 % (Wilson's, of the images tested), the share of the largest class, images tested.

    Some splits test an image again, and some images no split tests: each that was tested counts once, with the part of
    its tests in which it was recognised.
    """

    accuracy: float
    interval: tuple[float, float]
    chance: float
    images: int


def recognition(
    traces: NDArray[np.floating],
    labels: NDArray[np.int64],
    groups: NDArray[np.int64],
    *,
    sample_interval_s: float,
    window_s: float | None = None,
    ports: Sequence[int] | None = None,
    recorded_ports: Sequence[int] = (),
) -> Recognition:
    """Of records by random splits that keep all shots of one image together.

    traces: (shots, ports, samples) V. labels, groups: (shots,). window_s: part of each record that the readout sees,
    None for all. ports: those of `recorded_ports` that it sees, None for all.

    Raises:
        AnalysisError: there is no such window or port, or there are too few images.
    """
    readout = softmax_readout(
        ports=ports,
        window_s=traces.shape[2] * sample_interval_s if window_s is None else window_s,
        sample_interval_s=sample_interval_s,
        recorded_ports=recorded_ports if ports else None,
    )
    splits = random_splits(labels, groups, splits=enough_splits(np.unique(groups).size), seed=SEED)
    shares = shares_of_images(validate(traces, labels, splits, readout=readout).right, groups)
    return Recognition(float(shares.mean()), interval(round(shares.sum()), shares.size), chance_of(labels), shares.size)
