"""Quantities at the edges: text with a unit, parsed once into SI (or into the unit that a name carries)."""

import math
import re
from contextlib import suppress
from functools import cache
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainSerializer, SerializationInfo, ValidationInfo

_TEXT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-zµ\u03bc/]*)\s*")
DIGITS = ".12g"
"""As many as a quantity keeps: what lies just beyond a bound, or is another step of a scan, reads otherwise."""

# What the trade writes and pint does not know: samples per second are a rate, peak-to-peak volts are volts.
_TRADE_UNITS = {
    "Hz": (re.compile(r"([kMG]?)(?:S/s|Sa/s)"), r"\1Hz"),
    "V": (re.compile(r"(m?V)pp"), r"\1"),
}

# A power of ten for each prefix, and each kind of quantity by itself: pint's own list takes long to read.
_DEFINITIONS = """
femto- = 1e-15 = f-
pico- = 1e-12 = p-
nano- = 1e-9 = n-
micro- = 1e-6 = µ- = \N{GREEK SMALL LETTER MU}- = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
mega- = 1e6 = M-
giga- = 1e9 = G-
tera- = 1e12 = T-
metre = [length] = m = meter
angstrom = 1e-10 metre
inch = 0.0254 metre = in
second = [time] = s = sec
minute = 60 second = min
hour = 60 minute = h = hr
day = 24 hour = d
hertz = [rate] = Hz
volt = [potential] = V
watt = [power] = W
decibelmilliwatt = 1e-3 watt; logbase: 10; logfactor: 10 = dBm
"""

# How each unit is usually written, for editors: more than these is understood, and another kind of unit never meant.
_PREFIX = "[fpnuµmkMGT]?"
_USUAL = {
    "s": f"({_PREFIX}s|min|h|days?)",
    "Hz": f"{_PREFIX}(Hz|S/s|Sa/s)",
    "V": f"{_PREFIX}(V|Vpp)",
    "W": f"({_PREFIX}W|dBm)",
    "nm": f"{_PREFIX}m",
}


@cache
def _registry() -> Any:
    import pint  # takes longer to load than most commands; only text with a unit needs it

    return pint.UnitRegistry(_DEFINITIONS.strip().splitlines(), autoconvert_offset_to_baseunit=True)


def quantity(text: str, unit: str) -> float:
    """The number `text` ("0.4 ns", "25 GS/s", "14.8 dBm") stands for, in `unit`.

    Raises:
        ValueError: not a number or not a finite one, no unit, or a unit of another kind.

    Example:
        >>> from instruments.units import quantity
        >>> quantity("0.4 ns", "s"), quantity("25 GS/s", "Hz"), quantity("14.8 dBm", "W")
        (4e-10, 25000000000.0, 0.030199517204)
    """
    match = _TEXT.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is not a number with a unit: write it like '1 {unit}'")
    number, written = match.groups()
    if not written:
        raise ValueError(f"{text!r} has no unit: write it like '{text.strip()} {unit}'")
    if unit in _TRADE_UNITS:
        pattern, meaning = _TRADE_UNITS[unit]
        written = re.sub(rf"^{pattern.pattern}$", meaning, written)
    import numpy as np
    import pint

    try:
        with np.errstate(over="ignore"):  # infinity is looked for below
            converted = _registry().Quantity(float(number), written).to(unit).magnitude
    except (pint.PintError, AssertionError):  # its parser asserts what it expects, such as something after a slash
        raise ValueError(f"{text!r} is not in {unit}: write it like '1 {unit}'") from None
    if not math.isfinite(converted):
        raise ValueError(f"{text!r} is more than a number holds: write it like '1 {unit}'")
    return float(f"{converted:{DIGITS}}")


def value_in(value: float | str, unit: str) -> float:
    """A number as it is, and text by `quantity`: in Python both are said.

    Raises:
        ValueError: the text is not in `unit`.

    Example:
        >>> from instruments.units import value_in
        >>> value_in(4e-10, "s"), value_in("0.4 ns", "s")
        (4e-10, 4e-10)
    """
    return quantity(value, unit) if isinstance(value, str) else float(value)


def any_quantity(text: str) -> tuple[float, str] | None:
    """The number that `text` stands for and the unit that it is in, whichever `quantity` knows; None of other text."""
    for unit in _USUAL:
        with suppress(ValueError):
            return quantity(text, unit), unit
    return None


def watts(dbm: float) -> float:
    """The power of so many decibels above 1 mW; infinity where that is more than a number holds: above every limit."""
    try:
        return float(1e-3 * 10 ** (dbm / 10))
    except OverflowError:
        return math.inf


def decibels_milliwatt(power_w: float) -> float:
    """A power (W) in decibels above 1 mW; minus infinity of none."""
    return 10 * math.log10(power_w / 1e-3) if power_w > 0 else -math.inf


WITH_UNITS = "with units"
"""True in the context of a file that people write: quantities then are text with a unit, read and written."""


def _in(unit: str) -> BeforeValidator:
    def parse(value: object, info: ValidationInfo) -> object:
        if isinstance(value, str):
            return quantity(value, unit)
        if isinstance(value, int | float) and (info.context or {}).get(WITH_UNITS):
            raise ValueError(f"has no unit: write it like '{value:g} {unit}'")
        return value

    text = Field(
        pattern=rf"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*{_USUAL[unit]}\s*$", json_schema_extra={"unit": unit}
    )
    return BeforeValidator(parse, json_schema_input_type=Annotated[str, text] | float)


def _as(unit: str) -> PlainSerializer:
    def write(value: float, info: SerializationInfo) -> float | str:
        return f"{value!r} {unit}" if (info.context or {}).get(WITH_UNITS) else value

    return PlainSerializer(write, return_type=float | str)


Seconds = Annotated[float, _in("s"), _as("s")]
Hertz = Annotated[float, _in("Hz"), _as("Hz")]
Volts = Annotated[float, _in("V"), _as("V")]
Watts = Annotated[float, _in("W"), _as("W")]
Nanometres = Annotated[float, _in("nm"), _as("nm")]
