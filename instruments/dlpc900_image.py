"""Images in the form a DLPC900 takes them: 24 bits a pixel, enhanced run-length encoding.

Source: TI DLPC900 programmer's guide (DLPU018), sections 2.4.2 and 2.4.3, as a public driver in use with the device
encodes it (instrument facts 4.3). Bit position n of an image is bit n of the number 0xBBGGRR of a pixel.
"""

import struct

import numpy as np
from numpy.typing import NDArray

HEADER = struct.Struct("<4sHHI8sIBBB21x")  # signature, columns, rows, bytes, -, background, -, compression, -
SIGNATURE = b"Spld"
ENHANCED_RUN_LENGTH = 2
END_OF_LINE = b"\0\0"
END_OF_IMAGE = b"\0\1\0"
PLANES = 24


def encode(pictures: NDArray[np.uint8]) -> bytes:
    """Binary pictures as the bit positions 0, 1, ... of an image.

    pictures: packed bits, shape (n, rows, columns / 8) with n up to 24, most significant bit leftmost.
    """
    rows, columns = pictures.shape[1], 8 * pictures.shape[2]
    lines: list[bytes] = []
    same = b"\0\1" + _count(columns) + END_OF_LINE
    repeats = np.all(pictures[:, 1:] == pictures[:, :-1], axis=(0, 2))
    weights = np.uint32(1) << np.arange(len(pictures), dtype=np.uint32)
    for row in range(rows):
        if row > 0 and repeats[row - 1]:
            lines.append(same)
        else:
            lines.append(_line(weights @ np.unpackbits(pictures[:, row], axis=1)))
    body = b"".join(lines) + END_OF_IMAGE
    body += bytes(-(HEADER.size + len(body)) % 4)
    size = HEADER.size + len(body)
    return HEADER.pack(SIGNATURE, columns, rows, size, b"\xff" * 8, 0, 0, ENHANCED_RUN_LENGTH, 1) + body


def _line(pixels: NDArray[np.uint32]) -> bytes:
    """Runs of equal pixels: how many, then the pixel: blue, green, red."""
    begins = np.concatenate(([0], np.flatnonzero(np.diff(pixels)) + 1, [pixels.size]))
    lengths = np.diff(begins).tolist()
    values = pixels[begins[:-1]].tolist()
    runs = (_count(length) + value.to_bytes(3, "big") for length, value in zip(lengths, values, strict=True))
    return b"".join(runs) + END_OF_LINE


def _count(number: int) -> bytes:
    """One byte up to 127; above it the low seven bits with the top bit set, then the rest."""
    return bytes((number,)) if number < 128 else bytes((number & 0x7F | 0x80, number >> 7))
