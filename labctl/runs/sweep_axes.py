"""The axes of a sweep: what is varied, over which values, and in which order the points are measured. Pure."""

import math
import re
from collections.abc import Mapping, Sequence
from enum import StrEnum
from itertools import product

import numpy as np

from instruments.units import DIGITS, any_quantity
from labctl.errors import UsageError

MOST_POINTS = 10_000
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_VALUE = re.compile(rf"\s*({_NUMBER})\s*(\S*)\s*")
_RANGE = re.compile(rf"\s*({_NUMBER})\s*:\s*({_NUMBER})\s*:\s*(\d+)\s*([A-Za-z\u00b5\u03bc/]*)\s*")


class Order(StrEnum):
    """In which order points are measured: a drift of the bench then is no trend along an axis, unless `AS_GIVEN`."""

    RANDOM = "random"
    INTERLEAVED = "interleaved"
    AS_GIVEN = "as-given"


def parse_axis(text: str, option: str = "--over") -> tuple[str, tuple[str, ...]]:
    """Name and values of "window=0.4 ns,1 ns" or "power=3:30:7 mW", which is 7 values from 3 to 30 mW.

    Raises:
        UsageError: it is neither, or has no values.

    Example:
        >>> from labctl.runs.sweep_axes import parse_axis
        >>> parse_axis("power=3:30:4 mW")
        ('power', ('3 mW', '12 mW', '21 mW', '30 mW'))
    """
    name, equals, values = (part.strip() for part in text.partition("="))
    if not (name and equals and values):
        raise UsageError(f'{option} {text!r}: write it as "key=value,value" or "key=first:last:number unit"')
    return name, values_of(name, values)


def values_of(name: str, text: str) -> tuple[str, ...]:
    """The values of an axis from a list or a range, as text with units.

    Raises:
        UsageError: a value is missing, or the range has none.
    """
    if (found := _RANGE.fullmatch(text)) is not None:
        first, last, number, unit = found.groups()
        if not 0 < int(number) <= MOST_POINTS:
            raise UsageError(f"{name}={text}: {number} values: ask for 1 to {MOST_POINTS}")
        return tuple(
            f"{value:{DIGITS}} {unit}".rstrip() for value in np.linspace(float(first), float(last), int(number))
        )
    values = tuple(part.strip() for part in text.split(","))
    if not all(values):
        raise UsageError(f"{name}={text}: a value is missing between two commas")
    return values


def as_numbers(texts: Sequence[str]) -> tuple[list[float] | None, str]:
    """The numbers of texts of one unit, and it, or of units of one kind; no numbers where one is none.

    Example:
        >>> from labctl.runs.sweep_axes import as_numbers
        >>> as_numbers(["10 mW", "30 mW"]), as_numbers(["500 ps", "1 ns"]), as_numbers(["software", "burst"])
        (([10.0, 30.0], 'mW'), ([5e-10, 1e-09], 's'), (None, ''))
    """
    matches = [_VALUE.fullmatch(text) for text in texts]
    if all(matches) and len(units := {match.group(2) for match in matches if match}) == 1:
        return [float(match.group(1)) for match in matches if match], units.pop()
    known = [found for text in texts if (found := any_quantity(text)) is not None]
    if len(known) == len(texts) and len(kinds := {unit for _, unit in known}) == 1:
        return [number for number, _ in known], kinds.pop()
    return None, ""


def points_of(axes: Mapping[str, Sequence[str]], *, zipped: bool) -> list[dict[str, str]]:
    """Every combination of the values, the last axis varying fastest; or all axes side by side.

    Raises:
        UsageError: axes of different lengths side by side, one point twice, or too many points.
    """
    if zipped and len({len(values) for values in axes.values()}) > 1:
        lengths = ", ".join(f"{name} has {len(values)}" for name, values in axes.items())
        raise UsageError(f"--zip: axes side by side have as many values each: {lengths}")
    count = len(next(iter(axes.values()), ())) if zipped else math.prod(len(values) for values in axes.values())
    if count > MOST_POINTS:  # their number may be too long to be written
        raise UsageError(f"too many points: a sweep has at most {MOST_POINTS}: give its axes fewer values")
    rows = list(zip(*axes.values(), strict=True) if zipped else product(*axes.values()))
    if len(set(rows)) < len(rows):
        twice = "--zip" if zipped else next(name for name, values in axes.items() if len(set(values)) < len(values))
        raise UsageError(f"{twice}: a {'point' if zipped else 'value'} is there twice: each point is measured once")
    return [dict(zip(axes, row, strict=True)) for row in rows]


def measuring_order(count: int, order: Order, seed: int) -> list[int]:
    """The places of `count` points in the order they are measured in.

    Example:
        >>> from labctl.runs.sweep_axes import Order, measuring_order
        >>> measuring_order(5, Order.INTERLEAVED, seed=1)
        [0, 2, 4, 1, 3]
    """
    match order:
        case Order.RANDOM:
            return [int(place) for place in np.random.default_rng((seed, 6)).permutation(count)]
        case Order.INTERLEAVED:
            return [*range(0, count, 2), *range(1, count, 2)]
        case Order.AS_GIVEN:
            return list(range(count))


def with_reference(order: Sequence[int], every: int) -> list[int]:
    """An order of points in which point 0 comes first, last and after so many others, so that a drift can be seen.

    Example:
        >>> from labctl.runs.sweep_axes import with_reference
        >>> with_reference([2, 0, 3, 1], every=2)
        [0, 2, 3, 0, 1, 0]
    """
    others = [place for place in order if place != 0]
    places = [0]
    for begin in range(0, len(others), every):
        places += [*others[begin : begin + every], 0]
    return places
