"""The image of a shot as it travels with the events of a run: small, and without the data set it comes from."""

import base64
from collections.abc import Callable
from typing import Any

import numpy as np

from protocols.base import Images, Inputs, Shot

LARGEST = 64
"""Rows or columns; of a larger image every second, third, ... one is left out."""


def shown_images(inputs: Inputs) -> Callable[[Shot], dict[str, Any]]:
    """What says how the image of a shot looks: `image` with `rows`, `columns` and `bits`; nothing without an image.

    `bits` is the base64 of the pixels row by row, eight to a byte, most significant first, 1 = on.
    """
    if not isinstance(inputs, Images):
        return lambda _shot: {}
    step = max(1, -(-max(inputs.images.shape[1:]) // LARGEST))

    def shown(shot: Shot) -> dict[str, Any]:
        place = inputs.places.get(shot.dataset_index)
        if place is None:
            return {}
        pixels = inputs.images[place][::step, ::step]
        rows, columns = pixels.shape
        bits = base64.b64encode(np.packbits(pixels).tobytes()).decode()
        return {"image": {"rows": rows, "columns": columns, "bits": bits}}

    return shown
