"""From images to mirrors."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from protocols.base import Images, ProtocolError, Shot, ShotKind


class Patterns:
    """The mirror patterns of a run's shots: images as large as the DMD allows, centred, whole mirrors a pixel."""

    def __init__(self, images: Images, shape: tuple[int, int]) -> None:
        """Prepare patterns for a DMD of `shape` mirrors.

        Raises:
            ProtocolError: the images are larger than the DMD.
        """
        height, width = images.images.shape[1:]
        self._pitch = min(shape[0] // height, shape[1] // width)
        if self._pitch == 0:
            raise ProtocolError(
                f"images of {height}x{width} pixels do not fit a DMD of {shape[0]}x{shape[1]} mirrors: "
                f"use smaller images"
            )
        self._row = (shape[0] - height * self._pitch) // 2
        self._column = (shape[1] - width * self._pitch) // 2
        self._shape = shape
        self._images = images

    def block(self, shots: Sequence[Shot]) -> NDArray[np.uint8]:
        """The packed mirror bits of several shots, shape (n, rows, columns / 8)."""
        mirrors = np.zeros((len(shots), self._shape[0], self._shape[1] // 8), np.uint8)
        for place, shot in enumerate(shots):
            self._draw(shot, mirrors[place])
        return mirrors

    def __getitem__(self, shot: Shot) -> NDArray[np.uint8]:
        """The packed mirror bits of `shot`, shape (rows, columns / 8); a dark shot turns every mirror away."""
        mirrors: NDArray[np.uint8] = self.block((shot,))[0]
        return mirrors

    def _draw(self, shot: Shot, mirrors: NDArray[np.uint8]) -> None:
        """Set the bits of `shot` in `mirrors`, which are all off."""
        if shot.kind is ShotKind.DARK:
            return
        image = self._images.images[self._images.places[shot.dataset_index]]
        lines = np.zeros((image.shape[0], self._shape[1]), bool)
        lines[:, self._column : self._column + image.shape[1] * self._pitch] = np.repeat(image, self._pitch, axis=1)
        packed = np.packbits(lines, axis=1)
        rows = mirrors[self._row : self._row + len(packed) * self._pitch]
        rows.reshape(len(packed), self._pitch, -1)[:] = packed[:, np.newaxis]
