"""Is the light still what it was? A picture that a run has on disk is measured again before the run goes on.

How much two records of one picture may differ follows from the noise. `REPEATS` new records give its variance; the
stored record differs from their mean by that variance times 1 + 1 / `REPEATS`. A bench drifts as well: where the run
has an earlier record of the same picture, what lies between the two that are stored is allowed as well.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.errors import InstrumentError
from protocols.base import Shot, ShotKind

PICTURES = (ShotKind.REFERENCE, ShotKind.IMAGE)
"""What is measured again: of one image both show the same."""
REPEATS = 5
ALLOWED = 2.0
"""Times what noise and drift explain. By chance twenty samples exceed it once in 100 000 cases (F distribution of 20
and 80 degrees of freedom); the trigger's jitter is common to a record's samples and makes that once in 800 on one port
of the simulated bench, in none of 4000 on five. There unchanged light comes to 1.0 in the median, laser power 20 % off
to 1.5 to 2.5, the laser 2 pm off to 1.6 to 2.7, 10 pm off or another fibre to 9 and more."""


def to_repeat(stored: Sequence[Shot]) -> Shot | None:
    """The last reference image among the `stored` shots, else the last image; None where there are no images."""
    pictures = [shot for shot in stored if shot.kind in PICTURES]
    return max(pictures, key=lambda shot: (shot.kind is ShotKind.REFERENCE, shot.index), default=None)


def first_of(shot: Shot, stored: Sequence[Shot]) -> Shot:
    """The first of the `stored` shots that shows what `shot`, one of them, does; a reference may be an image too."""
    shown = shot.dataset_index, shot.group
    return next(one for one in stored if one.kind in PICTURES and (one.dataset_index, one.group) == shown)


def refuse_changed_light(shot: Shot, first: NDArray[Any], stored: NDArray[Any], again: NDArray[Any]) -> None:
    """Compare the stored record of `shot` with `again`, new ones of the same picture in the same vertical ranges.

    first: codes of the run's first record of that picture, which may be the stored one. stored: (ports, samples).
    again: (REPEATS, ports, samples).

    Raises:
        InstrumentError: they differ by more than noise and drift explain.
    """
    measured = again.mean(axis=0)
    noise = np.sqrt((1 + 1 / len(again)) * again.var(axis=0, ddof=1).mean())
    drift = _rms(stored - first.astype(np.float64))
    explained = max(float(noise), drift, 1.0)
    difference = _rms(stored - measured)
    if difference > ALLOWED * explained:
        raise InstrumentError(
            f"bench: {shot.kind} shot {shot.index} is not what it was: its traces differ by {difference:.1f} codes "
            f"rms, {difference / explained:.1f} times what noise and drift explain ({ALLOWED:g} are allowed): let the "
            f"laser warm up, check fibres and mirrors then resume again, or begin a new run"
        )


def _rms(codes: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(codes**2)))
