"""Which shots show nearly the same, and which have records like those of others though they do not."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.base import Images, Inputs, Shot, ShotKind

LIT = (ShotKind.IMAGE, ShotKind.REFERENCE)
NEARLY = 0.25
"""Part of the lit pixels by which two images must differ for their records to be told apart for sure."""
GAP = 1.5
"""Times the noise, up to which no record of a pass may come near another one's for those within noise to be told."""

Alike = Callable[[Shot, Shot, float], bool]
"""Whether two shots show nearly the same, or differ by less than a part of the pixels that images usually have lit."""


class Unlike:
    """Tells shots whose records are within noise of others, though they show something else.

    A gap must be between those and all that differ: otherwise some of them are so near by chance.
    """

    def __init__(self, shots: Sequence[Shot], alike: Alike, other: Callable[[int], Shot]) -> None:
        """Of a pass that measures `shots`; `other`: the one that the record of a shot is held against."""
        self._shots = shots
        self._alike = alike
        self._other = other
        self._between = 0  # records that lay in the gap

    def unlike(self, shots: NDArray[Any], times: NDArray[np.float64], faint: float) -> list[int]:
        """Those of `shots` whose records differ from those of the others by no more than the noise: by 1 `times` it."""
        near = [
            (shot, nearness)
            for shot, nearness in zip(shots[times <= GAP].tolist(), times[times <= GAP].tolist(), strict=True)
            if not self._alike(self._other(shot), self._shots[shot], faint)
        ]
        found = [shot for shot, nearness in near if nearness <= 1]
        self._between += len(near) - len(found)
        return [] if self._between else found


def alike_by(inputs: Inputs) -> Alike:
    """Whether two shots show nearly the same: by their images, where there are any; otherwise all may be alike."""
    if not isinstance(inputs, Images):
        return lambda _one, _other, _faint: True
    usual = float(np.median(np.count_nonzero(inputs.images, axis=(1, 2))))

    def pixels(shot: Shot) -> NDArray[np.bool_] | None:
        if shot.kind is ShotKind.DARK:
            return np.zeros(inputs.images.shape[1:], np.bool_)
        place = inputs.places.get(shot.dataset_index) if shot.kind in LIT else None
        return None if place is None else inputs.images[place]

    def alike(one: Shot, other: Shot, faint: float) -> bool:
        shown = pixels(one), pixels(other)
        if shown[0] is None or shown[1] is None:
            return True
        different, lit = np.count_nonzero(shown[0] ^ shown[1]), max(map(np.count_nonzero, (shown[0], shown[1])))
        return bool(different <= max(NEARLY * lit, faint * usual))

    return alike
