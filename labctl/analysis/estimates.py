"""A measured quantity with its uncertainty."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """A value and its standard uncertainty (one standard deviation, k = 1), both in the same SI unit."""

    value: float
    uncertainty: float
