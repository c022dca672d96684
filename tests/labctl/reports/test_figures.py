import re
from pathlib import Path
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from labctl.reports.axes import Level
from labctl.reports.figures import (
    Claim,
    Curve,
    accuracy_figure,
    confusion_figure,
    images_figure,
    save_figure,
    traces_figure,
)

WINDOWS = (0.08e-9, 0.16e-9, 0.4e-9, 0.56e-9, 1e-9, 2e-9)


def accuracy() -> Figure:
    with_reservoir = Curve("with reservoir", WINDOWS, [0.75, 0.83, 0.91, 0.93, 0.95, 0.96], [0.03] * 6)
    without = Curve("without <reservoir>", WINDOWS, [0.5, 0.6, 0.76, 0.81, 0.88, 0.94], [0.05] * 6)
    return accuracy_figure([with_reservoir, without], tau_s=40e-12, chance=0.25)


def confusion() -> Figure:
    counts = np.diag([90, 80, 70]) + 5
    return confusion_figure([("with", counts), ("without", np.zeros((3, 3)))], ["T-shirt", "bag", "coat"])


def traces() -> Figure:
    volts = np.random.default_rng(0).normal(size=(4, 3, 50))
    names = [f"digit {digit}" for digit in range(4)]
    return traces_figure(
        np.arange(50) * 40e-12, volts, shots=names, ports=["input", "port 2", "port 3"], window_s=0.56e-9
    )


def examples() -> Figure:
    images = np.random.default_rng(0).random((10, 28, 28)) > 0.5
    return images_figure(images, [str(number) for number in range(10)])


FIGURES = {"accuracy": accuracy, "confusion": confusion, "traces": traces, "examples": examples}


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_has_the_same_bytes_every_time(name: str, tmp_path: Path) -> None:
    first = save_figure(FIGURES[name](), tmp_path / "first")
    second = save_figure(FIGURES[name](), tmp_path / "second")
    assert [path.name for path in first] == ["first.png", "first.svg"]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert first[0].read_bytes().startswith(b"\x89PNG")
    root = ElementTree.fromstring(first[1].read_text(encoding="utf-8"))  # noqa: S314  # written a moment ago, here
    assert root.tag.endswith("svg")
    assert not re.search(r"20\d\d-\d\d-\d\d", first[1].read_text(encoding="utf-8"))


def test_figures_leave_the_global_settings_alone(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    save_figure(accuracy(), tmp_path / "figure")
    assert dict(mpl.rcParams) == before


def test_text_of_an_svg_is_text(tmp_path: Path) -> None:
    _, svg = save_figure(accuracy(), tmp_path / "accuracy")
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


def test_traces_are_drawn_in_nanoseconds_and_volts() -> None:
    figure = traces()
    assert len(figure.axes) == 3
    line = figure.axes[0].lines[0]
    np.testing.assert_allclose(np.asarray(line.get_xdata())[[0, -1]], [0, 1.96])
    assert figure.axes[-1].get_xlabel() == "time (ns)"
    assert figure.get_supylabel() == "signal (V)"
    plain = traces_figure(np.arange(3) * 1e-9, np.zeros((1, 1, 3)), shots=["dark"], ports=["port 2"])
    assert not plain.axes[0].patches


def test_a_confusion_matrix_shows_shares_of_the_true_class() -> None:
    texts = [text.get_text() for text in confusion().axes[0].texts]
    assert texts[:3] == ["90.5", "4.8", "4.8"]


def test_an_accuracy_without_a_claim_draws_none() -> None:
    curve = Curve("flat", WINDOWS, [0.9] * 6, [0.0] * 6)
    figure = accuracy_figure([curve], tau_s=40e-12, chance=0.25, claim=None)
    assert len(figure.axes[0].lines) == 1
    assert not figure.axes[0].texts


def test_a_claim_stands_in_the_legend_and_levels_beside_the_panel() -> None:
    curves = [Curve(f"M = {ports}", WINDOWS, [0.5 + 0.05 * ports] * 6, [0.02] * 6) for ports in range(1, 6)]
    figure = accuracy_figure(
        curves,
        tau_s=40e-12,
        chance=0.1,
        claim=Claim("paper: 70.8 % at 1 ns", 1e-9, 0.708),
        levels=[Level("raw pixels", 0.8)],
        lowest=0.4,
    )
    assert figure.axes[0].get_ylim() == (40, 101)
    assert [text.get_text() for text in figure.axes[0].texts] == [
        "M = 1",
        "M = 2",
        "M = 3",
        "M = 4",
        "M = 5",
        "raw pixels",
    ]
    assert [text.get_text() for text in figure.legends[0].get_texts()][-1] == "paper: 70.8 % at 1 ns"


def test_windows_too_close_to_be_read_lose_their_tick_marks() -> None:
    windows = [0.04e-9 * samples for samples in range(2, 51)]
    figure = accuracy_figure([Curve("dense", windows, [0.9] * 49, [0.0] * 49)], tau_s=40e-12, chance=0.25)
    figure.draw_without_rendering()
    assert len(figure.axes[0].get_xticklabels()) <= 18


def test_long_traces_are_thinned() -> None:
    figure = traces_figure(np.arange(50_000) * 40e-12, np.zeros((1, 1, 50_000)), shots=["a"], ports=["port 2"])
    assert len(np.asarray(figure.axes[0].lines[0].get_xdata())) <= 2002


def test_saving_rounds_what_the_layout_solver_found(tmp_path: Path) -> None:
    figure = traces()
    save_figure(figure, tmp_path / "traces")
    for axes in figure.axes:
        bounds = axes.get_position(original=True).bounds
        np.testing.assert_allclose(bounds, np.round(bounds, 6), rtol=0, atol=1e-12)


def test_long_names_of_shots_fit_the_width_of_their_figure() -> None:
    names = [f"shot {shot}: class {shot % 4}" for shot in range(1000, 1005)]
    figure = traces_figure(np.arange(50) * 40e-12, np.zeros((5, 1, 50)), shots=names, ports=["port 2"])
    figure.draw_without_rendering()
    (legend,) = figure.legends
    assert legend.get_window_extent().width <= figure.bbox.width
