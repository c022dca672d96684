"""The words of a message: commands, queries, their arguments, and how a line of text divides into them.

Grammar: IEEE 488.2-1992, chapter 7. Units are separated by `;`, a header ends at white space, arguments are separated
by `,`. Quoted strings and parentheses may hold commas, quoted strings semicolons as well.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

SYNTAX_ERROR = -102
INVALID_BLOCK = -161

BLOCK = "#0"  # stands for a block in a line of text: no other argument can read like this
WHITE = "".join(map(chr, range(0x21))).replace("\n", "")  # every control character but the newline

Argument = str | memoryview


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
    """One program message: the units up to its terminator, or up to the end of a block behind which nothing follows."""

    units: tuple[Unit, ...]

    @property
    def queries(self) -> bool:
        """Whether any unit asks for a reply."""
        return any(unit.query for unit in self.units)


def malformed(code: int) -> Malformed:
    """A unit that could not be read, with the SCPI error `code`."""
    return Malformed(header="", query=False, arguments=(), code=code)


_LONGEST_CACHED = 256  # bytes
_UNIT = re.compile(r"""(?:[^"';]+|"[^"]*"|'[^']*')*+""")
_HEADER = re.compile(r"([^\x00-\x20]+)[\x00-\x20]*(.*)", re.DOTALL)
_ARGUMENT = re.compile(
    r"""(?:[^"',(]+|"[^"]*"|'[^']*'|\((?:[^()"']|"[^"]*"|'[^']*')*+\)|\()*+"""  # (@1,2) is one argument
)


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
