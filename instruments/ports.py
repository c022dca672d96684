"""Ports of the chip as people write them: "2-6", "0,2,4-6", a number or a list."""

from typing import Annotated, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field

LAST_PORT = 14

Number = TypeVar("Number", int, float)


def parse_ports(value: object) -> object:
    """Turn "2-6" or "0,2,4-6" into a tuple of port numbers; anything else is left to pydantic.

    Raises:
        ValueError: a part is neither a number nor a range from the lower port to the higher.
    """
    if isinstance(value, int):
        return (value,)
    if not isinstance(value, str):
        return value
    ports: list[int] = []
    for part in value.split(","):
        first, dash, last = map(str.strip, part.partition("-"))
        last = last if dash else first
        if not (first.isdecimal() and last.isdecimal() and len(first) <= 2 >= len(last)) or int(first) > int(last):
            raise ValueError(f"{value!r} is not a list of ports: write it like '2-6' or '2,3,5'")
        if int(last) > LAST_PORT:
            raise ValueError(f"the chip has ports 1 to {LAST_PORT}, and 0 is the fibre before it: choose of these")
        ports.extend(range(int(first), int(last) + 1))
    return tuple(ports)


def require_distinct(values: tuple[Number, ...]) -> tuple[Number, ...]:
    """The same values.

    Raises:
        ValueError: one comes twice.
    """
    if len(set(values)) != len(values):
        raise ValueError(f"{values} names one twice: list each once")
    return values


Port = Annotated[int, Field(ge=0, le=LAST_PORT)]
_Ranges = Annotated[str, Field(pattern=r"^\s*\d{1,2}\s*(-\s*\d{1,2}\s*)?(,\s*\d{1,2}\s*(-\s*\d{1,2}\s*)?)*$")]
Ports = Annotated[
    tuple[Port, ...],
    BeforeValidator(parse_ports, json_schema_input_type=_Ranges | Port | tuple[Port, ...]),
    Field(min_length=1),
    AfterValidator(require_distinct),
]


def port_name(port: int) -> str:
    """What a port is called in figures and tables."""
    return f"port {port}" if port else "before the chip"
