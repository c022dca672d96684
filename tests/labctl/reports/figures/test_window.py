from pathlib import Path

from matplotlib.figure import Figure

from labctl.reports.canvas import Level, Series
from labctl.reports.figure_files import save_figure
from labctl.reports.figures.window import PAPER_CLAIM, Claim, accuracy_figure, interval_figure, rmse_figure
from labctl.runs.format.origin import Origin
from tests.labctl.reports.figures.drawn import beside, check_figure, legend

WINDOWS = (0.08e-9, 0.16e-9, 0.4e-9, 0.56e-9, 1e-9, 2e-9)


def accuracy() -> Figure:
    with_reservoir = Series("with reservoir", WINDOWS, [0.75, 0.83, 0.91, 0.93, 0.95, 0.96], [0.03] * 6)
    without = Series("without <reservoir>", WINDOWS, [0.5, 0.6, 0.76, 0.81, 0.88, 0.94], [0.05] * 6)
    return accuracy_figure([with_reservoir, without], tau_s=40e-12, chance=0.25, claim=PAPER_CLAIM)


def rmse() -> Figure:
    windows = (0.2e-9, 0.4e-9, 0.8e-9, 2e-9)
    curves = [Series(f"L = {number}", windows, [0.22, 0.2, 0.18, 0.16], [0.004] * 4) for number in (1, 3, 5)]
    points = [
        Series(f"network, L = {number}", [0.8e-9], [0.2], [0.01], joined=False, alike=position)
        for position, number in enumerate((1, 3, 5))
    ]
    return rmse_figure([*curves, *points], tau_s=40e-12, levels=[Level("mean image", 0.297)])


def differences() -> Figure:
    results = {window: {"mean": mean, "low": mean - 0.01, "high": mean + 0.01} for window, mean in DIFFERENCES.items()}
    curves = [Series.with_intervals(label, results, unit=1e-9) for label in ("M = 5", "M = 13")]
    return interval_figure(curves, tau_s=40e-12, quantity="difference (points)", levels=[Level("raw pixels", 0.0)])


DIFFERENCES = {"0.16": -0.04, "0.24": -0.02, "0.4": -0.015}


def test_they_are_sound(tmp_path: Path) -> None:
    check_figure(accuracy, tmp_path)
    check_figure(differences, tmp_path)
    check_figure(rmse, tmp_path)


def test_text_of_an_svg_is_text(tmp_path: Path) -> None:
    svg = save_figure(accuracy(), tmp_path / "accuracy", Origin.REAL).svg
    text = svg.read_text(encoding="utf-8")
    assert ">with reservoir<" in text
    assert "without &lt;reservoir&gt;" in text
    assert "accuracy (%)" in text


def test_the_second_axis_is_the_compressive_ratio() -> None:
    figure = accuracy()
    figure.draw_without_rendering()
    (ratio,) = figure.axes[0].child_axes
    labels = [label.get_text() for label in ratio.get_xticklabels()]
    assert labels == ["0.26", "0.51", "1.28", "1.79", "3.19", "6.38"]


def test_an_accuracy_without_a_claim_draws_none() -> None:
    curve = Series("flat", WINDOWS, [0.9] * 6, [0.0] * 6)
    figure = accuracy_figure([curve], tau_s=40e-12, chance=0.25)
    assert len(figure.axes[0].lines) == 2, "the curve and chance"
    assert beside(figure.axes[0]) == ["chance"]


def test_a_claim_is_in_the_legend_and_levels_are_beside_the_panel() -> None:
    curves = [Series(f"M = {ports}", WINDOWS, [0.5 + 0.05 * ports] * 6, [0.02] * 6) for ports in range(1, 6)]
    figure = accuracy_figure(
        curves,
        tau_s=40e-12,
        chance=0.4,
        claim=Claim("paper: 70.8 % at 1 ns", 1e-9, 0.708),
        levels=[Level("raw pixels", 0.8)],
    )
    assert figure.axes[0].get_ylim() == (36, 101)
    assert beside(figure.axes[0]) == ["M = 1", "M = 2", "M = 3", "M = 4", "M = 5", "raw pixels", "chance"]
    assert legend(figure)[-1] == "paper: 70.8 % at 1 ns"


def test_intervals_and_what_they_are_compared_with_fill_the_panel() -> None:
    axes = differences().axes[0]
    low, high = axes.get_ylim()
    assert -6 < low < -5
    assert 0 < high < 1
    assert axes.get_ylabel() == "difference (points), 95 % interval"
    assert beside(axes) == ["M = 5", "M = 13", "raw pixels"]


def test_a_figure_of_one_bench_has_no_interval() -> None:
    one = Series.with_intervals("one bench", {"0.4": {"mean": 0.9, "low": None, "high": None}}, unit=1e-9)
    assert [end.tolist() for end in one.ends] == [one.mean, one.mean] == [[0.9], [0.9]]


def test_windows_too_close_to_be_read_lose_their_tick_marks() -> None:
    windows = [0.04e-9 * samples for samples in range(2, 51)]
    figure = accuracy_figure([Series("dense", windows, [0.9] * 49, [0.0] * 49)], tau_s=40e-12, chance=0.25)
    figure.draw_without_rendering()
    assert len(figure.axes[0].get_xticklabels()) <= 18


def test_single_results_are_open_symbols_that_look_like_their_curve() -> None:
    figure = rmse()
    axes = figure.axes[0]
    curves, points = axes.lines[:3], axes.lines[3:6]
    for curve, point in zip(curves, points, strict=True):
        assert (curve.get_color(), curve.get_marker()) == (point.get_color(), point.get_marker())
        assert point.get_linestyle() == "None"
        assert point.get_markerfacecolor() == "white"
    assert len(legend(figure)) == 3, "the curves have their names beside them"
    assert beside(axes) == ["L = 1", "L = 3", "L = 5", "mean image"]
    assert len({str(curve.get_linestyle()) + str(curve.get_marker()) for curve in curves}) == 3
