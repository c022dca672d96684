"""IEEE 488.2 program messages: read byte by byte from a stream, and divided into commands, queries and their arguments.

A message ends at a newline, but quoted strings may hold the separators, and blocks (`#<digits><length><bytes>`) any
byte at all. Units are separated by `;`, a header ends at white space, arguments are separated by `,`; quoted strings
and parentheses may hold commas, quoted strings semicolons as well. Grammar: IEEE 488.2-1992, chapter 7.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

SYNTAX_ERROR = -102
INVALID_BLOCK = -161

BLOCK = "#0"  # stands for a block in a line of text: no other argument can read like this
WHITE = "".join(map(chr, range(0x21))).replace("\n", "")  # every control character but the newline

TEXT_ROOM = 65_536  # bytes; the text buffer's first size
LONGEST_TEXT = 1 << 20  # bytes; text without a newline is cut here
LARGEST_BLOCK = 1 << 30  # bytes
ROOM_BEHIND_BLOCK = 512  # bytes; what follows a block is fetched together with the block's end

_WHITE_BYTES = WHITE.encode()

# As far as the first block: a `#` that begins an argument and is followed by a digit (or by A: ten digits; B, H and Q
# begin numbers). Stops at a quote that nothing closes, too. A message never begins with a block, whatever came before.
_UP_TO_BLOCK = re.compile(rb"""#?(?:[^"'#\n]+|"[^"\n]*"|'[^'\n]*'|#(?=[^0-9A])|(?<![\x00-\x09\x0b-\x20,])#)*""")
_LONGEST_CACHED = 256  # bytes
_UNIT = re.compile(r"""(?:[^"';]+|"[^"]*"|'[^']*')*""")
_HEADER = re.compile(r"([^\x00-\x20]+)[\x00-\x20]*(.*)", re.DOTALL)
_ARGUMENT = re.compile(
    r"""(?:[^"',(]+|"[^"]*"|'[^']*'|\((?:[^()"']|"[^"]*"|'[^']*')*\)|\()*"""  # (@1,2) is one argument
)

Argument = str | memoryview
Chunk = bytes | memoryview
"""A piece of a reply."""


@dataclass(frozen=True, slots=True)
class Unit:
    """One command or query.

    Attributes:
        header: As sent, a leading `:` kept, the `?` of a query removed.
        query: Whether the header ended in `?`.
        arguments: Text as sent, quotes kept, surrounding white space removed; blocks as bytes without their `#` header.
    """

    header: str
    query: bool
    arguments: tuple[Argument, ...]


@dataclass(frozen=True, slots=True)
class Malformed(Unit):
    """A unit that cannot be read: empty header, no arguments, and the SCPI error `code` to queue (-102 or -161)."""

    code: int


@dataclass(frozen=True, slots=True)
class Message:
    """One program message: the units up to its terminator, or up to the end of a block behind which nothing follows.

    Attributes:
        queries: Whether any unit has a reply.
    """

    units: tuple[Unit, ...]
    queries: bool = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "queries", any(unit.query for unit in self.units))


def malformed(code: int) -> Malformed:
    """A unit that could not be read, with the SCPI error `code`."""
    return Malformed(header="", query=False, arguments=(), code=code)


class MessageReader:
    r"""Cuts the bytes of one connection into messages; one reader per connection.

    Receive into `buffer()`, then call `received` with how many bytes came. Blocks are received where they stay:
    `buffer()` is the rest of the block while one is under way, and the argument handed out is a view of that memory,
    which `numpy.frombuffer` reads without a copy. (Only a block's first bytes, which came with the text before, are
    moved.)

    Behind a block the message may end (`\n`, `\r\n`), go on (`;` or `,`) or simply stop: many clients send no
    terminator there. A message whose bytes at hand end with a block is therefore complete at once; a newline that
    follows later is an empty message, and empty messages are dropped. Nothing a client sends can raise: what is not a
    message becomes `Malformed`, and the next message is read as if nothing had been wrong.

    Attributes:
        begun: The text before the block that is under way; empty while none is.
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
        self.begun = b""
        self._length = self._filled = 0

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
        """Where the first block begins before `stop`; None: there is none, as far as the bytes at hand show."""
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
            self.begun = self._pieces[0]
        return complete

    def _end_block(self, block: memoryview) -> None:
        """The block under way is complete: keep it, and move what came behind it to the text buffer."""
        behind = block[self._length : self._filled]
        self._blocks.append(block[: self._length])
        self._block, self.begun = None, b""
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


def parse(text: bytes, blocks: list[memoryview]) -> Message:
    """The message in a line of text in which `#0` stands for each of `blocks`, in order."""
    template = _parsed(text) if len(text) <= _LONGEST_CACHED else _parse(text)
    if not blocks:
        return template
    if sum(unit.arguments.count(BLOCK) for unit in template.units) != len(blocks):
        return Message((malformed(SYNTAX_ERROR),))  # a block where no argument can stand
    return _with_blocks(template, iter(blocks))


def _parse(text: bytes) -> Message:
    return Message(tuple(_units(text.decode("latin-1"))))


_parsed = lru_cache(maxsize=2048)(_parse)  # clients repeat themselves


def _units(text: str) -> Iterator[Unit]:
    position = 0
    while position < len(text):
        match = _UNIT.match(text, position)
        end = match.end() if match else len(text)
        if end < len(text) and text[end] != ";":
            yield malformed(SYNTAX_ERROR)  # a quote that nothing closes
            return
        if unit := text[position:end].strip(WHITE):
            yield _unit(unit)
        position = end + 1


def _unit(text: str) -> Unit:
    match = _HEADER.match(text)
    if match is None or text[0] in "#,?":
        return malformed(SYNTAX_ERROR)
    header, rest = match.groups()
    arguments = tuple(_arguments(rest)) if rest else ()
    if None in arguments:
        return malformed(SYNTAX_ERROR)
    query = header.endswith("?")
    return Unit(header[:-1] if query else header, query, tuple(text for text in arguments if text is not None))


def _arguments(text: str) -> Iterator[str | None]:
    """The arguments in `text`, split at its commas; None where a quote stays open."""
    if not any(mark in text for mark in "\"'("):
        yield from (argument.strip(WHITE) for argument in text.split(","))
        return
    position = 0
    while position <= len(text):
        match = _ARGUMENT.match(text, position)
        end = match.end() if match else len(text)
        if end < len(text) and text[end] != ",":
            yield None
            return
        yield text[position:end].strip(WHITE)
        position = end + 1


def _with_blocks(template: Message, blocks: Iterator[memoryview]) -> Message:
    return Message(
        tuple(
            replace(unit, arguments=tuple(next(blocks) if text == BLOCK else text for text in unit.arguments))
            for unit in template.units
        )
    )
