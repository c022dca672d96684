"""What is varied, over which values, in which order."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.errors import UsageError
from labctl.runs.sweep_axes import MOST_POINTS, Order, measuring_order, parse_axis, points_of, with_reference


def test_lists_and_ranges() -> None:
    assert parse_axis("window=0.4 ns, 1 ns") == ("window", ("0.4 ns", "1 ns"))
    assert parse_axis("power=6:30:5 mW") == ("power", ("6 mW", "12 mW", "18 mW", "24 mW", "30 mW"))
    assert parse_axis("seed=1:3:3") == ("seed", ("1", "2", "3"))
    assert parse_axis("laser.power=-3:3:3 dBm") == ("laser.power", ("-3 dBm", "0 dBm", "3 dBm"))


@pytest.mark.parametrize("micro", ["\u00b5", "\u03bc", "u"])
def test_a_range_has_a_micro_sign_as_keyboards_write_it_and_as_the_greek_letter(micro: str) -> None:
    assert parse_axis(f"power=10:30:3 {micro}W") == ("power", (f"10 {micro}W", f"20 {micro}W", f"30 {micro}W"))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("window", 'write it as "key=value,value"'),
        ("=1 ns", 'write it as "key=value,value"'),
        ("window=1 ns,,2 ns", "a value is missing between two commas"),
        ("power=3:30:0 mW", "0 values: ask for 1 to"),
    ],
)
def test_what_is_no_axis(text: str, told: str) -> None:
    with pytest.raises(UsageError, match=told):
        parse_axis(text)


def test_every_combination_or_side_by_side() -> None:
    axes = {"window": ("1 ns", "2 ns"), "power": ("1 mW", "2 mW")}
    pairs = [(point["window"], point["power"]) for point in points_of(axes, zipped=False)]
    assert pairs == [("1 ns", "1 mW"), ("1 ns", "2 mW"), ("2 ns", "1 mW"), ("2 ns", "2 mW")]
    assert points_of(axes, zipped=True) == [
        {"window": "1 ns", "power": "1 mW"},
        {"window": "2 ns", "power": "2 mW"},
    ]
    with pytest.raises(UsageError, match="--zip: axes side by side have as many values each: a has 1, b has 2"):
        points_of({"a": ("1",), "b": ("1", "2")}, zipped=True)
    with pytest.raises(UsageError, match="a: a value is there twice"):
        points_of({"a": ("1", "1")}, zipped=False)
    with pytest.raises(UsageError, match=f"at most {MOST_POINTS}"):
        points_of({name: tuple(map(str, range(200))) for name in "ab"}, zipped=False)


@pytest.mark.parametrize("axes", [64, 20_000])
def test_no_number_of_axes_has_too_few_points(axes: int) -> None:
    with pytest.raises(UsageError, match=f"at most {MOST_POINTS}"):
        points_of({str(axis): ("1", "2") for axis in range(axes)}, zipped=False)


def test_side_by_side_a_value_may_return_and_a_point_may_not() -> None:
    windows, averages = ("0.5 ns", "0.5 ns", "1 ns"), ("1", "4", "1")
    assert [tuple(point.values()) for point in points_of({"window": windows, "averages": averages}, zipped=True)] == [
        ("0.5 ns", "1"),
        ("0.5 ns", "4"),
        ("1 ns", "1"),
    ]
    with pytest.raises(UsageError, match="--zip: a point is there twice"):
        points_of({"window": windows, "averages": ("1", "1", "4")}, zipped=True)


@given(st.integers(1, 200), st.sampled_from(Order), st.integers(0, 9), st.integers(1, 20))
def test_each_point_is_measured_once_and_the_reference_in_between(
    count: int, order: Order, seed: int, every: int
) -> None:
    places = measuring_order(count, order, seed)
    assert sorted(places) == list(range(count))
    whole = with_reference(places, every)
    assert [place for place in whole if place] == [place for place in places if place]
    assert whole[0] == whole[-1] == 0
    since = 0
    for place in whole:
        since = 0 if place == 0 else since + 1
        assert since <= every
