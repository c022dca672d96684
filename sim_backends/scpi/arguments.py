"""Arguments of SCPI commands: how each kind is read from a message and how a reply writes it.

Every kind is a small frozen object made by one of the functions at the end (`real`, `keyword`, `block`, ...), so that a
table of commands reads like the manual. Number formats: IEEE 488.2-1992, 7.7.2 and 7.7.4.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import PureWindowsPath
from typing import Any

import numpy as np

from sim_backends.scpi.messages import Argument
from sim_backends.scpi.status import ScpiError

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:\s*[eE]\s*[+-]?\d+)?")
_RADIX = re.compile(r"#([HhQqBb])([0-9A-Fa-f]+)")
_BASES = {"H": 16, "Q": 8, "B": 2}


def short_form(word: str) -> str:
    """The capitals of a mnemonic: `CONTinuous` -> `CONT`."""
    return "".join(character for character in word if not character.islower())


def nr3(value: float) -> str:
    """A real number as replies write it: `2.5000000000E+10`."""
    return f"{value:.10E}"


@dataclass(frozen=True)
class Kind(ABC):
    """One kind of argument.

    Attributes:
        required: Whether the command refuses to do without.
    """

    required: bool = True

    @abstractmethod
    def parse(self, argument: Argument) -> Any:
        """The value of `argument`; raises ScpiError."""

    def format(self, value: Any, *, verbose: bool) -> str:
        """The value as a reply writes it, with long words if `verbose`."""
        return str(value)


def text_of(argument: Argument) -> str:
    """The argument if it is text; a block where text belongs is -104."""
    if isinstance(argument, str):
        return argument
    raise ScpiError(-104, "block where none is allowed")


@dataclass(frozen=True)
class Real(Kind):
    """A real number between `minimum` and `maximum`, or one of `words`."""

    minimum: float = -np.inf
    maximum: float = np.inf
    words: Mapping[str, float] | None = None

    def parse(self, argument: Argument) -> float:
        """Read a number; -104 for other text, -222 outside the range."""
        text = text_of(argument)
        value = float("".join(text.split())) if _NUMBER.fullmatch(text) else self._word(text)
        if self.minimum <= value <= self.maximum and abs(value) != np.inf:
            return value
        raise ScpiError(-222, text)

    def _word(self, text: str) -> float:
        for word, value in (self.words or {}).items():
            if text.upper() in (word.upper(), short_form(word)):
                return value
        raise ScpiError(-104, text)

    def format(self, value: float, *, verbose: bool) -> str:
        """NR3."""
        return nr3(value)


@dataclass(frozen=True)
class Integer(Kind):
    """A whole number between `minimum` and `maximum`; other numbers are rounded, `#H1F`, `#Q17` and `#B01` are read."""

    minimum: int = 0
    maximum: int = 2**31 - 1

    def parse(self, argument: Argument) -> int:
        """Read a number; -104 for other text, -222 outside the range."""
        text = text_of(argument)
        if _NUMBER.fullmatch(text):
            real = float("".join(text.split()))
            value = round(real) if abs(real) < 1e18 else self.maximum + 1
        elif radix := _RADIX.fullmatch(text):
            value = _radix(radix[1].upper(), radix[2])
        else:
            raise ScpiError(-104, text)
        if self.minimum <= value <= self.maximum:
            return value
        raise ScpiError(-222, text)


def _radix(base: str, digits: str) -> int:
    try:
        return int(digits, _BASES[base])
    except ValueError:
        raise ScpiError(-104, f"#{base}{digits}") from None


@dataclass(frozen=True)
class Boolean(Kind):
    """ON, OFF or a number; `true` and `false` are further words of a model (RUN, STOP)."""

    true: tuple[str, ...] = ("ON",)
    false: tuple[str, ...] = ("OFF",)

    def parse(self, argument: Argument) -> bool:
        """Read the switch; -104 for anything else."""
        word = text_of(argument).upper()
        if word in ("1", *self.true):
            return True
        if word in ("0", *self.false):
            return False
        if _NUMBER.fullmatch(word):
            return abs(float("".join(word.split()))) >= 0.5
        raise ScpiError(-104, word)

    def format(self, value: bool, *, verbose: bool) -> str:
        """1 or 0."""
        return "1" if value else "0"


@dataclass(frozen=True)
class Keyword(Kind):
    """One of several words, long or short form; its value is the word as declared (`CONTinuous`)."""

    forms: Mapping[str, str] | None = None

    def parse(self, argument: Argument) -> str:
        """The declared word; -224 for any other."""
        text = text_of(argument)
        word = (self.forms or {}).get(text.upper())
        if word is None:
            raise ScpiError(-224, text)
        return word

    def format(self, value: str, *, verbose: bool) -> str:
        """The long or the short form, in capitals."""
        return value.upper() if verbose else short_form(value)


@dataclass(frozen=True)
class NumberOrWord(Kind):
    """A whole number or one of several words; its value is an int or the word as declared."""

    number: Integer = Integer()
    word: Keyword = Keyword()

    def parse(self, argument: Argument) -> int | str:
        """Read a number (-222 outside its range) or a word; -224 for any other."""
        text = text_of(argument)
        return self.number.parse(argument) if text[:1].isdigit() or text[:1] in "+-#." else self.word.parse(argument)

    def format(self, value: int | str, *, verbose: bool) -> str:
        """The number, or the word as a keyword is written."""
        return str(value) if isinstance(value, int) else self.word.format(value, verbose=verbose)


@dataclass(frozen=True)
class Quoted(Kind):
    """A string in quotes; `words` are taken without them, too (`ALL`), and with `bare` so is anything."""

    words: tuple[str, ...] = ()
    bare: bool = False

    def parse(self, argument: Argument) -> str:
        """The text between the quotes, or the bare word in capitals; -104 for anything else."""
        text = text_of(argument)
        if len(text) >= 2 and text[0] in "\"'" and text[-1] == text[0]:
            return text[1:-1].replace(2 * text[0], text[0])
        if text.upper() in self.words:
            return text.upper()
        if self.bare and text:
            return text
        raise ScpiError(-104, text)

    def format(self, value: str, *, verbose: bool) -> str:
        """The text in double quotes."""
        doubled = value.replace('"', '""')
        return f'"{doubled}"'


@dataclass(frozen=True)
class FileOr(Kind):
    """A file's path in quotes, or what `other` reads; the value of a file is a path."""

    other: Kind = Integer()

    def parse(self, argument: Argument) -> Any:
        """The path between the quotes, or the other kind's value."""
        if text_of(argument)[:1] in ("'", '"'):
            return PureWindowsPath(quoted.parse(argument))
        return self.other.parse(argument)


@dataclass(frozen=True)
class Block(Kind):
    """A block of numbers; its value is a read-only view of the received bytes."""

    dtype: str = "u1"

    def parse(self, argument: Argument) -> np.ndarray[Any, Any]:
        """The numbers; -161 when the bytes are not a whole number of them."""
        if isinstance(argument, str):
            raise ScpiError(-160, argument[:20])
        try:
            return np.frombuffer(argument, self.dtype)
        except ValueError:
            raise ScpiError(-161, f"{argument.nbytes} bytes are no whole number of {self.dtype}") from None


@dataclass(frozen=True)
class ChannelList(Kind):
    """`(@1!2,3!4)`: a list of channels, each a tuple of `dimensions` numbers.  SCPI-99, volume 1, 8.3.2."""

    dimensions: int = 1

    def parse(self, argument: Argument) -> tuple[tuple[int, ...], ...]:
        """The channels; -104 for anything else."""
        text = "".join(text_of(argument).split())
        number = r"\d{1,9}" + r"!\d{1,9}" * (self.dimensions - 1)
        if not re.fullmatch(rf"\(@{number}(?:,{number})*\)", text):
            raise ScpiError(-104, text)
        return tuple(tuple(map(int, channel.split("!"))) for channel in text[2:-1].split(","))

    def format(self, value: tuple[tuple[int, ...], ...], *, verbose: bool) -> str:
        """The list as it is sent."""
        return "(@" + ",".join("!".join(map(str, channel)) for channel in value) + ")"


@dataclass(frozen=True)
class Several(Kind):
    """One or more arguments of the same kind, taken to the end of the unit; the value is a tuple."""

    of: Kind = Boolean()

    def parse(self, argument: Argument) -> tuple[Any, ...]:
        """A tuple of this one argument (the table joins the rest)."""
        return (self.of.parse(argument),)

    def format(self, value: tuple[Any, ...], *, verbose: bool) -> str:
        """The values, separated by commas."""
        return ",".join(self.of.format(item, verbose=verbose) for item in value)


def real(minimum: float = -np.inf, maximum: float = np.inf, **words: float) -> Real:
    """A real number within limits; `words` name further values (`FULl=25e9`)."""
    return Real(minimum=minimum, maximum=maximum, words=words)


def integer(minimum: int = 0, maximum: int = 2**31 - 1) -> Integer:
    """A whole number within limits."""
    return Integer(minimum=minimum, maximum=maximum)


def keyword(*words: str) -> Keyword:
    """One of `words`, their capitals being the short forms."""
    forms = {word.upper(): word for word in words} | {short_form(word): word for word in words}
    return Keyword(forms=forms)


def number_or_word(minimum: int, maximum: int, *words: str) -> NumberOrWord:
    """A whole number within limits, or one of `words`."""
    return NumberOrWord(number=integer(minimum, maximum), word=keyword(*words))


def file_or(kind: Kind) -> FileOr:
    """A file's path in quotes, or what `kind` reads."""
    return FileOr(other=kind)


def block(dtype: str) -> Block:
    """A block of numbers of a numpy type."""
    return Block(dtype=dtype)


def channels(dimensions: int = 1) -> ChannelList:
    """A channel list whose items have `dimensions` numbers."""
    return ChannelList(dimensions=dimensions)


def several(kind: Kind) -> Several:
    """One or more of `kind`."""
    return Several(of=kind)


def optional(kind: Kind) -> Kind:
    """The same kind, which may be left out."""
    return replace(kind, required=False)


boolean = Boolean()
run_or_stop = Boolean(true=("ON", "RUN"), false=("OFF", "STOP"))
quoted = Quoted()
quoted_or_all = Quoted(words=("ALL",))
quoted_or_bare = Quoted(bare=True)
