"""What the twins make of every header of their families, asked over the wire, against the descriptions."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from tests.checkout import ROOT
from tests.truth.descriptions import FAMILIES, Described, Form, described, short_form
from tests.truth.wire import Answer, Instrument

EVENTS = {"scope": "ALLEv?", "awg": "SYSTem:ERRor:ALL?"}
MODELS = {"scope": "VirtualDpo72504dx", "awg": "VirtualAwg70002a"}
PRESET = {"scope": "*RST;*CLS;HEADer OFF;VERBose ON", "awg": "*RST;*CLS"}
NONSENSE = "NONSENSE"
TOO_MUCH = ",".join((NONSENSE, *"123456789"))
"""Arguments that no command takes: they tell whether the header is known, and do nothing."""

_DOCUMENT = ROOT / "docs" / "reference" / "virtual-instruments.md"
_ROW = re.compile(r"\| `([^`]+)` \| ([a-z ]+) \|")
_NUMBER = re.compile(r"[+-]?\d+\.?\d*(?:E[+-]?\d+)?", re.I)


@dataclass(frozen=True, order=True)
class Difference:
    """One way in which a twin differs from the description of a header."""

    role: str
    header: str
    what: str

    def __str__(self) -> str:
        return f"{self.role} {self.header}: {self.what}"


@dataclass
class Comparison:
    """What came of one role: headers by state, and differences."""

    role: str
    simulated: list[str] = field(default_factory=list)
    not_simulated: list[str] = field(default_factory=list)
    checks: int = 0
    differences: list[Difference] = field(default_factory=list)

    @property
    def compared(self) -> int:
        """Headers of the family."""
        return len(self.simulated) + len(self.not_simulated)


def compare(role: str, address: str) -> Comparison:
    """Hold the twin at `address` against its family."""
    found = Comparison(role)
    headers = described(FAMILIES[role])
    with Instrument(address, EVENTS[role]) as instrument:
        for header in headers.values():
            asked = _Asked(instrument, PRESET[role], header)
            differences = list(asked.forms())
            if asked.simulated:
                found.simulated.append(header.name)
                differences += [*asked.default(), *asked.words(), *asked.numbers()]
            else:
                found.not_simulated.append(header.name)
            found.checks += asked.checks
            found.differences += [Difference(role, header.name, what) for what in differences]
    found.differences += [Difference(role, name, "is no header of the family") for name in _strange(role, headers)]
    return found


class _Asked:
    """One header, asked and told; every method gives the differences it finds."""

    def __init__(self, instrument: Instrument, preset: str, header: Described) -> None:
        self._instrument, self._preset, self._header = instrument, preset, header
        self._sent = header.name.replace("#", "1")
        self.simulated, self.checks = False, 0
        self._settable = self._tells = False

    def forms(self) -> Iterator[str]:
        """Whether command and query are known, or told apart from nonsense."""
        lacking = 0
        for name, form, mark in (("command", self._header.command, ""), ("query", self._header.query, "?")):
            if form is None:
                continue
            answer = self._send(f"{self._sent}{mark} {TOO_MUCH}")
            if answer.undefined and not answer.told_apart:
                yield f"{name} answered like nonsense"
            elif answer.undefined:
                lacking += 1
            elif mark:
                self._tells = not form.arguments
            else:
                self._settable = True
        self.simulated = lacking < sum(form is not None for form in (self._header.command, self._header.query))

    def default(self) -> Iterator[str]:
        """What `*RST` sets."""
        default = self._header.default
        if default is None or not self._tells:
            return
        value = self._value()
        if isinstance(default, float):
            same = _NUMBER.fullmatch(value) is not None and abs(float(value) - default) <= 1e-6 * abs(default)
        else:
            same = _means(value, default) or _switch(value) == _switch(default) != ""
        if not same:
            yield f"*RST sets {value}, described {default}"

    def words(self) -> Iterator[str]:
        """Whether every word is taken in both forms and told back, and nothing else is taken."""
        form = self._header.command
        if form is None or not self._settable or not _alone(form):
            return
        for word in form.words:
            short = word.upper() if word[1:].islower() else short_form(word)
            for spelling in dict.fromkeys((word.upper(), short)):
                self._send(self._preset)
                if self._send(f"{self._sent} {spelling}").refused:
                    yield f"refuses {spelling}"
                elif self._tells and _switch(word) == "":
                    told = self._value()
                    if told.isalpha() and not _means(told, word):
                        yield f"tells {told} after {spelling}"
        if form.closed or form.numeric:
            self._send(self._preset)
            if not self._send(f"{self._sent} {NONSENSE}").refused:
                yield f"takes {NONSENSE}"

    def numbers(self) -> Iterator[str]:
        """Whether the range that is described is taken, and nothing beyond it is kept."""
        form = self._header.command
        if self._header.limits is None or form is None or not (self._settable and self._tells and form.numeric):
            return
        low, high = self._header.limits
        for number in (low, high):
            self._send(self._preset)
            if self._send(f"{self._sent} {number:g}").refused:
                yield f"refuses {number:g}"
        beyond = 2 * high + 1 if high < 1 else high + max(1.0, high * 0.01)
        self._send(self._preset)
        if not self._send(f"{self._sent} {beyond:g}").refused and float(self._value()) > high:
            yield f"keeps {beyond:g}, described up to {high:g}"

    def _send(self, text: str) -> Answer:
        self.checks += text != self._preset
        return self._instrument.send(text)

    def _value(self) -> str:
        return self._send(f"{self._sent}?").reply


def _alone(form: Form) -> bool:
    """Whether the words are all that the command takes."""
    return re.fullmatch(r"\{[^{}]*\}|\w+", form.arguments) is not None or form.numeric


def _switch(word: str) -> str:
    return {"ON": "1", "1": "1", "OFF": "0", "0": "0"}.get(word.upper(), "")


def _means(told: str, word: str) -> bool:
    """Whether `told` is the word, long or short; a word without capitals inside has any beginning as its short form."""
    loose = word[1:].islower() and word.upper().startswith(told.upper())
    return told.upper() in (word.upper(), short_form(word)) or loose


def _strange(role: str, headers: dict[str, Described]) -> list[str]:
    """Headers of the twin, by its document, that the family has not."""
    known = {spelling for name in headers for spelling in _spellings(name)}
    section = _DOCUMENT.read_text(encoding="utf-8").partition(f"## {MODELS[role]}\n")[2].partition("\n## ")[0]
    found = (match[1] for match in _ROW.finditer(section))
    return [re.sub(r"[\[\]]", "", name) for name in found if not known.intersection(_spellings(name))]


def _spellings(header: str) -> list[str]:
    """A header with and without the nodes that may be left out, without numbers and `:LEVel:IMMediate`."""
    spellings = [""]
    for part in re.findall(r"\[[^\]]*\]|[^\[]+", header):
        longer = [spelling + part.strip("[]") for spelling in spellings]
        spellings = longer + (spellings if part[0] == "[" else [])
    bare = (re.sub(r"#|(?<=[A-Za-z])\d+(?=:|$)", "", spelling).upper() for spelling in spellings)
    return [spelling.replace(":LEVEL", "").replace(":IMMEDIATE", "") for spelling in bare]
