"""Settings that protocols share, as text from the command line or a file gives them; and the passes they ask for."""

from itertools import product
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, PositiveInt

from instruments.bench import Bench
from instruments.ports import Ports as Ports
from instruments.ports import require_distinct
from instruments.units import Nanometres
from protocols.base import Pass, ProtocolError


def parse_list(value: object) -> object:
    """Turn "1550 nm, 1551 nm" or "0,1,2" into a list of its parts; anything else is left to pydantic."""
    return [part.strip() for part in value.split(",")] if isinstance(value, str) else value


Wavelength = Annotated[Nanometres, Field(ge=100, le=10_000)]
"""In nm: far beyond what any laser of such a bench gives; its own range is compared when the bench is known."""
EVERY_IMAGE: Literal["all"] = "all"
_Counts = Annotated[str, Field(pattern=r"^\s*\d+\s*(,\s*\d+\s*)*$")]
Wavelengths = Annotated[
    tuple[Wavelength, ...],
    BeforeValidator(parse_list, json_schema_input_type=str | tuple[Wavelength, ...]),
    Field(min_length=1),
    AfterValidator(require_distinct),
]
Classes = Annotated[
    tuple[int, ...],
    BeforeValidator(parse_list, json_schema_input_type=_Counts | tuple[int, ...]),
    Field(min_length=1),
    AfterValidator(require_distinct),
]
Pair = Annotated[tuple[int, int], BeforeValidator(parse_list, json_schema_input_type=_Counts | tuple[int, int])]
"""Two classes."""
Binarisation = Annotated[
    str,
    BeforeValidator(lambda value: str(value) if isinstance(value, int) else value, json_schema_input_type=str | int),
]


def parse_counts(value: object) -> int | tuple[int, ...] | Literal["all"]:
    """Turn "1000" into a number and "2000,500" into one for each class; "all" stays.

    Raises:
        ValueError: it is none of these, or a number is not above zero.
    """
    if value == EVERY_IMAGE:
        return EVERY_IMAGE
    parts = parse_list(value) if isinstance(value, str) else value
    several = isinstance(parts, list | tuple) and (len(parts) > 1 or not isinstance(value, str))
    texts = [str(part) for part in parts] if isinstance(parts, list | tuple) else [str(parts)]
    if not texts or not all(text.isdecimal() and int(text) > 0 for text in texts):
        raise ValueError(
            f"{value!r} is not a number of images: write 1000, '2000,500' for so many of each class, or 'all'"
        )
    counts = tuple(map(int, texts))
    return counts if several else counts[0]


ImageCount = Annotated[
    int | tuple[int, ...] | Literal["all"],
    BeforeValidator(
        parse_counts, json_schema_input_type=_Counts | PositiveInt | tuple[PositiveInt, ...] | Literal["all"]
    ),
]
"""How many images in all, how many of each class, or every image that the data set has of the classes."""


GRID_TOLERANCE = 0.01
"""Of a sample: so far a time may miss the grid, since what text says is never exact in binary."""


def samples_in(setting: str, time_s: float, sample_rate: float) -> int:
    """How many samples, at `sample_rate` (S/s), the time that a setting asks for is.

    Raises:
        ProtocolError: not a whole number of them, one or more.
    """
    ratio = time_s * sample_rate
    count = round(ratio)
    if count < 1 or abs(ratio - count) > GRID_TOLERANCE:
        near = (number for number in (int(ratio), int(ratio) + 1) if number)
        raise ProtocolError(
            f"{setting} = {time_s * 1e9:.9g} ns is not a whole number of {1e9 / sample_rate:g} ns samples: "
            f"use {' or '.join(f'{number * 1e9 / sample_rate:.9g} ns' for number in near)}"
        )
    return count


def passes_for(bench: Bench, wavelengths_nm: tuple[float, ...], ports: tuple[int, ...]) -> tuple[Pass, ...]:
    """Every wavelength with every patching that the ports need on this bench, wavelength outermost."""
    return tuple(
        Pass(index, wavelength, patching)
        for index, (wavelength, patching) in enumerate(product(wavelengths_nm, bench.patchings_for(ports)))
    )
