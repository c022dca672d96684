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
ON, OFF = b"\x00\x00\x01", b"\x00\x00\x00"  # pixels, blue green red: bit position 0


def encode(mirrors: NDArray[np.uint8]) -> bytes:
    """A binary picture as bit position 0 of an image.

    mirrors: packed bits, shape (rows, columns / 8), most significant bit leftmost.
    """
    rows, columns = mirrors.shape[0], 8 * mirrors.shape[1]
    lines: list[bytes] = []
    same = b"\0\1" + _count(columns) + END_OF_LINE
    for row, packed in enumerate(mirrors):
        repeats = row > 0 and np.array_equal(packed, mirrors[row - 1])
        lines.append(same if repeats else _line(np.unpackbits(packed)))
    body = b"".join(lines) + END_OF_IMAGE
    body += bytes(-(HEADER.size + len(body)) % 4)
    size = HEADER.size + len(body)
    return HEADER.pack(SIGNATURE, columns, rows, size, b"\xff" * 8, 0, 0, ENHANCED_RUN_LENGTH, 1) + body


def _line(bits: NDArray[np.uint8]) -> bytes:
    """Runs of equal pixels: how many, then the pixel."""
    begins = np.concatenate(([0], np.flatnonzero(np.diff(bits)) + 1, [bits.size]))
    lengths = np.diff(begins).tolist()
    values = bits[begins[:-1]].tolist()
    runs = (_count(length) + (ON if value else OFF) for length, value in zip(lengths, values, strict=True))
    return b"".join(runs) + END_OF_LINE


def _count(number: int) -> bytes:
    """One byte up to 127; above it the low seven bits with the top bit set, then the rest."""
    return bytes((number,)) if number < 128 else bytes((number & 0x7F | 0x80, number >> 7))
