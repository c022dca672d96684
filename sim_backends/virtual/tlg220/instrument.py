"""The virtual tunable laser: it speaks the words of a table and is dark while it tunes.

Source: instrument facts 3. No public command set exists, so the table is data (`commands.toml` by default). A table
says what a driver writes and which regular expression it reads; the virtual laser uses both the other way round. So a
table that was corrected at the bench can be rehearsed before it meets the hardware.
"""

import math
import re
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from sim_backends.parameters import SPEED_OF_LIGHT
from sim_backends.scpi.messages import Chunk, Message, Unit
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.instrument import Execution, VirtualInstrument
from sim_backends.world.signals import Emission
from sim_backends.world.world import World

FIRST_WAVELENGTH_NM = 1550.0
FIRST_POWER_W = 10e-3
ROUNDING_S = 1e-9  # ten polls of 0.1 s are a second
POLL_S = 0.1
"""Virtual time from one question whether it is settled to the next, where the table lets none pass."""


def default_table() -> dict[str, Any]:
    """The table of the simulated laser."""
    return tomllib.loads(files("sim_backends.virtual.tlg220").joinpath("commands.toml").read_text(encoding="utf-8"))


UNKNOWN = "<unknown>"
NAMES = tuple(default_table()["commands"])

_PLACE = re.compile(r"\{value[^}]*\}")
_NUMBER = r"(?P<value>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_GROUP = re.compile(r"\(\?P<(\w+)>(?:[^()\\\[]|\\.|\[[^\]]*\])*\)")
_SPECIAL = re.compile(r"(?<!\\)(?:\\\\)*[.*+?\[\](){}|^$]|\\[\w]")

_METRES = {"m": 1e9, "nm": 1.0, "pm": 1e-3}  # to nm
_HERTZ = {"Hz": 1.0, "GHz": 1e9, "THz": 1e12}
_WATTS = {"W": 1.0, "mW": 1e-3}


class Phrase:
    """One entry of a table: what is written, and what is replied.

    Attributes:
        name: `set_wavelength`, ...
        unit: of the value, if it has one.
        poll_s: seconds a client lets pass between two queries.
        answers: whether the table expects a reply.
    """

    def __init__(self, name: str, entry: Mapping[str, Any]) -> None:
        self.name = name
        self.unit = str(entry.get("unit", ""))
        self.poll_s = float(entry.get("poll_s", 0.0))
        self._minimum = float(entry.get("min", -math.inf))
        self._maximum = float(entry.get("max", math.inf))
        self._step = float(entry.get("step", 0.0))
        self._reply = entry.get("reply")
        self.answers = self._reply is not None
        if name not in NAMES:
            raise ValueError(f"laser table: there is no command {name}: use {', '.join(NAMES)}")
        literals = [re.escape(text).replace(r"\ ", r"\s+") for text in _PLACE.split(str(entry["write"]).strip())]
        if len(literals) > 2:
            raise ValueError(f"laser table, {name}: write holds more than one {{value}}: give it one")
        self._pattern = re.compile(_NUMBER.join(literals), re.IGNORECASE)
        known = (*_METRES, *_HERTZ) if "wavelength" in name else ("dBm", *_WATTS) if "power" in name else (self.unit,)
        if self.unit not in known:
            raise ValueError(f"laser table, {name}: unit {self.unit!r} is not known: use one of {', '.join(known)}")
        if self._reply is not None and _SPECIAL.search(_GROUP.sub("", self._reply)):
            raise ValueError(f"laser table, {name}: reply must be plain text around its named groups to be simulated")

    def value(self, text: str) -> float | None:
        """The number in `text` if it is this phrase (NaN where the phrase has none); None if it is not.

        Raises ScpiError -222 for a number outside the table's limits; others are rounded to its step.
        """
        match = self._pattern.fullmatch(text)
        if match is None:
            return None
        if "value" not in match.groupdict():
            return math.nan
        value = float(match["value"])
        if not self._minimum <= value <= self._maximum:
            raise ScpiError(-222, f"{text}: {self._minimum:g} to {self._maximum:g} {self.unit}")
        return round(round(value / self._step) * self._step, 9) if self._step else value

    def reply(self, **groups: object) -> bytes:
        """What is replied when the named groups hold these values."""
        pieces = _GROUP.split(str(self._reply))  # literal, group, literal, group, ...
        pieces[1::2] = [str(groups.get(name, "")) for name in pieces[1::2]]
        pieces[::2] = [re.sub(r"\\(.)", r"\1", literal) for literal in pieces[::2]]
        return "".join(pieces).encode()


def phrases(table: Mapping[str, Any]) -> list[Phrase]:
    """The phrases of a table; entries that are still `<unknown>` are left out.

    Raises:
        ValueError: an entry cannot be simulated.
    """
    known = {name: entry for name, entry in table["commands"].items() if entry["write"] != UNKNOWN}
    return [Phrase(name, entry) for name, entry in known.items()]


class VirtualTlg220(VirtualInstrument):
    """What a client of the laser can see: the table's commands and the common ones of IEEE 488.2.

    Args:
        world: takes the light.
        table: a laser table; its own by default.

    Raises:
        ValueError: an entry of the table cannot be simulated.
    """

    IDENTITY = "Alnair Labs,TLG-220 (simulated),SIM0001,1.0"

    def __init__(self, world: World, table: Mapping[str, Any] | None = None) -> None:
        super().__init__(world)
        self._phrases = phrases(default_table() if table is None else table)
        self._settled_s = 0.0
        self.reset()

    def reset(self) -> None:
        """`*RST`: emission off, first wavelength and power."""
        self._output = False
        self._power_w = FIRST_POWER_W
        self._wavelength_nm = FIRST_WAVELENGTH_NM
        self._emit()

    def run(self, message: Message) -> Execution:
        """Execute what the table knows; the rest are common commands or errors."""
        texts = [_text(unit) for unit in message.units]
        if len(texts) > 1 and (reply := self._carried_out(";".join(texts))) is not None:
            return reply
        whole: list[Chunk] = []
        for unit, text in zip(message.units, texts, strict=True):
            reply = self._carried_out(text)
            if reply is None:
                reply = yield from super().run(Message((unit,)))
            if reply:
                whole += [b";", *reply] if whole else reply
        return whole

    def pending(self) -> bool:
        """Tuning is waited for in virtual time."""
        self.world.clock.advance(max(0.0, self._settled_s - self.world.clock.now))
        return False

    def _carried_out(self, text: str) -> list[Chunk] | None:
        """Carry out the phrase that `text` is; its reply, or None if the table does not know it."""
        try:
            for phrase in self._phrases:
                value = phrase.value(text)
                if value is not None:
                    groups = getattr(self, f"_{phrase.name}")(phrase, value)
                    return [phrase.reply(**groups)] if phrase.answers else []
        except ScpiError as error:
            self.status.report(error)
            return []
        return None

    def _emit(self) -> None:
        light = Emission(self._wavelength_nm, self._power_w) if self._output else None
        self.world.emit(light, lit_from_s=self._settled_s)

    # --- the entries of a table: each gets its phrase and the number sent, and returns the groups of the reply

    def _identify(self, _phrase: Phrase, _value: float) -> dict[str, object]:
        return {"text": self.IDENTITY}

    def _set_wavelength(self, phrase: Phrase, value: float) -> dict[str, object]:
        wanted = wavelength_nm(value, phrase.unit)
        if wanted != self._wavelength_nm:
            self._wavelength_nm = wanted
            self._settled_s = self.world.clock.now + self.world.parameters.laser_tuning_s
            self._emit()
        return {}

    def _get_wavelength(self, phrase: Phrase, _value: float) -> dict[str, object]:
        return {"value": f"{wavelength_in(phrase.unit, self._wavelength_nm):.10g}"}

    def _set_power(self, phrase: Phrase, value: float) -> dict[str, object]:
        self._power_w = power_w(value, phrase.unit)
        self._emit()
        return {}

    def _get_power(self, phrase: Phrase, _value: float) -> dict[str, object]:
        return {"value": f"{power_in(phrase.unit, self._power_w):.6g}"}

    def _output_on(self, _phrase: Phrase, _value: float) -> dict[str, object]:
        self._output = True
        self._emit()
        return {}

    def _output_off(self, _phrase: Phrase, _value: float) -> dict[str, object]:
        self._output = False
        self._emit()
        return {}

    def _get_output(self, _phrase: Phrase, _value: float) -> dict[str, object]:
        return {"value": int(self._output)}

    def _is_settled(self, phrase: Phrase, _value: float) -> dict[str, object]:
        self.world.clock.advance(phrase.poll_s or POLL_S)  # the client lets this pass between two queries
        return {"value": int(self.world.clock.now >= self._settled_s - ROUNDING_S)}

    def _error(self, _phrase: Phrase, _value: float) -> dict[str, object]:
        code, text = self.status.next_error()
        return {"code": code, "text": text}


def _text(unit: Unit) -> str:
    """A unit as it was sent, but for white space; blocks have no text."""
    arguments = ",".join(argument if isinstance(argument, str) else "" for argument in unit.arguments)
    return f"{unit.header}{'?' if unit.query else ''} {arguments}".rstrip()


def wavelength_nm(value: float, unit: str) -> float:
    """A wavelength or optical frequency as wavelength (nm)."""
    if unit in _HERTZ:
        return 1e9 * SPEED_OF_LIGHT / (value * _HERTZ[unit])
    return value * _METRES[unit]


def wavelength_in(unit: str, nm: float) -> float:
    """A wavelength (nm) in the unit of a table."""
    if unit in _HERTZ:
        return 1e9 * SPEED_OF_LIGHT / nm / _HERTZ[unit]
    return nm / _METRES[unit]


def power_w(value: float, unit: str) -> float:
    """A power as watts."""
    return 1e-3 * 10 ** (value / 10) if unit == "dBm" else value * _WATTS[unit]


def power_in(unit: str, watts: float) -> float:
    """A power (W) in the unit of a table."""
    return 10 * math.log10(watts * 1e3) if unit == "dBm" else watts / _WATTS[unit]
