"""How sure a figure is: its mean over benches, and the interval that holds the mean of all benches like them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from labctl.errors import AnalysisError

CONFIDENCE = 0.95
"""Of the intervals: of a hundred, so many hold the true mean."""

Statistic = dict[str, Any]
"""A figure as a JSON object: {"mean", "sd", "se", "low", "high", "by_bench", "splits"}, see `pooled`."""


class Verdict(StrEnum):
    """Whether a bound is kept, as far as the interval of a mean can say: it lies beyond, short of, or across it."""

    REACHED = "reached"
    NOT_REACHED = "not reached"
    OPEN = "open"


@dataclass(frozen=True)
class Bound:
    """What a mean must be: at least (">=") or at most ("<=") the limit."""

    sign: Literal[">=", "<="]
    limit: float

    def verdict(self, statistic: Statistic) -> Verdict:
        """Reached or not where the whole interval says so; otherwise, and with a single bench, open."""
        low, high = statistic["low"], statistic["high"]
        if low is None or high is None:
            return Verdict.OPEN
        worst, best = (low, high) if self.sign == ">=" else (high, low)
        if self._kept(worst):
            return Verdict.REACHED
        return Verdict.OPEN if self._kept(best) else Verdict.NOT_REACHED

    def _kept(self, value: float) -> bool:
        return value >= self.limit if self.sign == ">=" else value <= self.limit


def interval(right: int, tested: int) -> tuple[float, float]:
    """Wilson's interval of an accuracy of which `tested` shots are a sample, `right` of them right, at `CONFIDENCE`.

    Example:
        >>> from labctl.analysis.intervals import interval
        >>> [round(end, 3) for end in interval(90, 100)]
        [0.826, 0.945]
    """
    from scipy.stats import binomtest  # which takes as long to import as all else that `labctl run` needs

    found = binomtest(right, tested).proportion_ci(CONFIDENCE, "wilson")
    return float(found.low), float(found.high)


def pooled(scores: Iterable[ArrayLike]) -> Statistic:
    """What several benches say together.

    Scores of one bench share its fibre, its chip and mostly its images: only the benches' own means count for the
    interval (Student's t).

    Args:
        scores: For each bench, its score or its scores (splits,).

    Returns:
        "mean" of the benches' means, "sd" over all benches and splits (0 for a single score), "se" the standard error
        of the mean, "low" and "high" the ends of its interval, "by_bench" the benches' means, "splits" how many scores
        each bench has (the fewest). With one bench "se", "low" and "high" are None.
    """
    benches = [np.atleast_1d(np.asarray(one, np.float64)) for one in scores]
    everything = np.concatenate(benches)
    return {
        **_mean([float(np.mean(one)) for one in benches]),
        "sd": float(np.std(everything, ddof=1)) if everything.size > 1 else 0.0,
        "splits": min(one.size for one in benches),
    }


def difference(one: Statistic, other: Statistic) -> Statistic:
    """`one` less `other`, bench by bench; "sd" is that of the benches' differences.

    Raises:
        AnalysisError: they are not of the same benches.
    """
    if len(one["by_bench"]) != len(other["by_bench"]):
        raise AnalysisError("figures of different numbers of benches have no difference bench by bench")
    by_bench = np.subtract(one["by_bench"], other["by_bench"])
    return pooled(by_bench) | {"splits": min(one["splits"], other["splits"])}


def _mean(by_bench: Sequence[float]) -> Statistic:
    mean = float(np.mean(by_bench))
    if len(by_bench) == 1:
        return {"mean": mean, "se": None, "low": None, "high": None, "by_bench": list(by_bench)}
    from scipy.special import stdtrit  # which takes long to load, as scipy.stats does

    error = float(np.std(by_bench, ddof=1) / np.sqrt(len(by_bench)))
    reach = error * float(stdtrit(len(by_bench) - 1, (1 + CONFIDENCE) / 2))
    return {"mean": mean, "se": error, "low": mean - reach, "high": mean + reach, "by_bench": list(by_bench)}
