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

SHARE = (0.0, 1.0)
"""What a share can be: an accuracy, an area under a curve."""
NOT_NEGATIVE = (0.0, np.inf)
"""What an error, a ratio or a time can be."""

Statistic = dict[str, Any]
"""A figure as a JSON object: {"mean", "sd", "se", "low", "high", "by_bench", "splits"}, see `pooled` and `counted`."""


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
        """Reached or not where the whole interval says so; otherwise, and with no interval or one of no width, open.

        That all of what is counted are right, a share of at least 1, is refuted by one that is not: not reached.
        """
        if self == Bound(">=", 1.0) and statistic["mean"] < 1 and "counted" in statistic:
            return Verdict.NOT_REACHED
        low, high = statistic["low"], statistic["high"]
        if low is None or low == high:
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


def pooled(scores: Iterable[ArrayLike], *, within: tuple[float, float] = (-np.inf, np.inf)) -> Statistic:
    """What several benches say together.

    Scores of one bench share its fibre, its chip and mostly its images: only the benches' own means count for the
    interval (Student's t).

    Args:
        scores: For each bench, its score or its scores (splits,).
        within: Least and most that a score can be; the interval ends there.

    Returns:
        "mean" of the benches' means, "sd" over all benches and splits (0 for a single score), "se" the standard error
        of the mean, "low" and "high" the ends of its interval, "by_bench" the benches' means, "splits" how many scores
        each bench has (the fewest). With one bench "se", "low" and "high" are None. Benches that all agree have an
        interval of no width, which decides nothing.
    """
    benches = [np.atleast_1d(np.asarray(one, np.float64)) for one in scores]
    everything = np.concatenate(benches)
    return {
        **_mean([float(np.mean(one)) for one in benches], within),
        "sd": float(np.std(everything, ddof=1)) if everything.size > 1 else 0.0,
        "splits": min(one.size for one in benches),
    }


def counted(counts: Iterable[tuple[int, int]]) -> Statistic:
    """The share of what was counted on several benches, such as scenes, that is right.

    Its interval is the wider of two at either end. Student's t over the benches' shares has no width where all are
    right. Wilson's over all that was counted has one (Brown, Cai and DasGupta, Statistical Science 16, 101 (2001)), but
    takes what was counted on one bench for as different as what was on two.

    Args:
        counts: For each bench, how many are right and how many were counted; a bench without any has no share.

    Returns:
        What `pooled` gives of the shares, but "mean" of all that was counted, with "right" and "counted", how many of
        how many.

    Raises:
        AnalysisError: nothing was counted on any bench.
    """
    some = [(right, tested) for right, tested in counts if tested]
    if not some:
        raise AnalysisError("nothing was counted on any bench: measure more")
    found = pooled((right / tested for right, tested in some), within=SHARE)
    right, tested = (sum(numbers) for numbers in zip(*some, strict=True))
    found |= {"mean": right / tested, "right": right, "counted": tested}
    return wider(found, *interval(right, tested))


def wider(figure: Statistic, low: float, high: float) -> Statistic:
    """A figure with the wider of its interval over benches and another one, `low` to `high`, at either end.

    Where all benches are tested on the same few, such as speakers, the other one is that over these. A figure of one
    bench stays without an interval.
    """
    if figure["low"] is None:
        return figure
    return figure | {"low": min(low, figure["low"]), "high": max(high, figure["high"])}


def difference(one: Statistic, other: Statistic) -> Statistic:
    """`one` less `other`, bench by bench; "sd" is that of the benches' differences.

    Raises:
        AnalysisError: they are not of the same benches.
    """
    if len(one["by_bench"]) != len(other["by_bench"]):
        raise AnalysisError("figures of different numbers of benches have no difference bench by bench")
    by_bench = np.subtract(one["by_bench"], other["by_bench"])
    return pooled(by_bench) | {"splits": min(one["splits"], other["splits"])}


def _mean(by_bench: Sequence[float], within: tuple[float, float]) -> Statistic:
    mean = float(np.mean(by_bench))
    if len(by_bench) == 1:
        return {"mean": mean, "se": None, "low": None, "high": None, "by_bench": list(by_bench)}
    from scipy.special import stdtrit  # which takes long to load, as scipy.stats does

    error = float(np.std(by_bench, ddof=1) / np.sqrt(len(by_bench)))
    reach = error * float(stdtrit(len(by_bench) - 1, (1 + CONFIDENCE) / 2))
    low, high = max(mean - reach, within[0]), min(mean + reach, within[1])
    return {"mean": mean, "se": error, "low": low, "high": high, "by_bench": list(by_bench)}
