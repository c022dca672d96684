"""Numbers and ranges as they are typed: "0-19", "2-6"."""

import re
from typing import Annotated

import typer

from instruments.ports import parse_ports, require_distinct
from labctl.errors import UsageError

_NUMBER = re.compile("[0-9]{1,18}")
ShotsOption = Annotated[
    str | None, typer.Option("--shots", help='Shots by their number in the plan, such as "0-19" or "7".')
]


def shots_of(text: str | None) -> tuple[int, int] | None:
    """First and last shot of "7" or "0-19"; None for None.

    Raises:
        UsageError: it is no range.
    """
    if text is None:
        return None
    first, dash, last = text.strip().partition("-")
    last = last if dash else first
    if not (_NUMBER.fullmatch(first) and _NUMBER.fullmatch(last)) or int(last) < int(first):
        raise UsageError(f"--shots {text}: is not a range of shots: write it like 0-19 or 7")
    return int(first), int(last)


def ports_of(text: str | None) -> tuple[int, ...] | None:
    """The ports of "2-6" or "2,3"; None for None.

    Raises:
        UsageError: it is no list of ports, or names one twice.
    """
    if text is None:
        return None
    try:
        parsed = parse_ports(text)
        return require_distinct(parsed) if isinstance(parsed, tuple) else None
    except ValueError as error:
        raise UsageError(f"--ports: {error}") from None
