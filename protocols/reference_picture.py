"""Pictures beside a reference that is always on: an image in the middle of the mirrors, a border around it.

Every pixel is three by three squares of mirrors, of which a diagonal third is used. Image and reference never share a
mirror, so the field of both together is the sum of their fields. More mirrors give more light than a detector takes; a
stronger reference leaves less of the digitiser's range for its beat with the image. Random patterns chose, on one twin:
held out, they come back to 0.341 so (two frames of 10 ns), 0.346 and 0.361 with a reference of two thirds and of all
mirrors of the border.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

BORDER = 4
"""Width of the reference, in pixels of the images: it leaves 20 x 20 of 28 x 28."""
SQUARES = 3
"""Squares of mirrors along a pixel's side."""
COARSEST = 2.0
"""Pixels: the widest grain of random patterns, as standard deviation of a Gaussian filter."""


def field_of(images: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The middle of images (n, rows, columns), which is shown: BORDER pixels less on each side."""
    return images[:, BORDER:-BORDER, BORDER:-BORDER]


def beside_reference(fields: NDArray[np.bool_], *, reference: NDArray[np.bool_] | bool) -> NDArray[np.bool_]:
    """Pictures of `fields` (n, rows, columns), with the reference where `reference` (n,) says so.

    Returns:
        (n, SQUARES (rows + 2 BORDER), SQUARES (columns + 2 BORDER)), True = on.
    """
    count, rows, columns = fields.shape
    edge = SQUARES * BORDER
    pictures = np.zeros((count, SQUARES * rows + 2 * edge, SQUARES * columns + 2 * edge), np.bool_)
    third = np.add.outer(np.arange(pictures.shape[1]), np.arange(pictures.shape[2])) % SQUARES == 0
    pictures[np.broadcast_to(reference, count)] = third
    middle = (slice(None), slice(edge, -edge), slice(edge, -edge))
    pictures[middle] = fields.repeat(SQUARES, axis=1).repeat(SQUARES, axis=2) & third[middle[1:]]
    return pictures


def random_patterns(seed: int, count: int, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Random patterns (count, *shape), half of the pixels of each on: Gaussian noise of random grain above its median.

    Grains from single pixels to COARSEST: fine ones alone hold little of the low spatial frequencies that speckle has.
    """
    generator = np.random.default_rng((seed, 6))
    patterns = np.empty((count, *shape), np.bool_)
    for pattern, grain in zip(patterns, generator.uniform(0, COARSEST, count), strict=True):
        noise = gaussian_filter(generator.standard_normal(shape), grain, mode="wrap")
        np.greater(noise, np.median(noise), out=pattern)
    return patterns
