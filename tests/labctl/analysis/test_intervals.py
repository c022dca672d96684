"""What an interval over benches says, and when a bound is reached, not reached or open."""

from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, t, ttest_rel

from labctl.analysis.intervals import SHARE, Bound, Verdict, counted, difference, pooled
from labctl.errors import AnalysisError

SCORE = st.floats(-10, 10, allow_subnormal=False)
BENCHES = st.lists(st.lists(SCORE, min_size=2, max_size=2), min_size=2, max_size=12)


@given(BENCHES)
def test_the_interval_is_students_over_the_means_of_the_benches(scores: list[list[float]]) -> None:
    found = pooled(scores)
    means = np.mean(scores, axis=1)
    assert found["by_bench"] == pytest.approx(means)
    assert found["mean"] == pytest.approx(np.mean(scores), abs=1e-12)
    assert found["sd"] == pytest.approx(np.std(scores, ddof=1), abs=1e-12)
    error = np.std(means, ddof=1) / np.sqrt(means.size)
    expected = means.mean() + np.array(t.interval(0.95, means.size - 1)) * error
    assert (found["low"], found["high"]) == pytest.approx(expected, abs=1e-9)
    assert (found["se"], found["splits"]) == (pytest.approx(error, abs=1e-12), 2)


def test_one_bench_has_no_interval() -> None:
    found = pooled([[0.9, 0.92]])
    assert found["mean"] == pytest.approx(0.91)
    assert (found["se"], found["low"], found["high"]) == (None, None, None)
    assert pooled([0.5])["sd"] == 0.0


def test_it_holds_the_true_mean_as_often_as_it_says() -> None:
    generator = np.random.default_rng(1)
    benches = generator.normal(0.0, 1.0, (4000, 10))
    held = [found["low"] <= 0.0 <= found["high"] for found in map(pooled, benches)]
    assert np.mean(held) == pytest.approx(0.95, abs=0.014), "four standard errors"


@given(st.lists(st.tuples(SCORE, SCORE), min_size=2, max_size=12))
def test_a_difference_is_taken_bench_by_bench(pairs: list[tuple[float, float]]) -> None:
    one, other = zip(*pairs, strict=True)
    found = difference(pooled(one), pooled(other))
    assert found["by_bench"] == pytest.approx(np.subtract(one, other))
    if np.std(found["by_bench"]) > 1e-3:
        paired = ttest_rel(one, other).confidence_interval()
        assert (found["low"], found["high"]) == pytest.approx((paired.low, paired.high))


def test_benches_share_what_is_subtracted() -> None:
    shared = np.array([0.7, 0.8, 0.9])
    found = difference(pooled(shared + 0.1), pooled(shared))
    assert found["high"] - found["low"] == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(AnalysisError, match="different numbers of benches"):
        difference(pooled([0.1, 0.2]), pooled([0.1]))


@pytest.mark.parametrize(
    ("bound", "verdict"),
    [
        (Bound(">=", 0.7), Verdict.REACHED),
        (Bound(">=", 0.9), Verdict.OPEN),
        (Bound(">=", 1.1), Verdict.NOT_REACHED),
        (Bound("<=", 1.1), Verdict.REACHED),
        (Bound("<=", 0.9), Verdict.OPEN),
        (Bound("<=", 0.7), Verdict.NOT_REACHED),
    ],
)
def test_a_bound_is_reached_where_the_interval_lies_beyond_it(bound: Bound, verdict: Verdict) -> None:
    assert bound.verdict(pooled([0.88, 0.9, 0.92])) is verdict
    assert bound.verdict(pooled([0.9])) is Verdict.OPEN, "one bench decides nothing"


@pytest.mark.parametrize("limit", [0.9, 1.0])
@pytest.mark.parametrize("sign", [">=", "<="])
def test_benches_that_all_agree_leave_a_bound_open(sign: Literal[">=", "<="], limit: float) -> None:
    """Their interval has no width: it knows nothing of benches that differ."""
    assert Bound(sign, limit).verdict(pooled([1.0, 1.0, 1.0])) is Verdict.OPEN


def test_an_interval_ends_where_the_quantity_does() -> None:
    found = pooled([0.6, 1.0, 1.0], within=SHARE)
    assert pooled([0.6, 1.0, 1.0])["high"] > 1.3
    assert (found["high"], found["low"]) == (1.0, pooled([0.6, 1.0, 1.0])["low"])


def test_an_interval_of_counts_has_a_width_where_all_are_right() -> None:
    found = counted([(3, 3), (2, 2)])
    assert (found["mean"], found["right"], found["counted"], found["by_bench"]) == (1.0, 5, 5, [1.0, 1.0])
    assert (found["low"], found["high"]) == (pytest.approx(1 / (1 + 1.959964**2 / 5), abs=1e-6), 1.0), "Wilson's"
    assert Bound(">=", 1.0).verdict(found) is Verdict.OPEN, "that all are right cannot be shown on some"
    assert Bound(">=", 0.5).verdict(found) is Verdict.REACHED


@pytest.mark.parametrize("counts", [[(3, 3)] * 6 + [(2, 2), (1, 3)], [(3, 3)] * 8 + [(0, 3)] * 2, [(2, 3)]])
def test_one_that_fails_refutes_that_all_are_right(counts: list[tuple[int, int]]) -> None:
    """Whatever the interval, and on however few benches."""
    assert Bound(">=", 1.0).verdict(counted(counts)) is Verdict.NOT_REACHED
    assert Bound(">=", 0.85).verdict(counted(counts)) is Verdict.OPEN


def test_an_interval_of_counts_is_as_wide_as_the_benches_differ() -> None:
    counts = [(20, 20), (0, 20), (20, 20), (20, 20)]
    found, wilson = counted(counts), binomtest(60, 80).proportion_ci(method="wilson")
    assert (found["mean"], found["low"], found["high"]) == (0.75, 0.0, 1.0)
    alike = counted([(15, 20)] * 4)
    assert (alike["low"], alike["high"]) == pytest.approx((wilson.low, wilson.high))


def test_a_bench_on_which_nothing_was_counted_has_no_share() -> None:
    found = counted([(3, 3), (0, 0), (1, 2)])
    assert (found["by_bench"], found["right"], found["counted"], found["mean"]) == ([1.0, 0.5], 4, 5, 0.8)
    assert counted([(0, 0), (3, 3)])["low"] is None, "one bench decides nothing"


@given(BENCHES, SCORE)
def test_what_is_reached_as_at_least_is_not_reached_as_at_most(scores: list[list[float]], limit: float) -> None:
    found = pooled(scores)
    least, most = Bound(">=", limit).verdict(found), Bound("<=", limit).verdict(found)
    assert (least is Verdict.OPEN and most is Verdict.OPEN) or least is not most or found["low"] == found["high"]
