"""When the light of a drive arrives: from the trigger to the first sample that a change of the drive has changed."""

import numpy as np
from numpy.typing import NDArray

from instruments.errors import InstrumentError

CERTAIN = 6.0
"""Standard deviations of the noise: one silent sample in a thousand million strays so far."""
SMALLEST_CODES = 1.5
"""Averages can be quieter than the digitiser's step; a change of less than this says nothing."""


def first_light(codes: NDArray[np.integer], *, silent: slice) -> int:
    """The first sample behind `silent` at which any channel has left what it showed there.

    What arrives earlier cannot be told from noise, in this record: the less noise it has, the less remains hidden.

    Args:
        codes: (channels, samples) digitiser codes of one record.
        silent: Samples in which the drive certainly rested.

    Raises:
        InstrumentError: nothing changes.
    """
    rest = codes[:, silent]
    level = rest.mean(axis=1, keepdims=True)
    noise = np.maximum(CERTAIN * rest.std(axis=1, keepdims=True), SMALLEST_CODES)
    left = (np.abs(codes[:, silent.stop :] - level) > noise).any(axis=0)
    if not left.any():
        raise InstrumentError(
            "scope: the light does not follow the drive: check the modulator, the RF amplifier and the trigger"
        )
    return int(silent.stop + np.argmax(left))
