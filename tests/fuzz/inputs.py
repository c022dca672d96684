"""What a client might send: commands drawn from the tables themselves, in any spelling, and plain garbage.

Numbers stay modest where they ask for work (points, frames, averages): the inputs look for exceptions and lost step,
not for patience.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from hypothesis import strategies as st

from sim_backends import virtual
from sim_backends.scpi.arguments import (
    Block,
    Boolean,
    ChannelList,
    Integer,
    Keyword,
    Kind,
    Quoted,
    Real,
    Several,
    short_form,
)
from sim_backends.scpi.commands import Command
from sim_backends.virtual.instrument import COMMON, VirtualInstrument
from sim_backends.virtual.tlg220.instrument import default_table

MODELS: dict[str, type[VirtualInstrument]] = {
    name: found
    for name in virtual.__all__
    if isinstance(found := getattr(virtual, name), type)
    and issubclass(found, VirtualInstrument)
    and found is not VirtualInstrument
}

MODEST = {
    "HORizontal:MODE:SCAle": (1e-12, 1e-7),
    "HORizontal:MODE:SAMPLERate": (6.25e9, 1e11),
    "HORizontal:MODE:RECOrdlength": (50, 2000),
    "HORizontal:FASTframe:LENgth": (50, 500),
    "HORizontal:FASTframe:COUNt": (1, 20),
    "ACQuire:NUMAVg": (2, 12),
}
"""Limits of the numbers whose largest values mean a long wait or much memory."""

LARGEST = 5000
_WORDS = st.sampled_from(["m", "n", "s", "a b", "x;y", 'q""q', "", "C:\\m.wfmx", "m.seqx"])
_LASER = tuple(re.sub(r"\{.*?\}", "{}", entry["write"]) for entry in default_table()["commands"].values())


@dataclass(frozen=True)
class Statement:
    """One command or query, not yet spelled: nodes of its header with suffixes, and for each argument its spellings."""

    nodes: tuple[tuple[str, str, bool], ...]  # declared name, suffix as text, whether it may be left out
    query: bool
    arguments: tuple[tuple[bytes, ...], ...]


def _numbers(low: float, high: float) -> st.SearchStrategy[float]:
    low, high = max(low, -1e12), min(high, 1e12)
    ordinary = st.floats(low, high, allow_nan=False)
    return st.one_of(st.sampled_from([low, high]), ordinary, st.integers(0, 12).map(lambda n: min(max(n, low), high)))


def _spelled_number(value: float) -> tuple[bytes, ...]:
    spellings = [repr(value), f"{value!r}".upper().replace("E", " E "), f" {value!r} "]
    if value >= 0:
        spellings.append(f"+{value!r}")
    if value == int(value) and abs(value) < 1e9:
        spellings += [str(int(value)), f"{int(value)}.", f"{int(value)}E0", f"{int(value)}0E-1"]
    return tuple(text.encode() for text in spellings)


def _block(payload: bytes) -> tuple[bytes, ...]:
    length = str(len(payload)).encode()
    return (b"#%d%b" % (len(length), length) + payload, b"#9" + length.rjust(9, b"0") + payload)


def _cases(word: str) -> tuple[bytes, ...]:
    return tuple(
        text.encode() for text in (word.upper(), word.lower(), word, short_form(word), short_form(word).lower())
    )


def _arguments(kind: Kind, header: str) -> st.SearchStrategy[tuple[bytes, ...]]:
    """Equivalent spellings of one value of `kind`."""
    match kind:
        case Real():
            low, high = MODEST.get(header, (kind.minimum, kind.maximum))
            numbers = _numbers(low, high).map(_spelled_number)
            return st.one_of(numbers, st.sampled_from([*kind.words]).map(_cases)) if kind.words else numbers
        case Integer():
            low, high = MODEST.get(header, (kind.minimum, min(kind.maximum, LARGEST)))
            return st.integers(int(low), int(high)).map(
                lambda n: (str(n).encode(), f"{n}.0".encode(), f"{n}E+0".encode())
            )
        case Boolean():
            words = (*kind.true, *kind.false)
            return st.one_of(
                st.sampled_from([(b"1", b"+1", b"1.0", b"2"), (b"0", b"0.0", b"-0")]),
                st.sampled_from(words).map(lambda word: (word.encode(), word.lower().encode())),
            )
        case Keyword():
            return st.sampled_from([*dict.fromkeys((kind.forms or {"X": "X"}).values())]).map(_cases)
        case Quoted():
            quoted = _WORDS.map(lambda text: (f'"{text}"'.encode(), f"'{text.replace(chr(34) * 2, chr(34))}'".encode()))
            return st.one_of(quoted, st.sampled_from(kind.words).map(_cases)) if kind.words else quoted
        case Block():
            return st.one_of(st.binary(max_size=40), st.integers(0, 40).map(lambda n: b"\x00\x00\x80\x3f" * n)).map(
                _block
            )
        case ChannelList():
            channel = st.tuples(*[st.integers(0, 5)] * kind.dimensions).map(lambda items: "!".join(map(str, items)))
            return st.lists(channel, min_size=1, max_size=4).map(
                lambda items: (f"(@{','.join(items)})".encode(), f"( @ {' , '.join(items)} )".encode())
            )
        case _:
            return _WORDS.map(lambda text: (f'"{text}"'.encode(),))


@st.composite
def statements(draw: st.DrawFn, model: type[VirtualInstrument], commands: Sequence[Command] = ()) -> Statement:
    """A statement of the model's table, its arguments of the kinds it declares."""
    command = draw(st.sampled_from(commands or COMMON + model.COMMANDS))
    query = command.answers and (not command.acts or draw(st.booleans()))
    nodes = []
    for node in command.header.replace("[:", ":[").strip(":").split(":"):
        name = node.strip("[]").removesuffix("#")
        suffix = str(draw(st.integers(1, model.SUFFIXES.get(name, 1)))) if node.strip("[]").endswith("#") else ""
        nodes.append((name, suffix, node.startswith("[")))
    kinds: list[Kind] = list(getattr(command, "_kinds", ())) if not (query and command.acts) else []
    arguments: list[tuple[bytes, ...]] = []
    for kind in kinds:
        if not kind.required and draw(st.booleans()):
            continue
        repeats = draw(st.integers(1, 3)) if isinstance(kind, Several) else 1
        one = kind.of if isinstance(kind, Several) else kind
        arguments += [draw(_arguments(one, command.header)) for _ in range(repeats)]
    return Statement(tuple(nodes), query, tuple(arguments))


def canonical(statement: Statement) -> bytes:
    """The long form in capitals from the root, nothing left out, a message of its own."""
    header = ":".join(name.upper() + suffix for name, suffix, _ in statement.nodes)
    return _unit(
        b"" if header.startswith("*") else b":", header, statement, [spellings[0] for spellings in statement.arguments]
    )


@st.composite
def spelled(draw: st.DrawFn, chain: Sequence[Statement]) -> bytes:
    """The statements as one message: forms, cases, optional nodes, relative headers, spellings of values are drawn."""
    units, path = [], ""
    for statement in chain:
        nodes = [
            draw(st.sampled_from([name, name.upper(), name.lower(), short_form(name), short_form(name).lower()]))
            + suffix
            for name, suffix, optional in statement.nodes
            if not optional or draw(st.booleans())
        ]
        header, lead = ":".join(nodes), b""
        if not header.startswith("*"):
            relative = header.upper().startswith(path) and draw(st.booleans())
            beyond = header[len(path) :] if relative else header
            lead = b"" if relative or (not path and draw(st.booleans())) else b":"
            path, header = header.upper()[: header.rfind(":") + 1], beyond
        units.append(_unit(lead, header, statement, [draw(st.sampled_from(items)) for items in statement.arguments]))
    return draw(st.sampled_from([b";", b" ; ", b";;"])).join(units)


def _unit(lead: bytes, header: str, statement: Statement, arguments: Sequence[bytes]) -> bytes:
    return lead + header.encode() + (b"?" if statement.query else b"") + b" " + b",".join(arguments)


@st.composite
def laser_texts(draw: st.DrawFn) -> bytes:
    """A line of the laser's table with some number in it."""
    number = draw(st.one_of(st.floats(1500, 1600), st.floats(-20, 30), st.floats(), st.integers()))
    return draw(st.sampled_from(_LASER)).format(number).encode()


@st.composite
def damaged(draw: st.DrawFn, text: bytes) -> bytes:
    """The text with some bytes taken out, put in or exchanged."""
    mutable = bytearray(text)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(mutable)))
        mutable[at : at + draw(st.integers(0, 3))] = draw(st.one_of(st.binary(max_size=3), st.sampled_from(_MARKS)))
    return bytes(mutable)


_MARKS = [
    b";",
    b":",
    b",",
    b"?",
    b"#",
    b'"',
    b"'",
    b"(",
    b"(@",
    b"#0",
    b"#15",
    b"#A0000000004",
    b"*",
    b" ",
    b"\r\n",
    b"1e999",
]

garbage = st.one_of(
    st.binary(max_size=60), st.text(":;,?#*\"'()@!0123456789eE+-. \r\nabCDz", max_size=60).map(str.encode)
)


@st.composite
def conversations(draw: st.DrawFn, model: type[VirtualInstrument]) -> bytes:
    """Some messages of one client: most are meant well, some are damaged, some are garbage."""
    parts: list[bytes] = []
    for _ in range(draw(st.integers(1, 6))):
        well_meant = spelled(draw(st.lists(statements(model), min_size=1, max_size=4)))
        of_the_table = draw(st.booleans())
        text = draw(well_meant if model.COMMANDS or of_the_table else laser_texts())
        fate = draw(st.integers(0, 9))
        parts.append(draw(damaged(text)) if fate < 2 else draw(garbage) if fate == 2 else text)
    return draw(st.sampled_from([b"\n", b"\r\n", b"\n\n"])).join(parts) + b"\n"
