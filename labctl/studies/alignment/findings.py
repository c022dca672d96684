"""What an alignment finds: a quantity with its uncertainty, a verdict, and what to do where it is not good."""

import math
from dataclasses import dataclass
from typing import Any

from labctl.analysis.estimates import Estimate

COVERAGE = 4.0
"""k of the stated uncertainties. An alignment makes 23 statements, most of them from 32 frames, and all are to hold at
once in 99 of 100 alignments: 3.94 by Student's t with 31 degrees of freedom and Bonferroni's inequality."""
PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: ""}
WITH_PREFIX = ("V", "s", "m")


@dataclass(frozen=True)
class Finding:
    """One line of an alignment.

    Attributes:
        step: Which step found it.
        what: The quantity, in words.
        channel: Channel of the oscilloscope; None where it belongs to the bench.
        estimate: Value and standard uncertainty (k = 1), SI unit or `unit`; None where it was not measured.
        unit: "V", "s", "m", "rad", "dB", or "1" for a part of one.
        advice: What is wrong and what to do; empty = good.
        criterion: What is good, in words.
    """

    step: str
    what: str
    channel: int | None
    estimate: Estimate | None
    unit: str
    advice: str = ""
    criterion: str = ""

    @property
    def good(self) -> bool:
        """Whether there is nothing to do."""
        return not self.advice

    def line(self) -> str:
        """The finding as a person reads it."""
        found = f" {self.found}" if self.found else ""
        good = f"good ({self.criterion})" if self.criterion else "good"
        return f"{self.subject}{found}: {self.advice or good}"

    @property
    def subject(self) -> str:
        """What was measured, and of which channel."""
        return self.what if self.channel is None else f"channel {self.channel}: {self.what}"

    @property
    def found(self) -> str:
        """Value and stated uncertainty; empty where it was not measured."""
        return "" if self.estimate is None else in_words(self.estimate, self.unit)

    def values(self) -> dict[str, Any]:
        """The finding as it is stored."""
        known = self.estimate
        return {
            "step": self.step,
            "what": self.what,
            "channel": self.channel,
            "value": None if known is None else known.value,
            "uncertainty": None if known is None else COVERAGE * known.uncertainty,
            "coverage_factor": COVERAGE,
            "unit": self.unit,
            "good": self.good,
            "advice": self.advice,
            "criterion": self.criterion,
        }


def in_words(estimate: Estimate, unit: str) -> str:
    """Value and stated uncertainty to its second digit: "98.0016 ± 0.0095 ns", "75.21 ± 0.35 %"."""
    value, spread = estimate.value, COVERAGE * estimate.uncertainty
    if unit == "1":
        value, spread, unit = 100 * value, 100 * spread, "%"
    elif unit in WITH_PREFIX:
        size = max(abs(value), spread, 1e-12)
        power = max(-12, min(0, 3 * math.floor(math.log10(size) / 3)))
        value, spread, unit = value / 10.0**power, spread / 10.0**power, PREFIXES[power] + unit
    decimals = max(0, 1 - math.floor(math.log10(spread))) if spread > 0 else 3
    return f"{value:.{decimals}f} ± {spread:.{decimals}f} {unit}"
