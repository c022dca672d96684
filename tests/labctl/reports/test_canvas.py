import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from instruments.ports import port_name
from labctl.reports.canvas import (
    DASHES,
    MARKERS,
    PALETTE,
    Series,
    draw_series,
    legend_below,
    look,
    spread_out,
    thinned,
    volt_scale,
)


@given(st.lists(st.floats(0, 1), max_size=12))
def test_labels_keep_their_order_and_their_distance(heights: list[float]) -> None:
    placed = spread_out(heights, 0.05)
    assert len(placed) == len(heights)
    ordered = np.array(placed)[np.argsort(heights, kind="stable")]
    assert np.all(np.diff(ordered) > 0.035)
    assert all(-1e-9 <= height <= 1 + 1e-9 for height in placed)


def test_labels_that_are_clear_stay() -> None:
    assert spread_out([0.9, 0.1, 0.5], 0.1) == [0.9, 0.1, 0.5]


@given(st.integers(1, 5000), st.integers(1, 50))
def test_thinning_keeps_the_ends_and_the_extremes(count: int, bins: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    x, y = thinned(np.arange(count), values, bins=bins)
    assert x.size == y.size <= 2 * bins + 2
    assert x[0] == 0
    assert x[-1] == count - 1
    assert np.all(np.diff(x) > 0)
    assert (y.min(), y.max()) == (values.min(), values.max())
    np.testing.assert_array_equal(values[x], y)


@pytest.mark.parametrize(("peak", "unit"), [(0.5, "V"), (0.1, "V"), (0.05, "mV"), (0.0, "mV")])
def test_small_signals_are_drawn_in_millivolts(peak: float, unit: str) -> None:
    assert volt_scale([0, -peak])[1] == unit


def test_curves_differ_in_colour_marker_and_line() -> None:
    assert len({look(position).marker for position in range(7)}) == len(MARKERS) == len(PALETTE) == len(DASHES)
    assert look(7) == look(0)


@pytest.mark.parametrize(("count", "bands"), [(3, 3), (4, 0)])
def test_many_curves_carry_bars_in_place_of_bands(count: int, bands: int) -> None:
    axes = Figure().add_subplot()
    draw_series(axes, [Series(f"{number}", [1, 2], [90, 99], [5, 5]) for number in range(count)], highest=100)
    kinds = [type(collection).__name__ for collection in axes.collections]
    assert sum(kind != "LineCollection" for kind in kinds) == bands
    assert len(kinds) == count


def test_an_interval_is_drawn_from_end_to_end() -> None:
    accuracy = {1.0: {"mean": 0.98, "low": 0.91, "high": 0.99}, 2.0: {"mean": 1.0, "low": 0.94, "high": 1.0}}
    axes = Figure().add_subplot()
    curve = Series.with_intervals("a", accuracy).scaled(1, 100)
    draw_series(axes, [curve], highest=100)
    [band] = axes.collections
    [path] = band.get_paths()
    corners = {(round(x, 6), round(y, 6)) for x, y in np.asarray(path.vertices).tolist()}
    assert corners == {(1, 91), (1, 99), (2, 94), (2, 100)}
    assert curve.top == pytest.approx(100)


def test_a_spread_of_nothing_is_not_drawn() -> None:
    axes = Figure().add_subplot()
    draw_series(axes, [Series("a", [1, 2], [0, 1], [float("nan"), 0])])
    assert not axes.collections
    assert len(axes.lines) == 1


@pytest.mark.parametrize("characters", [3, 16, 20, 60])
def test_a_legend_is_not_wider_than_its_figure(characters: int) -> None:
    figure = Figure(figsize=(6.4, 4), layout="constrained")
    handles = [Line2D([], [], marker="o") for _ in range(5)]
    legend_below(figure, handles, ["M" * (characters // 3) + " " * (characters - characters // 3)] * 5)
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.width


def test_a_series_is_made_of_results_by_their_position() -> None:
    results = {"0.4": {"mean": 0.9, "sd": 0.1}, "2.0": {"mean": 0.95, "sd": 0.0, "se": 0.0}}
    series = Series.of("chip", results, unit=1e-9, tag="c")
    assert series == Series("chip", [0.4 * 1e-9, 2.0 * 1e-9], [0.9, 0.95], [0.1, 0.0], "c")
    assert series.top == 1.0


def test_the_port_before_the_chip_has_a_name_of_its_own() -> None:
    assert [port_name(port) for port in (0, 2)] == ["before the chip", "port 2"]
