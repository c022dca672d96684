"""The digital micromirror device: which part of every superpixel sends light to the collecting fibre, and when.

1024 x 768 mirrors of 13.68 um pitch (0.7 inch XGA class). The speckle lights the central 756 x 756 mirrors: 28 x 28
superpixels of 27 x 27 mirrors.
"""

import numpy as np
from numpy.typing import NDArray

ROWS, COLUMNS = 768, 1024
PITCH_M = 13.68e-6
SIDE = 28
MIRRORS_PER_SUPERPIXEL = 27
_LIT = SIDE * MIRRORS_PER_SUPERPIXEL
_TOP, _LEFT = (ROWS - _LIT) // 2, (COLUMNS - _LIT) // 2
_FIRST_BYTE, _LAST_BYTE = _LEFT // 8, -(-(_LEFT + _LIT) // 8)


def on_counts(packed: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Mirrors turned to the collecting fibre in every superpixel.

    Args:
        packed: (768, 128), one bit a mirror, most significant bit leftmost, 1 = towards the fibre.

    Returns:
        (784,) counts 0..729, row by row.

    Raises:
        ValueError: `packed` is not (768, 128) bytes.
    """
    if packed.shape != (ROWS, COLUMNS // 8) or packed.dtype != np.uint8:
        raise ValueError(f"mirrors are {packed.dtype} {packed.shape}: give packed bits, uint8 ({ROWS}, {COLUMNS // 8})")
    bits = np.unpackbits(packed[_TOP : _TOP + _LIT, _FIRST_BYTE:_LAST_BYTE], axis=1)
    first = _LEFT - 8 * _FIRST_BYTE
    lit = bits[:, first : first + _LIT].reshape(SIDE, MIRRORS_PER_SUPERPIXEL, _LIT)
    columns = lit.sum(axis=1, dtype=np.uint8)  # at most 27: fits, and bytes add fastest
    counts: NDArray[np.uint16] = columns.reshape(SIDE, SIDE, MIRRORS_PER_SUPERPIXEL).sum(axis=2, dtype=np.uint16)
    return counts.ravel()


def on_fraction(packed: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Amplitude reflectance 0..1 of every superpixel of packed bits (768, 128): (784,) float32."""
    return fraction(on_counts(packed))


def fraction(counts: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Amplitude reflectance 0..1 of superpixels with `counts` mirrors on, any shape: counts over 729."""
    return counts.astype(np.float32) / np.float32(MIRRORS_PER_SUPERPIXEL**2)


def moved_fraction(seconds: NDArray[np.float64], *, leaves: float, arrives: float) -> NDArray[np.float64]:
    """How far the mirrors have gone from the old image to the new, 0..1, `seconds` after the new image was latched.

    m(t) = 3 x^2 - 2 x^3, x = (t - leaves) / (arrives - leaves) clipped to 0..1: mirrors of a die cross at slightly
    different times, the lit fraction moves smoothly. Leaves and arrives in s.
    """
    x = np.clip((seconds - leaves) / (arrives - leaves), 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)
