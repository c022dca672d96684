"""IEEE 488.2 program messages, read byte by byte from a stream.

A message ends at a newline, but quoted strings may hold the separators, and blocks (`#<digits><length><bytes>`) any
byte at all. Grammar: IEEE 488.2-1992, chapter 7.
"""

import re

import numpy as np

from sim_backends.scpi.units import (
    BLOCK,
    INVALID_BLOCK,
    SYNTAX_ERROR,
    WHITE,
    Argument,
    Malformed,
    Message,
    Unit,
    malformed,
    parse,
)

__all__ = ["Argument", "Malformed", "Message", "MessageReader", "Unit"]

TEXT_ROOM = 65_536  # bytes; the text buffer's first size
LONGEST_TEXT = 1 << 20  # bytes; text without a newline is cut here
LARGEST_BLOCK = 1 << 30  # bytes
ROOM_BEHIND_BLOCK = 512  # bytes; what follows a block is fetched together with the block's end

_WHITE_BYTES = WHITE.encode()

# As far as the first block: a `#` that begins an argument and is followed by a digit (or by A: ten digits; B, H and Q
# begin numbers). Stops at a quote that nothing closes, too. A message never begins with a block, whatever came before.
_UP_TO_BLOCK = re.compile(rb"""#?(?:[^"'#\n]+|"[^"\n]*"|'[^'\n]*'|#(?=[^0-9A])|(?<![\x00-\x09\x0b-\x20,])#)*+""")


class MessageReader:
    r"""Cuts the bytes of one connection into messages; one reader per connection.

    Receive into `buffer()`, then tell `received` how many bytes came. Blocks are received where they stay: `buffer()`
    is the rest of the block while one is under way, and the argument handed out is a view of that memory, which
    `numpy.frombuffer` reads without a copy. (Only a block's first bytes, which came with the text before, are moved.)

    Behind a block the message may end (`\n`, `\r\n`), go on (`;` or `,`) or simply stop: many clients send no
    terminator there. A message whose bytes at hand end with a block is therefore complete at once; a newline that
    follows later is an empty message, and empty messages are dropped. Nothing a client sends can raise: what is not a
    message becomes `Malformed`, and the next message is read as if nothing had been wrong.
    """

    def __init__(self) -> None:
        self._text = bytearray(TEXT_ROOM)
        self._view = memoryview(self._text)
        self.clear()

    def clear(self) -> None:
        """Forget everything that has not been handed out (device clear)."""
        self._start = self._end = self._searched = 0  # of the text not yet read; no newline before `_searched`
        self._pieces: list[bytes] = []  # of the present message: the text before each block
        self._blocks: list[memoryview] = []
        self._behind_block = False
        self._block: memoryview | None = None  # the block under way, with some room behind it
        self._length = self._filled = 0

    @property
    def begun(self) -> bytes:
        """The text before the block that is under way; empty while none is."""
        return b"" if self._block is None else self._pieces[0]

    def buffer(self) -> memoryview:
        """Where the next bytes belong; never empty."""
        if self._block is not None:
            return self._block[self._filled :]
        return self._view[self._end :]

    def received(self, count: int) -> list[Message]:
        """Take over `count` bytes written to the start of `buffer()`; returns the messages they complete."""
        if self._block is None:
            self._end += count
        else:
            self._filled += count
            if self._filled < self._length:
                return []
            self._end_block(self._block)
        return self._messages()

    def end(self) -> list[Message]:
        """End the present message here, without a newline: the transport itself marks the ends of messages (HiSLIP)."""
        if self._block is not None:
            self._block = None
            return self._cut(INVALID_BLOCK)
        if self._start == self._end:
            return []
        self._text[self._end] = ord("\n")  # there is room: `buffer()` is never empty
        self._end += 1
        return self._messages()

    def _messages(self) -> list[Message]:
        found = []
        while self._block is None:
            message = self._message()
            if message is None:
                break
            if message.units:
                found.append(message)
        if self._end - self._start >= LONGEST_TEXT:
            found += self._cut(SYNTAX_ERROR)
        self._make_room()
        return found

    def _message(self) -> Message | None:
        """The next message, perhaps an empty one; None: more bytes are needed."""
        while True:
            if self._behind_block and not self._goes_on():
                return self._complete(b"")
            newline = self._text.find(b"\n", max(self._start, self._searched), self._end)
            stop = self._end if newline < 0 else newline
            begin = self._block_begin(stop)
            if begin is None or self._text[begin + 1] == ord("0"):
                return self._line(newline, begin)
            length = self._block_length(begin)
            if length is None:
                return None
            if length < 0:
                return self._line(newline, begin, malformed_block=True)
            self._pieces.append(bytes(self._view[self._start : begin]))
            self._start = begin + 2 + self._digits(begin)
            if not self._begin_block(length):
                return None

    def _goes_on(self) -> bool:
        """Whether the bytes behind a block continue its message; a terminator is skipped."""
        self._behind_block = False
        while self._start < self._end and self._text[self._start] in _WHITE_BYTES:
            self._start += 1
        if self._start == self._end:
            return False
        following = self._text[self._start]
        if following == ord("\n"):
            self._start += 1
        return following in b";,"

    def _block_begin(self, stop: int) -> int | None:
        """Where the first block begins before `stop`; None: there is none, as far as the bytes at hand tell."""
        if self._text.find(b"#", self._start, stop) < 0:
            return None
        match = _UP_TO_BLOCK.match(self._text, self._start, stop)
        begin = match.end() if match else stop
        return begin if begin + 1 < stop and self._text[begin] == ord("#") else None

    def _digits(self, begin: int) -> int:
        return int(chr(self._text[begin + 1]), 16)

    def _block_length(self, begin: int) -> int | None:
        """The bytes a block announces; None: its header is not complete; -1: the header is wrong."""
        digits = self._digits(begin)
        header = bytes(self._view[begin + 2 : min(begin + 2 + digits, self._end)])
        if header and not header.isdigit():
            return -1
        if len(header) < digits:
            return None
        return int(header) if int(header) <= LARGEST_BLOCK else -1

    def _begin_block(self, length: int) -> bool:
        """Move what is at hand of a block to memory of its own; returns whether the block is complete."""
        at_hand = min(length, self._end - self._start)
        complete = at_hand == length
        # numpy's memory is not cleared first: a wrong length costs nothing, a right one no second pass over the memory
        block = np.empty(length if complete else length + ROOM_BEHIND_BLOCK, np.uint8).data
        block[:at_hand] = self._view[self._start : self._start + at_hand]
        self._start += at_hand
        if complete:
            self._blocks.append(block)
            self._behind_block = True
        else:
            self._block, self._length, self._filled = block, length, at_hand
        return complete

    def _end_block(self, block: memoryview) -> None:
        """The block under way is complete: keep it, and move what came behind it to the text buffer."""
        behind = block[self._length : self._filled]
        self._blocks.append(block[: self._length])
        self._block = None
        self._behind_block = True
        self._start = self._searched = 0
        self._end = len(behind)
        self._view[: self._end] = behind

    def _line(self, newline: int, begin: int | None, *, malformed_block: bool = False) -> Message | None:
        """The message that ends at `newline`, its last argument the indefinite (or wrong) block at `begin`, if any."""
        if newline < 0:
            self._searched = self._end
            return None
        line = bytes(self._view[self._start : newline])
        offset = self._start
        self._start = newline + 1
        if begin is None:
            return self._complete(line)
        self._pieces.append(line[: begin - offset])
        self._blocks.append(memoryview(line)[begin - offset + 2 :])
        message = self._complete(b"")
        return Message((*message.units[:-1], malformed(INVALID_BLOCK))) if malformed_block else message

    def _complete(self, text: bytes) -> Message:
        if not self._blocks:
            return parse(text, [])
        pieces, blocks = (*self._pieces, text), self._blocks
        self._pieces, self._blocks = [], []
        return parse(BLOCK.encode().join(pieces), blocks)

    def _cut(self, code: int) -> list[Message]:
        """Give up the message under way."""
        self.clear()
        return [Message((malformed(code),))]

    def _make_room(self) -> None:
        if self._start == self._end:
            self._start = self._end = self._searched = 0
        elif self._end == len(self._text):
            rest = self._view[self._start : self._end]
            text = self._text if len(rest) <= len(self._text) // 2 else bytearray(2 * len(self._text))
            text[: len(rest)] = bytes(rest)
            self._text, self._view = text, memoryview(text)
            self._searched = max(0, self._searched - self._start)
            self._start, self._end = 0, len(rest)
