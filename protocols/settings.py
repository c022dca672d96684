"""Settings that protocols share, as text from the command line or a file gives them; and the passes they ask for."""

from itertools import product
from typing import Annotated, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field, PositiveInt

from instruments.bench import Bench
from instruments.units import Nanometres
from protocols.base import Pass

Number = TypeVar("Number", int, float)


def parse_ports(value: object) -> object:
    """Turn "2-6" or "0,2,4-6" into a tuple of port numbers; anything else is left to pydantic.

    Raises:
        ValueError: a part is neither a number nor a range.
    """
    if isinstance(value, int):
        return (value,)
    if not isinstance(value, str):
        return value
    ports: list[int] = []
    for part in value.split(","):
        first, _, last = part.strip().partition("-")
        if not (first.isdecimal() and (last or first).isdecimal() and max(len(first), len(last)) <= 2):
            raise ValueError(f"{value!r} is not a list of ports: write it like '2-6' or '2,3,5'")
        ports.extend(range(int(first), int(last or first) + 1))
    return tuple(ports)


def parse_list(value: object) -> object:
    """Turn "1550 nm, 1551 nm" or "0,1,2" into a list of its parts; anything else is left to pydantic."""
    return [part.strip() for part in value.split(",")] if isinstance(value, str) else value


def require_distinct(values: tuple[Number, ...]) -> tuple[Number, ...]:
    """The same values.

    Raises:
        ValueError: one comes twice.
    """
    if len(set(values)) != len(values):
        raise ValueError(f"{values} names one twice: list each once")
    return values


Port = Annotated[int, Field(ge=0, le=14)]
_Ranges = Annotated[str, Field(pattern=r"^\s*\d{1,2}\s*(-\s*\d{1,2}\s*)?(,\s*\d{1,2}\s*(-\s*\d{1,2}\s*)?)*$")]
_Counts = Annotated[str, Field(pattern=r"^\s*\d+\s*(,\s*\d+\s*)*$")]
Ports = Annotated[
    tuple[Port, ...],
    BeforeValidator(parse_ports, json_schema_input_type=_Ranges | Port | tuple[Port, ...]),
    Field(min_length=1),
    AfterValidator(require_distinct),
]
Wavelengths = Annotated[
    tuple[Nanometres, ...],
    BeforeValidator(parse_list, json_schema_input_type=str | tuple[Nanometres, ...]),
    Field(min_length=1),
    AfterValidator(require_distinct),
]
Classes = Annotated[tuple[int, ...], BeforeValidator(parse_list, json_schema_input_type=_Counts | tuple[int, ...])]
Binarisation = Annotated[
    str,
    BeforeValidator(lambda value: str(value) if isinstance(value, int) else value, json_schema_input_type=str | int),
]


def parse_counts(value: object) -> int | tuple[int, ...]:
    """Turn "1000" into a number and "2000,500" into one for each class.

    Raises:
        ValueError: it is neither, or a number is not above zero.
    """
    parts = parse_list(value) if isinstance(value, str) else value
    several = isinstance(parts, list | tuple) and (len(parts) > 1 or not isinstance(value, str))
    texts = [str(part) for part in parts] if isinstance(parts, list | tuple) else [str(parts)]
    if not texts or not all(text.isdecimal() and int(text) > 0 for text in texts):
        raise ValueError(f"{value!r} is not a number of images: write 1000, or '2000,500' for so many of each class")
    counts = tuple(map(int, texts))
    return counts if several else counts[0]


ImageCount = Annotated[
    int | tuple[int, ...],
    BeforeValidator(parse_counts, json_schema_input_type=_Counts | PositiveInt | tuple[PositiveInt, ...]),
]
"""How many images in all, or how many of each class."""


def passes_for(bench: Bench, wavelengths_nm: tuple[float, ...], ports: tuple[int, ...]) -> tuple[Pass, ...]:
    """Every wavelength with every patching that the ports need on this bench, wavelength outermost."""
    return tuple(
        Pass(index, wavelength, patching)
        for index, (wavelength, patching) in enumerate(product(wavelengths_nm, bench.patchings_for(ports)))
    )
