import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from labctl.reports.anomalies import RocCurve, roc_figure, scores_figure
from labctl.reports.axes import Level, Series
from labctl.reports.curves import (
    Sensitivity,
    decorrelation_figure,
    learning_figure,
    ports_figure,
    rmse_window_figure,
    sensitivity_figure,
)
from labctl.reports.figures import save_figure
from labctl.reports.pictures import Bar, Bars, ImageRow, bars_figure, image_rows_figure
from labctl.reports.signals import encoding_figure, prediction_figure, responses_figure
from labctl.reports.switching import filmstrip_figure, switching_figure

CLASSES = ('"0"', '"1"', '"2"')
PORTS = (1, 2, 3, 5, 13)


def noise(*shape: int) -> Any:
    return np.random.default_rng(1).random(shape)


def encoding() -> Figure:
    time_s = np.arange(60) * 40e-12 - 0.4e-9
    names = ["before the chip", "port 2", "port 3"]
    return encoding_figure(noise(3, 28, 28), time_s, noise(3, 3, 60), classes=CLASSES, ports=names, window_s=0.4e-9)


def responses() -> Figure:
    names = [f"port {port}" for port in range(1, 5)]
    return responses_figure(np.arange(5000) * 40e-12, noise(5000), 0.05 * noise(4, 5000), ports=names)


def prediction() -> Figure:
    return prediction_figure(noise(80), noise(80) + 0.1, nmse=0.0634, first_step=3000, paper=Level("paper", 0.08))


def nmse() -> Figure:
    curve = Series("chip, N = 4", PORTS, [0.5, 0.26, 0.19, 0.11, 0.06], [0.05, 0.03, 0.02, 0.01, 0.009])
    return ports_figure([curve], quantity="nmse", levels=[Level("AR(10)", 0.19), Level("echo state network", 0.0039)])


def port_accuracy() -> Figure:
    random = Series("random split", PORTS, [0.7, 0.8, 0.9, 0.95, 0.98], [0.02] * 5, "random")
    speaker = Series("split by speaker", PORTS, [0.6, 0.7, 0.75, 0.8, 0.82], [0.05] * 5, "by speaker")
    return ports_figure([random, speaker], quantity="accuracy", chance=0.25, levels=[Level("MLP-100", 0.963)])


def rmse() -> Figure:
    windows = (0.2e-9, 0.4e-9, 0.8e-9, 2e-9)
    curves = [Series(f"L = {number}", windows, [0.22, 0.2, 0.18, 0.16], [0.004] * 4) for number in (1, 3, 5)]
    points = [
        Series(f"network, L = {number}", [0.8e-9], [0.2], [0.01], joined=False, alike=position)
        for position, number in enumerate((1, 3, 5))
    ]
    return rmse_window_figure([*curves, *points], tau_s=40e-12, levels=[Level("mean image", 0.297)])


def learning() -> Figure:
    curve = Series("with the chip", [50, 100, 900], [0.7, 0.8, 0.91], [0.0] * 3)
    return learning_figure([curve], chance=0.25, levels=[Level("raw pixels", 0.954)])


def sensitivity() -> Figure:
    panels = [
        Sensitivity(f"parameter {number} (GHz)", [1, 2, 10], [0.8, 0.9, 0.99], [0.02] * 3, 2, logarithmic=number > 2)
        for number in range(4)
    ]
    return sensitivity_figure(panels, window_s=0.4e-9, required=0.9)


def decorrelation() -> Figure:
    detuning_nm = np.linspace(0, 0.06, 61)
    curve = 1 / (1 + (detuning_nm / 0.01) ** 2)
    return decorrelation_figure(detuning_nm, [("measured", curve)], half_width_nm=0.01, bound_nm=0.02)


def switching() -> Figure:
    time_s = np.arange(17_000) * 0.56e-9
    share = 1 / (1 + np.exp(-(time_s - 5e-6) / 0.1e-6))
    probabilities = np.stack([0 * share, 1 - share, share], axis=1)
    return switching_figure(
        time_s,
        {'"1"': 1 - share / 2, '"2"': 0.5 + share / 2},
        probabilities,
        CLASSES,
        transit_s=(4.5e-6, 5.5e-6),
        switch_s=5.0e-6,
        trace=(np.arange(250_000) * 40e-12, noise(250_000)),
    )


def strip() -> Figure:
    images = {"on the mirrors": noise(5, 28, 28), "network": noise(5, 28, 28)}
    return filmstrip_figure(images, [4e-6, 4.6e-6, 5e-6, 5.4e-6, 6e-6], transit_s=(4.5e-6, 5.5e-6))


def scores() -> Figure:
    random = np.random.default_rng(2)
    return scores_figure(random.normal(0, 0.1, 300) ** 2, random.normal(1, 0.2, 200) ** 2, threshold=0.2)


def linear_scores() -> Figure:
    return scores_figure([0.0, 0.1, 0.1], [0.9, 1.0], threshold=0.5, logarithmic=False, names=("whole", "broken"))


def roc() -> Figure:
    best = RocCurve("covariance", [0, 0, 0.1, 1], [0, 0.9, 1, 1], 0.995, 0.002)
    other = RocCurve("dark pixels", [0, 0.2, 1], [0, 0.9, 1], 0.95)
    return roc_figure([best, other], paper=0.978)


def rows() -> Figure:
    notes = [f"{score:.2f}" for score in (0.1, 0.2, 0.3, 0.4)]
    return image_rows_figure(
        [ImageRow("original", noise(4, 28, 28)), ImageRow("linear\nRMSE 0.15", noise(4, 28, 28), notes)], titles="0123"
    )


def bars() -> Figure:
    values = [Bar("network", 0.181, 0.005), Bar("linear", 0.153, float("nan"))]
    return bars_figure([Bars("MNIST", values, [Level("paper", 0.219)]), Bars("Fashion", values)])


FIGURES: dict[str, Callable[[], Figure]] = {
    function.__name__: function
    for function in (
        *(encoding, responses, prediction, nmse, port_accuracy, rmse, learning, sensitivity, decorrelation, switching),
        *(strip, scores, linear_scores, roc, rows, bars),
    )
}


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_has_the_same_bytes_every_time_and_is_small(name: str, tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    first = save_figure(FIGURES[name](), tmp_path / "first")
    second = save_figure(FIGURES[name](), tmp_path / "second")
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
        assert one.stat().st_size < 400_000
    assert dict(mpl.rcParams) == before
    ElementTree.fromstring(first[1].read_text(encoding="utf-8"))  # noqa: S314  # written a moment ago, here


@pytest.mark.parametrize("name", sorted(FIGURES.keys() - {"strip", "rows"}))
def test_axes_are_named(name: str) -> None:
    figure = FIGURES[name]()
    figure.draw_without_rendering()
    shown = [axes for axes in figure.axes if axes.get_visible() and axes.lines]
    assert any(axes.get_xlabel() for axes in shown)
    assert any(axes.get_ylabel() for axes in shown) or name == "bars"
    for axes in shown:
        named = re.search(r"\(.+\)|number of|step|parameter|RMSE", axes.get_xlabel())
        assert named or not axes.get_xlabel(), axes.get_xlabel()


def legend(figure: Figure) -> list[str]:
    found = [axes.get_legend() for axes in figure.axes] + list(figure.legends)
    return [text.get_text() for one in found if one is not None for text in one.get_texts()]


def beside(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def visible_words(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(Text) if isinstance(text, Text)]


def test_encoding_has_a_row_for_each_class_and_a_column_for_each_port() -> None:
    figure = encoding()
    assert len(figure.axes) == 3 * 4
    assert figure.axes[0].get_ylabel() == '"0"'
    assert [axes.get_title() for axes in figure.axes[:4]] == ["image", "before the chip", "port 2", "port 3"]
    assert figure.axes[1].get_ylabel() == "signal (V)"
    assert legend(figure) == ["acquisition time $T_N$ = 0.4 ns"]
    assert figure.axes[1].get_ylim() == figure.axes[5].get_ylim()


def test_responses_are_thinned_and_drawn_in_millivolts() -> None:
    figure = responses()
    assert len(figure.axes) == 5
    assert len(np.asarray(figure.axes[1].lines[0].get_xdata())) <= 2002
    assert "signal (mV)" in [axes.get_ylabel() for axes in figure.axes]
    assert [beside(axes)[0] for axes in figure.axes[1:]] == ["port 1", "port 2", "port 3", "port 4"]


def test_a_prediction_states_its_error() -> None:
    figure = prediction()
    above, below = figure.axes
    assert above.get_title(loc="right") == "NMSE = 0.0634  (paper: 0.08)"
    assert legend(figure) == ["target", "prediction"]
    np.testing.assert_allclose(np.asarray(below.lines[1].get_ydata(), float), 0.1)
    assert np.asarray(below.lines[1].get_xdata())[0] == 3000


def test_nmse_is_logarithmic_with_baselines_beside() -> None:
    (axes,) = nmse().axes
    assert axes.get_yscale() == "log"
    assert beside(axes) == ["AR(10)", "echo state network"]
    low, high = axes.get_ylim()
    assert low < 0.0039
    assert high > 0.55


def test_accuracies_are_in_percent() -> None:
    (axes,) = port_accuracy().axes
    assert axes.get_ylim() == (25, 101)
    np.testing.assert_allclose(np.asarray(axes.lines[0].get_ydata(), float), [70, 80, 90, 95, 98])
    assert beside(axes) == ["random", "by speaker", "MLP-100"]
    assert axes.get_xlabel() == "number of output ports $M$"


def test_single_results_are_open_symbols_that_look_like_their_curve() -> None:
    figure = rmse()
    axes = figure.axes[0]
    curves, points = axes.lines[:3], axes.lines[3:6]
    for curve, point in zip(curves, points, strict=True):
        assert (curve.get_color(), curve.get_marker()) == (point.get_color(), point.get_marker())
        assert point.get_linestyle() == "None"
        assert point.get_markerfacecolor() == "white"
    assert len(legend(figure)) == 6
    assert beside(axes) == ["L = 1", "L = 3", "L = 5", "mean image"]
    assert len({str(curve.get_linestyle()) + str(curve.get_marker()) for curve in curves}) == 3


def test_training_images_are_marked_as_numbers() -> None:
    figure = learning()
    figure.draw_without_rendering()
    assert [label.get_text() for label in figure.axes[0].get_xticklabels()] == ["50", "100", "900"]


def test_sensitivity_marks_the_default_and_hides_empty_panels() -> None:
    figure = sensitivity()
    assert [axes.get_visible() for axes in figure.axes] == [True] * 4 + [False] * 2
    assert figure.axes[3].get_xscale() == "log"
    assert set(legend(figure)) == {"default", "must reach", "mean ± sd"}
    default = figure.axes[0].lines[0]
    assert list(np.asarray(default.get_xdata())) == [2, 2]


def test_the_half_width_is_marked_in_picometres() -> None:
    figure = decorrelation()
    assert "half width 10 pm" in visible_words(figure)
    assert legend(figure) == ["measured", "paper: below 20 pm"]
    wide = decorrelation_figure([-1.0, 0.0, 1.0], [("measured", [0.1, 1, 0.1])], half_width_nm=0.6)
    assert wide.axes[0].get_xlabel() == "detuning (nm)"


def test_a_class_looks_the_same_in_both_panels_of_the_switch() -> None:
    figure = switching()
    trace, correlation, probability = figure.axes
    looks = {str(line.get_label()): (line.get_color(), line.get_marker()) for line in probability.lines}
    for line in correlation.lines:
        assert looks[str(line.get_label())] == (line.get_color(), line.get_marker())
    assert legend(figure) == ["mirrors move", "new class stays", *CLASSES]
    assert trace.get_ylabel() == "signal (V)"
    assert probability.get_xlabel() == "time (µs)"
    assert "switch seen at 5.00 µs" in trace.get_title(loc="left")
    assert all(len(np.asarray(line.get_xdata())) <= 600 for axes in figure.axes for line in axes.lines)


def test_a_switch_that_is_never_seen_is_not_marked() -> None:
    figure = switching_figure(
        [0.0, 1e-6], {'"1"': [1, 0.5]}, np.eye(2), ('"1"', '"2"'), transit_s=(0.4e-6, 0.6e-6), switch_s=None
    )
    assert legend(figure) == ["mirrors move", '"1"', '"2"']


def test_images_taken_in_transit_are_framed() -> None:
    figure = strip()
    framed = [bool(axes.spines["left"].get_visible()) for axes in figure.axes]
    assert framed == [False, True, True, True, False] * 2
    assert [axes.get_xlabel() for axes in figure.axes[5:]] == ["4.00", "4.60", "5.00", "5.40", "6.00"]


def test_histograms_state_what_lies_above_the_threshold() -> None:
    figure = scores()
    first, second, threshold = legend(figure)
    assert re.fullmatch(r"normal \(\$n\$ = 300, \d+\.\d % above\)", first)
    assert re.fullmatch(r"crack \(\$n\$ = 200, 100\.0 % above\)", second)
    assert threshold == "threshold 0.2"
    assert figure.axes[0].get_xscale() == "log"
    assert linear_scores().axes[0].get_xscale() == "linear"


def test_scores_that_are_all_zero_are_drawn() -> None:
    assert len(scores_figure([0.0, 0.0], [0.0], threshold=0.0).axes) == 1


def test_a_roc_states_its_area() -> None:
    figure = roc()
    assert legend(figure) == ["covariance: AUC 0.995 ± 0.002", "dark pixels: AUC 0.950", "guessing: AUC 0.500"]
    assert figure.legends[0].get_title().get_text() == "paper: AUC 0.978"
    assert figure.axes[1].get_xlim() == (0, 20)


def test_rows_of_images_carry_labels_titles_and_notes() -> None:
    figure = rows()
    assert len(figure.axes) == 8
    words = visible_words(figure)
    for word in ("original", "linear\nRMSE 0.15", "3", "0.40"):
        assert word in words


def test_bars_print_their_values() -> None:
    figure = bars()
    assert beside(figure.axes[0]) == ["0.181 ± 0.005", "0.153"]
    assert legend(figure) == ["paper 0.219"]
    assert figure.axes[1].get_xlabel() == "RMSE of pixels (0 to 1), mean ± sd"
