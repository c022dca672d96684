"""Where a client left a recording, in one line: what was expected, what was sent, and where blocks differ."""

import re
import zlib
from dataclasses import dataclass

import numpy as np

LONGEST_SHOWN = 160  # characters of a message in a report

_BLOCK = re.compile(rb"#([1-9A-F])")


@dataclass(frozen=True)
class Difference:
    """Where a client first left the recording; `expected` and `sent` are descriptions."""

    instrument: str
    connection: int
    message: int
    expected: str
    sent: str

    def __str__(self) -> str:
        where = f"{self.instrument}: message {self.message} of connection {self.connection}"
        return f"{where}: expected {self.expected}, was sent {self.sent}"


def describe(message: bytes) -> str:
    """A message in a report: text in quotes and cut to size; a block by its length and CRC-32."""
    begin, data, length = _block(message, len(message)) or (len(message), 0, -1)
    text = message[:begin].decode("latin-1").rstrip("\r\n")
    shown = repr(text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}...")
    if length < 0:
        return shown
    block = message[data : data + length]
    return f"{shown} #<{len(block)} bytes, crc32 {zlib.crc32(block):08x}>"


def first_difference(expected: bytes, sent: bytes) -> str:
    """Where the blocks of two messages first differ, as the end of a sentence; empty where they do not have any."""
    blocks = [_block(message, len(message)) for message in (expected, sent)]
    if blocks[0] is None or blocks[1] is None:
        return ""
    ours, theirs = (
        np.frombuffer(message, np.uint8)[data : data + max(length, 0)]
        for message, (_, data, length) in ((expected, blocks[0]), (sent, blocks[1]))
    )
    common = min(ours.size, theirs.size)
    different = np.flatnonzero(ours[:common] != theirs[:common])
    if different.size:
        at = int(different[0])
        return f"; first differing byte of the block {at}: {ours[at]:#04x} expected, {theirs[at]:#04x} sent"
    return f"; the blocks agree in their first {common} bytes"


def message_end(data: bytearray, terminator: bytes) -> int | None:
    """Where the first message in `data` ends, a block in it included; None: it goes on."""
    end = data.find(terminator)
    block = _block(data, len(data) if end < 0 else end)
    if block is not None:
        _, start, length = block
        end = data.find(terminator, start + length) if length >= 0 else -1
    return end + 1 if end >= 0 else None


def _block(data: bytes | bytearray, stop: int) -> tuple[int, int, int] | None:
    """The block that begins before `stop`: where its `#` is, where its bytes begin, how many; -1: not yet known."""
    for found in _BLOCK.finditer(data, 0, stop):
        begin, start = found.start(), found.end() + int(found[1], 16)
        if begin and data[begin - 1] not in b" ,":
            continue
        digits = bytes(data[found.end() : start])
        if len(digits) < start - found.end():
            return begin, start, -1
        if digits.isdigit():
            return begin, start, int(digits)
    return None
