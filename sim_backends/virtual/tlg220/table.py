"""The words of a laser, read from a table: which text is which command, and what a reply looks like.

A table says what a driver writes and which regular expression it reads; the simulated laser uses both the other way
round. So a table that was corrected at the bench can be rehearsed before it meets the hardware.
"""

import math
import re
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from sim_backends.scpi.status import ScpiError


def default_table() -> dict[str, Any]:
    """The table of the simulated laser."""
    return tomllib.loads(files("sim_backends.virtual.tlg220").joinpath("commands.toml").read_text(encoding="utf-8"))


UNKNOWN = "<unknown>"
NAMES = tuple(default_table()["commands"])
SPEED_OF_LIGHT = 299_792_458.0

_PLACE = re.compile(r"\{value[^}]*\}")
_NUMBER = r"(?P<value>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_GROUP = re.compile(r"\(\?P<(\w+)>(?:[^()\\\[]|\\.|\[[^\]]*\])*\)")
_SPECIAL = re.compile(r"(?<!\\)(?:\\\\)*[.*+?\[\](){}|^$]|\\[\w]")

_METRES = {"m": 1e9, "nm": 1.0, "pm": 1e-3}  # to nm
_HERTZ = {"Hz": 1.0, "GHz": 1e9, "THz": 1e12}
_WATTS = {"W": 1.0, "mW": 1e-3}


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


class Phrase:
    """One entry of a table: what is written, and what is replied.

    Attributes:
        name: `set_wavelength`, ...
        unit: of the value, if it has one.
        poll_s: seconds a client lets pass between two askings.
    """

    def __init__(self, name: str, entry: Mapping[str, Any]) -> None:
        self.name = name
        self.unit = str(entry.get("unit", ""))
        self.poll_s = float(entry.get("poll_s", 0.0))
        self._minimum = float(entry.get("min", -math.inf))
        self._maximum = float(entry.get("max", math.inf))
        self._step = float(entry.get("step", 0.0))
        self._reply = entry.get("reply")
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

    @property
    def answers(self) -> bool:
        """Whether the table expects a reply."""
        return self._reply is not None


def phrases(table: Mapping[str, Any]) -> list[Phrase]:
    """The phrases of a table; entries that are still `<unknown>` are left out.

    Raises:
        ValueError: an entry cannot be simulated.
    """
    known = {name: entry for name, entry in table["commands"].items() if entry["write"] != UNKNOWN}
    return [Phrase(name, entry) for name, entry in known.items()]
