"""What a planned image takes beside its pixels."""

import tracemalloc

import numpy as np

from protocols.base import Images


def test_pixels_are_digested_and_compared_without_a_copy_of_them() -> None:
    pixels = np.random.default_rng(1).random((2000, 28, 28)) < 0.5
    pixels[7] = pixels[1000] = pixels[3]
    images = Images(pixels, np.zeros(2000, np.int64), np.arange(2000))
    tracemalloc.start()
    try:
        digest, identical = images.digest, images.identical
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert digest == Images(pixels.copy(), images.labels, images.indices).digest
    assert identical == 3
    assert most < pixels.nbytes / 2
