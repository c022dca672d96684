"""The table of benchmarks says what was reached, and cannot say so of what was not measured."""

from pathlib import Path

import pytest

import benchmarks.rows
from benchmarks.__main__ import names
from benchmarks.rows import Goal, Row, Timing, interleaved


@pytest.mark.parametrize(
    ("goal", "figure", "reached"),
    [
        (Goal(least=0.9), 9.0, True),
        (Goal(least=0.9), 8.9, False),
        (Goal(most=1.0), 11.0, False),
        (Goal(most=11.0, of="figure"), 11.0, True),
        (None, 1.0, None),
    ],
)
def test_a_goal_bounds_the_ratio_or_the_figure(goal: Goal | None, figure: float, reached: bool | None) -> None:
    assert Row("blocks", figure, "MB/s", against="raw socket", reference=10.0, goal=goal).reached is reached


def test_a_ratio_without_a_reference_is_not_reached() -> None:
    assert Row("blocks", 5.0, "MB/s", goal=Goal(least=0.9)).reached is False


def test_what_is_compared_is_measured_in_turns() -> None:
    order: list[str] = []
    interleaved(lambda: order.append("ours"), lambda: order.append("reference"), repetitions=2)
    assert order == ["ours", "reference"] * 3


def test_the_first_turn_does_not_count() -> None:
    seconds = iter([90.0, 1.0, 2.0, 3.0])
    (found,) = interleaved(lambda: None, repetitions=3, measure=lambda _: Timing(next(seconds), 0.0))
    assert found.wall_s == 2.0


def test_every_benchmark_is_a_part_of_the_table() -> None:
    modules = {path.stem for path in Path(benchmarks.rows.__file__).parent.glob("*.py")}
    assert modules - {"__main__", "commands", "peer", "rows"} == set(names())
