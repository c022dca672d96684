"""Definite-length blocks (IEEE 488.2, 8.7.9): `#`, the number of digits, so many digits, so many bytes."""

import socket
import zlib


def receive(link: socket.socket, count: int) -> bytearray:
    """So many bytes from `link`, however many pieces they come in.

    Raises:
        OSError: they do not come.
    """
    data = bytearray(count)
    view = memoryview(data)
    while len(view):
        received = link.recv_into(view)
        if received == 0:
            raise ConnectionResetError("the instrument closed the connection in the middle of a block")
        view = view[received:]
    return data


def length_digits(head: bytes) -> int:
    """How many digits follow `#N`; N may be a hexadecimal digit, because records can need ten digits.

    Raises:
        ValueError: `head` is not the head of a block.
    """
    if head[:1] != b"#" or head[1:] not in b"123456789ABCDEFabcdef":
        raise ValueError(f"the reply starts with {head!r}, not with a block")
    return int(head[1:], 16)


def describe(block: bytes | bytearray | memoryview) -> str:
    """A block in the transcript: its length and CRC-32, which unlike longer digests keeps pace with the wire."""
    return f"#<{len(block)} bytes, crc32 {zlib.crc32(block):08x}>"
