"""Definite-length blocks (IEEE 488.2, 8.7.9): `#`, the number of digits, so many digits, so many bytes."""

import socket
import zlib
from collections.abc import Callable

PIECE = 1 << 18
"""Bytes that go over a socket at once: while one piece is summed up in the cache, the wire carries the next."""


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


def send(link: socket.socket, data: memoryview, sent: Callable[[memoryview], object]) -> None:
    """All of `data` into `link`; `sent` is called with each piece that went.

    Raises:
        OSError: it cannot be sent.
    """
    for start in range(0, len(data), PIECE):
        piece = data[start : start + PIECE]
        link.sendall(piece)
        sent(piece)


def receive(link: socket.socket, count: int, received: Callable[[memoryview], object] = len) -> bytearray:
    """So many bytes from `link`, however many pieces they come in; `received` is called with each.

    Raises:
        OSError: they do not come.
    """
    data = bytearray(count)
    view = memoryview(data)
    while len(view):
        length = link.recv_into(view[:PIECE])
        if length == 0:
            raise ConnectionResetError("the instrument closed the connection in the middle of a block")
        received(view[:length])
        view = view[length:]
    return data


def length_digits(head: bytes) -> int:
    """How many digits follow `#N`; N may be a hexadecimal digit, because records can need ten digits.

    Raises:
        ValueError: `head` is not the head of a block.
    """
    if head[:1] != b"#" or head[1:] not in b"123456789ABCDEFabcdef":
        raise ValueError(f"the reply starts with {head!r}, not with a block")
    return int(head[1:], 16)
