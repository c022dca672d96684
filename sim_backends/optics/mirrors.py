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

_FIRST_BITS = _LEFT - 8 * _FIRST_BYTE + MIRRORS_PER_SUPERPIXEL * np.arange(SIDE)
_BYTES = _FIRST_BITS[:, None] // 8 + np.arange(8)
_SHIFTS = (64 - MIRRORS_PER_SUPERPIXEL - _FIRST_BITS % 8).astype(np.uint64)
_COLUMNS_MASK = np.uint64((1 << MIRRORS_PER_SUPERPIXEL) - 1)
_AT_ONCE = 16  # patterns counted together: their words fit the cache


def on_counts(packed: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Mirrors turned to the collecting fibre in every superpixel.

    Args:
        packed: (..., 768, 128), one bit a mirror, most significant bit leftmost, 1 = towards the fibre.

    Returns:
        (..., 784) counts 0..729, row by row.

    Raises:
        ValueError: `packed` does not end in (768, 128) bytes.
    """
    if packed.shape[-2:] != (ROWS, COLUMNS // 8) or packed.dtype != np.uint8:
        raise ValueError(f"mirrors are {packed.dtype} {packed.shape}: give packed bits, uint8 ({ROWS}, {COLUMNS // 8})")
    patterns = packed.reshape(-1, ROWS, COLUMNS // 8)
    counts = np.empty((len(patterns), SIDE * SIDE), np.uint16)
    for begin in range(0, len(patterns), _AT_ONCE):
        block = patterns[begin : begin + _AT_ONCE]
        counts[begin : begin + len(block)] = _counted(block)
    return counts.reshape(*packed.shape[:-2], SIDE * SIDE)


def _counted(patterns: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Counts of a few patterns: 27 rows of bits are added up 64 columns at a time, then 27 columns of every digit.

    Three words of bits add to a sum and a carry word (a full adder a bit): 27 rows become the five binary digits of
    their sums; a superpixel's 27 bits of a digit are shifted out of eight bytes and counted.
    """
    lit = np.ascontiguousarray(patterns[:, _TOP : _TOP + _LIT, _FIRST_BYTE:_LAST_BYTE]).view(np.uint64)
    rows = lit.reshape(len(patterns), SIDE, MIRRORS_PER_SUPERPIXEL, -1)
    waiting = [[rows[:, :, row] for row in range(MIRRORS_PER_SUPERPIXEL)]]
    counts = np.zeros((len(patterns), SIDE, SIDE), np.uint16)
    weight = 1
    while waiting:
        words = waiting.pop()
        carries = []
        while len(words) > 1:
            first, second = words.pop(), words.pop()
            third = words.pop() if words else None
            either, both = first ^ second, first & second
            if third is None:
                words.append(either)
                carries.append(both)
            else:
                carries.append(both | (either & third))
                words.append(either ^ third)
        digit = np.zeros((len(patterns), SIDE, _LAST_BYTE - _FIRST_BYTE + 8), np.uint8)
        digit[:, :, : _LAST_BYTE - _FIRST_BYTE] = words[0].view(np.uint8)
        bits = np.take(digit, _BYTES, axis=-1).view(">u8")[..., 0].astype(np.uint64)
        counts += np.bitwise_count((bits >> _SHIFTS) & _COLUMNS_MASK).astype(np.uint16) * np.uint16(weight)
        weight *= 2
        if carries:
            waiting.append(carries)
    return counts.reshape(len(patterns), -1)


def on_fraction(packed: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Amplitude reflectance 0..1 of every superpixel of packed bits (768, 128): (784,) float32."""
    return fraction(on_counts(packed))


def inverted(counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Counts (..., 784) when every mirror is turned the other way."""
    return np.uint16(MIRRORS_PER_SUPERPIXEL**2) - counts


def upside_down(counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Counts (n, 784) when the rows of mirrors change places, first and last: the lit ones lie in the middle."""
    return counts.reshape(-1, SIDE, SIDE)[:, ::-1].reshape(counts.shape)


def fraction(counts: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Amplitude reflectance 0..1 of superpixels with `counts` mirrors on, any shape: counts over 729."""
    return counts.astype(np.float32) / np.float32(MIRRORS_PER_SUPERPIXEL**2)


def reflected(on: NDArray[np.float32], contrast: float) -> NDArray[np.float32]:
    """Amplitude that superpixels send towards the fibre while the part `on` of their mirrors is on, any shape.

    Mirrors that are off scatter 1 / contrast of the power there: e + (1 - e) on, e = contrast^(-1/2), taken as in phase
    with what they would send if they were on.
    """
    leaked = np.float32(contrast**-0.5)
    amplitude = (np.float32(1) - leaked) * on
    amplitude += leaked
    return np.asarray(amplitude)


def moved_fraction(seconds: NDArray[np.float64], *, leaves: float, arrives: float) -> NDArray[np.float64]:
    """How far the mirrors have gone from the old image to the new, 0..1, `seconds` after the new image was latched.

    m(t) = 3 x^2 - 2 x^3, x = (t - leaves) / (arrives - leaves) clipped to 0..1: mirrors of a die cross at slightly
    different times, the lit fraction moves smoothly. Leaves and arrives in s.
    """
    x = np.clip((seconds - leaves) / (arrives - leaves), 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)
