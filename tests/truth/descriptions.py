"""The manufacturer's command descriptions of a family of instruments, as the package tm_devices carries them.

Each command of the package is a class whose text was generated from the programming manual: the syntax of the command
and of the query, what every argument means, and now and then a default or a range. This module takes the texts apart.
"""

import importlib
import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from typing import Any

_COMMANDS = "tm_devices.commands"

_SYNTAX = re.compile(r"SCPI Syntax:\n\s*```\n(.*?)```", re.S)
_FORM = re.compile(r"(\*?[A-Za-z][\w<>\[\]:]*)(\?)?(?:\s+(\S.*))?")
_SUFFIX = re.compile(r"<\w>|\[\w\]")
_WORD = re.compile(r"[A-Za-z]\w*(?:<\w>)?")
_NUMBER = r"[-+]?\d[\d,]*\.?\d*(?:[eE][-+]?\d+)?"
_UNIT = r"(?:[pnum]s|s|mV|V|dB|[kMG]?Hz|%|GS/s)(?!\w)"
_VALUE = rf"{_NUMBER}(?: ?{_UNIT})?"
_SCALE = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9}
_QUANTITY = re.compile(rf"({_NUMBER}) ?({_UNIT})?")
_RANGE = re.compile(rf"(?:rang(?:es|ing|e)|value is)[\w ]*?({_VALUE}) (?:to|through|and) ({_VALUE})", re.I)
_ITEM_IS_DEFAULT = re.compile(r"this is the default|is the default|the default (?:setting|value|mode)", re.I)
_DEFAULTS = (
    re.compile(rf"``\*RST`` sets this to ({_VALUE}|\w+)"),
    re.compile(r"(?:^|[.] )([A-Z]+[a-z]*) is the default"),
    re.compile(rf"the default (?:\w+ ){{0,4}}is ({_VALUE}|\w+)", re.I),
)

FAMILIES = {"scope": "DPO70KDX", "awg": "AWG70KA"}
"""The family of each role's instrument, as tm_devices names it."""


@dataclass(frozen=True)
class Form:
    """One way to send a header: `arguments` as the syntax writes them, "" for none."""

    arguments: str

    @property
    def _alternatives(self) -> list[str]:
        listed = re.match(r"\{([^{}]*)\}", self.arguments)
        return [part.strip() for part in (listed[1] if listed else self.arguments).split("|")]

    @property
    def words(self) -> tuple[str, ...]:
        """The words that the first argument may be, `CH1` for `CH<x>`; capitals are the short form."""
        return tuple(_SUFFIX.sub("1", part) for part in self._alternatives if _WORD.fullmatch(part))

    @property
    def closed(self) -> bool:
        """Whether nothing but its words can stand there: no number, string or name."""
        alone = re.fullmatch(r"\{[^{}]*\}|\w+", self.arguments) is not None
        return alone and all(_WORD.fullmatch(part) for part in self._alternatives)

    @property
    def numeric(self) -> bool:
        """Whether a number alone is meant."""
        return re.fullmatch(r"\{?<NR[f123]>\}?", self.arguments, re.I) is not None


@dataclass(frozen=True)
class Described:
    """One header of the family.

    Attributes:
        name: As the manual writes it, `#` for a numeric suffix: `CH#:SCAle`.
        command: How it is sent; None: there is no such form.
        query: How it is asked; None: there is no such form.
        default: What `*RST` sets, as the text says: a word, or a number in SI units; None: it does not say.
        limits: Lowest and highest number in SI units, as the text says; None: it does not say.
    """

    name: str
    command: Form | None
    query: Form | None
    default: str | float | None
    limits: tuple[float, float] | None


def version() -> str:
    """The release of tm_devices that was read."""
    return metadata.version("tm_devices")


def described(family: str) -> dict[str, Described]:
    """Every header of `family` by its name."""
    module = importlib.import_module(f"{_COMMANDS}.{family.lower()}_commands")
    found: dict[str, Described] = {}
    for text in dict.fromkeys(_texts(getattr(module, f"{family}Commands")(None), set())):
        forms: dict[str, dict[bool, Form]] = {}
        for line in _lines(text):
            if parts := _FORM.fullmatch(line):
                name = _SUFFIX.sub("#", parts[1])
                forms.setdefault(name, {})[bool(parts[2])] = Form(parts[3] or "")
        for name, known in forms.items():
            command = known.get(False)
            default = _default(text, command.words if command else ())
            found[name] = Described(name, command, known.get(True), default, _limits(text))
    return dict(sorted(found.items(), key=lambda item: item[0].upper().split(":")))


def _texts(node: Any, seen: set[int]) -> Iterator[str]:
    if id(node) in seen or not hasattr(node, "__dict__"):
        return
    seen.add(id(node))
    if "SCPI Syntax" in (type(node).__doc__ or ""):
        yield inspect.getdoc(type(node)) or ""
    for child in vars(node).values():
        if isinstance(child, dict):
            yield from _texts(child[1], seen)
        elif type(child).__module__.startswith(_COMMANDS):
            yield from _texts(child, seen)


def _lines(text: str) -> list[str]:
    syntax = _SYNTAX.search(text)
    items = re.split(r"^\s*- ", syntax[1], flags=re.M) if syntax else []
    return [" ".join(item.split()) for item in items if item.strip()]


def _default(text: str, words: tuple[str, ...]) -> str | float | None:
    before, _, behind = text.partition("SCPI Syntax:")
    items = _items(behind)
    for item in items:
        if (named := re.match(r"``(\w+)``", item)) and _ITEM_IS_DEFAULT.search(item):
            return named[1]
    for part in (*items, " ".join(before.partition("Usage:")[0].split())):
        for pattern in _DEFAULTS:
            if said := pattern.search(part):
                if quantity := _QUANTITY.fullmatch(said[1]):
                    return _si(quantity)
                if said[1].upper() in {form for word in words for form in (word.upper(), short_form(word))}:
                    return said[1]
    return None


def _limits(text: str) -> tuple[float, float] | None:
    for item in _items(text):
        if item.startswith("``<N") and (said := _RANGE.search(item)):
            first, last = _QUANTITY.fullmatch(said[1]), _QUANTITY.fullmatch(said[2])
            if first and last:
                return min(_si(first), _si(last)), max(_si(first), _si(last))
    return None


def _items(text: str) -> list[str]:
    """The items of the text's list of arguments."""
    info = text.partition("Info:")[2].partition("Properties:")[0]
    return [" ".join(item.split()) for item in re.split(r"^\s*- ", info, flags=re.M)]


def _si(quantity: re.Match[str]) -> float:
    unit = quantity[2] or ""
    scale = _SCALE[unit[0]] if len(unit) > 1 and unit != "dB" and unit[0] in _SCALE else 1.0
    return float(quantity[1].replace(",", "")) * scale


def short_form(word: str) -> str:
    """The capitals, digits and marks of a word: `CONTinuous` -> `CONT`."""
    return "".join(character for character in word if not character.islower())
