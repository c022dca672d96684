"""Definite-length blocks (IEEE 488.2, 8.7.9): `#`, the number of digits, so many digits, so many bytes."""

import socket
import time
import zlib
from collections.abc import Callable

PIECE = 1 << 18
"""Bytes that go over a socket at once: while one piece is summed up in the cache, the wire carries the next."""


LEAST_RATE = 100_000
"""Bytes per second, less than any network carries: a piece has the session's timeout and the time it takes at this."""
LONGEST_BLOCK = 1 << 32
"""Bytes: four times the longest record of an oscilloscope."""


class Digest:
    """What a transcript says of a block: length and CRC-32, which unlike longer digests keeps pace with the wire."""

    def __init__(self) -> None:
        """Nothing yet."""
        self._length = 0
        self._crc32 = 0

    def add(self, piece: bytes | bytearray | memoryview) -> None:
        """Bytes that follow those before."""
        self._length += len(piece)
        self._crc32 = zlib.crc32(piece, self._crc32)

    def __str__(self) -> str:
        """The block in the transcript."""
        return f"#<{self._length} bytes, crc32 {self._crc32:08x}>"


def send(link: socket.socket, data: memoryview, sent: Callable[[memoryview], object], *, timeout_s: float) -> None:
    """All of `data` into `link`; `sent` is called with each piece that went.

    Raises:
        OSError: it cannot be sent, or a piece of it takes too long.
    """
    for start in range(0, len(data), PIECE):
        piece = data[start : start + PIECE]
        link.settimeout(_patience_s(piece, timeout_s))
        link.sendall(piece)  # which the timeout bounds as a whole
        sent(piece)


def receive(
    link: socket.socket, count: int, received: Callable[[memoryview], object] = len, *, timeout_s: float
) -> bytearray:
    """So many bytes from `link`, however many packets they come in; `received` is called with each.

    Raises:
        OSError: they do not come, or a piece of them takes too long.
        ValueError: more than any instrument has.
    """
    if count > LONGEST_BLOCK:
        raise ValueError(f"a block of {count} bytes is announced, and no more than {LONGEST_BLOCK} are taken")
    data = bytearray(count)
    view = memoryview(data)
    while len(view):
        piece, view = view[:PIECE], view[PIECE:]
        deadline = time.monotonic() + _patience_s(piece, timeout_s)
        while len(piece):
            left_s = deadline - time.monotonic()
            if left_s <= 0:
                raise TimeoutError
            link.settimeout(left_s)
            length = link.recv_into(piece)
            if length == 0:
                raise ConnectionResetError("the instrument closed the connection in the middle of a block")
            received(piece[:length])
            piece = piece[length:]
    return data


def _patience_s(piece: memoryview, timeout_s: float) -> float:
    return timeout_s + len(piece) / LEAST_RATE


def length_digits(head: bytes) -> int:
    """How many digits follow `#N`; N may be a hexadecimal digit, because records can need ten digits.

    Raises:
        ValueError: `head` is not the head of a block.
    """
    if head[:1] != b"#" or head[1:] not in b"123456789ABCDEFabcdef":
        raise ValueError(f"the reply starts with {head!r}, not with a block")
    return int(head[1:], 16)
