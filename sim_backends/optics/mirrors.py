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

_AT_ONCE = 8  # patterns counted together: their words fit the cache

_PLACE = (np.arange(8 * _FIRST_BYTE, 8 * _LAST_BYTE) - _LEFT) // MIRRORS_PER_SUPERPIXEL  # of a column's superpixel
_OF_ONE = np.packbits(np.arange(SIDE)[:, np.newaxis] == _PLACE, axis=1).view(np.uint64)
_WORDS = np.array([np.flatnonzero(of_one)[[0, -1]] for of_one in _OF_ONE]).T  # first and last of a superpixel's
_MASKS = _OF_ONE[np.arange(SIDE), _WORDS]  # its columns in these
_MASKS[1, _WORDS[0] == _WORDS[1]] = 0


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
    pictures = packed.reshape(-1, ROWS, COLUMNS // 8)
    lit = pictures[:, _TOP : _TOP + _LIT, _FIRST_BYTE:_LAST_BYTE]
    rows = lit.reshape(len(lit), SIDE, MIRRORS_PER_SUPERPIXEL, _LAST_BYTE - _FIRST_BYTE).transpose(2, 0, 1, 3)
    counts = np.empty((len(lit), SIDE * SIDE), np.uint16)
    few = min(_AT_ONCE, len(lit))
    words = np.empty((MIRRORS_PER_SUPERPIXEL, few, SIDE, rows.shape[-1]), np.uint8)
    room = np.empty((2, MIRRORS_PER_SUPERPIXEL // 3, few, SIDE, rows.shape[-1] // 8), np.uint64)
    for begin in range(0, len(lit), _AT_ONCE):
        part = slice(begin, begin + _AT_ONCE)
        if _rows_are_alike(pictures[part]):
            counts[part] = MIRRORS_PER_SUPERPIXEL * _counted(np.ascontiguousarray(rows[0, part]).view(np.uint64))
        else:
            here = slice(len(counts[part]))
            words[:, here] = rows[:, part]
            counts[part] = _added(words[:, here].view(np.uint64), room[:, :, here])
    return counts.reshape(*packed.shape[:-2], SIDE * SIDE)


def _rows_are_alike(pictures: NDArray[np.uint8]) -> bool:
    """Whether each superpixel's rows of mirrors are the same in all pictures (n, 768, 128), as where it is a pixel."""
    words = np.ascontiguousarray(pictures).reshape(len(pictures), -1).view(np.uint64)
    row = COLUMNS // 64
    first, end = _TOP * row, (_TOP + _LIT) * row
    differs = words[:, first:end] != words[:, first - row : end - row]  # from the row above
    return not differs.reshape(len(pictures), SIDE, -1)[:, :, row:].any()


def _added(words: NDArray[np.uint64], room: NDArray[np.uint64]) -> NDArray[np.uint16]:
    """Counts (n, 784) of rows of bits, (27, n, 28, words), which are overwritten; `room` for two thirds of them.

    Three words of bits add to a sum and a carry word (a full adder a bit): 27 rows become the five binary digits of
    their sums, and what is lit of a superpixel's columns in a digit's words is counted.
    """
    counts = np.zeros((words.shape[1], SIDE * SIDE), np.uint16)
    digit = 0
    while True:
        carries = []
        while (third := len(words) // 3) > 0:
            first, second, last = (words[place * third : (place + 1) * third] for place in range(3))
            either, both = room[:, :third]
            np.bitwise_xor(first, second, out=either)
            np.bitwise_and(first, second, out=first)
            first |= np.bitwise_and(either, last, out=both)
            last ^= either
            carries.append(first)
            words = words[2 * third :]
        if len(words) == 2:
            carries.append(words[:1] & words[1:])
            words = words[:1] ^ words[1:]
        counts += _counted(words[0]) << digit
        if not carries:
            return counts
        words = np.concatenate(carries)
        digit += 1


def _counted(row: NDArray[np.uint64]) -> NDArray[np.uint16]:
    """Mirrors turned to the fibre of one row of every superpixel, (n, 28, words): (n, 784)."""
    lit = np.take(row, _WORDS, axis=-1)
    lit &= _MASKS
    left, right = np.moveaxis(np.bitwise_count(lit), -2, 0)
    return np.asarray((left + right).astype(np.uint16).reshape(len(row), -1))


def on_fraction(packed: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Amplitude reflectance 0..1 of every superpixel of packed bits (768, 128): (784,) float32."""
    return fraction(on_counts(packed))


def inverted(counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Counts (..., 784) when every mirror is turned the other way."""
    return np.uint16(MIRRORS_PER_SUPERPIXEL**2) - counts


def upside_down(counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Counts (n, 784) when the rows of mirrors change places, first and last: the lit ones lie in the middle."""
    return counts.reshape(-1, SIDE, SIDE)[:, ::-1].reshape(counts.shape)


def left_for_right(counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Counts (n, 784) when the columns of mirrors change places, first and last: the lit ones lie in the middle."""
    return counts.reshape(-1, SIDE, SIDE)[:, :, ::-1].reshape(counts.shape)


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
