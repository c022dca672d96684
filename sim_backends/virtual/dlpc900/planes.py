"""What a DLPC900 makes of the image data it is sent: 24 binary planes.

Three forms: uncompressed, run-length, enhanced run-length. Source: TI DLPC900 programmer's guide (DLPU018), sections
2.4.2 and 2.4.3, as public drivers of the device encode it (instrument facts 4.3).
"""

import struct

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics import mirrors

ROWS, COLUMNS = 1080, 1920
PLANES = 24
PER_SUPERPIXEL = ROWS // mirrors.SIDE
"""Mirrors along a side: the light fills as much of the smaller side as whole mirrors allow."""
_LIT = PER_SUPERPIXEL * mirrors.SIDE
_TOP, _LEFT = (ROWS - _LIT) // 2, (COLUMNS - _LIT) // 2
_HEADER = struct.Struct("<4sHHI8sIBB22x")  # signature, columns, rows, bytes, -, background, -, compression, -
_UNCOMPRESSED, _RUN_LENGTH, _ENHANCED = 0, 1, 2


class BadImage(Exception):
    """The data are no image of this device."""


def decode(data: bytes) -> NDArray[np.uint32]:
    """The pixels 0xBBGGRR of an image, shape (1080, 1920).

    Raises:
        BadImage: wrong header, or data that do not fill the picture.
    """
    if len(data) < _HEADER.size:
        raise BadImage("no header")
    signature, columns, rows, _size, _, _background, _, compression = _HEADER.unpack_from(data)
    if signature != b"Spld" or (rows, columns) != (ROWS, COLUMNS):
        raise BadImage("wrong signature or size")
    body = data[_HEADER.size :]
    if compression == _UNCOMPRESSED:
        return _uncompressed(body)
    if compression not in (_RUN_LENGTH, _ENHANCED):
        raise BadImage("unknown compression")
    return _Runs(body, enhanced=compression == _ENHANCED).picture()


def on_counts(pixels: NDArray[np.uint32]) -> NDArray[np.uint16]:
    """Mirrors on in every superpixel of the 24 planes, as many as `mirrors.on_counts` has of a whole one: (24, 784)."""
    lit = pixels[_TOP : _TOP + _LIT, _LEFT : _LEFT + _LIT]
    begins = np.concatenate([[0], np.flatnonzero(np.any(lit[1:] != lit[:-1], axis=1)) + 1])  # equal rows count once
    bits = np.unpackbits(lit[begins].astype("<u4").view(np.uint8), axis=1, bitorder="little")
    across = bits.reshape(len(begins), mirrors.SIDE, PER_SUPERPIXEL, 32)[..., :PLANES].sum(axis=2, dtype=np.int64)
    row_of = np.repeat(np.arange(len(begins)), np.diff([*begins, _LIT])).reshape(mirrors.SIDE, PER_SUPERPIXEL)
    on = across[row_of].sum(axis=1).transpose(2, 0, 1).reshape(PLANES, -1)
    counts: NDArray[np.uint16] = np.rint(on * (mirrors.MIRRORS_PER_SUPERPIXEL / PER_SUPERPIXEL) ** 2).astype(np.uint16)
    return counts


def _uncompressed(body: bytes) -> NDArray[np.uint32]:
    if len(body) < 3 * ROWS * COLUMNS:
        raise BadImage("too short")
    bytes_of = np.frombuffer(body, np.uint8, 3 * ROWS * COLUMNS).reshape(ROWS, COLUMNS, 3).astype(np.uint32)
    return bytes_of[..., 0] << np.uint32(16) | bytes_of[..., 1] << np.uint32(8) | bytes_of[..., 2]


class _Runs:
    """Reads run-length encoded data; `00 00` ends a line early or marks its end."""

    def __init__(self, body: bytes, *, enhanced: bool) -> None:
        self._body = body
        self._enhanced = enhanced
        self._at = 0
        self._picture = np.zeros((ROWS, COLUMNS), np.uint32)
        self._row = self._column = 0

    def picture(self) -> NDArray[np.uint32]:
        try:
            while self._step():
                pass
        except IndexError:
            raise BadImage("ends in the middle") from None
        return self._picture

    def _step(self) -> bool:
        """Read one item; False at the end of the image."""
        control = self._body[self._at]
        if control:
            run = self._next(self._count())
            self._picture[run] = self._pixel()
            return True
        kind = self._body[self._at + 1]
        if kind == 0:
            self._at += 2
            self._end_line()
        elif kind == 1:
            self._at += 2
            count = self._count() if self._enhanced else 0
            if count == 0:
                return False
            row, line = self._next(count)
            if row == 0:
                raise BadImage("no line to copy from")
            self._picture[row, line] = self._picture[row - 1, line]
        else:
            self._at += 1
            count = self._count()
            row, line = self._next(count)
            self._picture[row, line] = [self._pixel() for _ in range(count)]
        return True

    def _count(self) -> int:
        first = self._body[self._at]
        self._at += 1
        if first < 128 or not self._enhanced:
            return first
        self._at += 1
        return first & 0x7F | self._body[self._at - 1] << 7

    def _pixel(self) -> int:
        blue, green, red = self._body[self._at], self._body[self._at + 1], self._body[self._at + 2]
        self._at += 3
        return blue << 16 | green << 8 | red

    def _next(self, count: int) -> tuple[int, slice]:
        """The next `count` pixels; a full line is followed by the next one."""
        if self._column == COLUMNS:
            self._end_line()
        begin, self._column = self._column, self._column + count
        if self._column > COLUMNS or self._row >= ROWS:
            raise BadImage("does not fit the mirrors")
        return self._row, slice(begin, self._column)

    def _end_line(self) -> None:
        if self._column:
            self._row, self._column = self._row + 1, 0
