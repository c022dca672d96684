"""Does an oscilloscope acquire anew? A channel of noisy codes never repeats itself, but by chance."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

UNLIKELY = 1e-7
"""How improbable it must be that chance alone makes records look wrong."""
REPEATED = 0.17
"""Part of the samples that repeat themselves at least: 1 / (2 s sqrt pi), where noise is the digitiser's alone.

Of 5.5 effective bits it has s = 1.65 codes, rounding included (IEEE 1241); light and more noise only make it less.
"""


class Repetition:
    """Counts for how many records in a row each channel gave the same codes."""

    def __init__(self) -> None:
        """Nothing was recorded yet."""
        self._frozen = np.empty(0, np.int64)  # records in a row that each channel repeated itself
        self._equal, self._compared = 0.0, 1.0  # samples that repeated themselves, of how many

    def examine(self, begin: int, codes: NDArray[Any]) -> tuple[int, str] | None:
        """Take the records from the shot `begin` on, shape (shots, channels, samples), the first of them known before.

        Returns:
            The first shot whose record is an old one, and what happened: a channel repeats itself more often than noise
            would, or all of them do at once.
        """
        equal = codes[1:] == codes[:-1]
        whole = equal.all(axis=2)
        likely = codes.shape[2] * math.log(max(REPEATED, self._equal / self._compared))
        self._equal += float(np.count_nonzero(equal))
        self._compared += equal.size
        if self._frozen.size != codes.shape[1] or not whole.any():
            self._frozen = np.zeros(codes.shape[1], np.int64)
        for shot, again in enumerate(whole, begin + 1) if whole.any() else ():
            self._frozen = np.where(again, self._frozen + 1, 0)
            chance = self._frozen * likely
            if again.all():  # the noise of channels is independent
                chance = np.full_like(chance, chance.sum())
            stuck = np.flatnonzero(chance < math.log(UNLIKELY))
            if stuck.size:
                since = shot - int(self._frozen[stuck].max())
                which = "all channels" if stuck.size == codes.shape[1] else f"channel {stuck[0] + 1} of the pass"
                return since + 1, (
                    f"scope: {which} gave byte-identical traces at shots {since} to {shot}: it did not acquire anew; "
                    f"check its trigger"
                )
        return None
