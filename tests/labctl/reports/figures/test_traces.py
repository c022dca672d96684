from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from labctl.reports.figure_files import save_figure
from labctl.reports.figures.traces import traces_figure
from labctl.runs.format.origin import Origin
from tests.labctl.reports.figures.drawn import check_figure


def traces() -> Figure:
    volts = np.random.default_rng(0).normal(size=(4, 3, 50))
    names = [f"digit {digit}" for digit in range(4)]
    return traces_figure(np.arange(50) * 40e-12, volts, shots=names, ports=["input", "port 2", "port 3"])


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(traces, tmp_path)


def test_traces_are_drawn_in_nanoseconds_and_volts() -> None:
    figure = traces()
    assert len(figure.axes) == 3
    line = figure.axes[0].lines[0]
    np.testing.assert_allclose(np.asarray(line.get_xdata())[[0, -1]], [0, 1.96])
    assert figure.axes[-1].get_xlabel() == "time (ns)"
    assert figure.get_supylabel() == "signal (V)"


def test_one_bright_image_does_not_flatten_the_rest() -> None:
    volts = 0.01 * np.random.default_rng(0).normal(size=(4, 2, 50))
    volts[2, 0] += 0.4
    names = [f"digit {digit}" for digit in range(4)]
    cut, whole = traces_figure(np.arange(50) * 40e-12, volts, shots=names, ports=["port 2", "port 3"]).axes
    others = np.delete(volts[:, 0], 2, axis=0)
    low, high = cut.get_ylim()
    assert low < others.min() < others.max() < high < 2 * others.max()
    assert cut.get_title(loc="left").startswith("port 2; digit 2 is cut, 0.3")
    assert len(cut.lines) == 4
    assert whole.get_title(loc="left") == "port 3"


def test_long_traces_are_thinned() -> None:
    figure = traces_figure(np.arange(50_000) * 40e-12, np.zeros((1, 1, 50_000)), shots=["a"], ports=["port 2"])
    assert len(np.asarray(figure.axes[0].lines[0].get_xdata())) <= 2002


def test_saving_rounds_what_the_layout_solver_found(tmp_path: Path) -> None:
    figure = traces()
    save_figure(figure, tmp_path / "traces", Origin.REAL)
    for axes in figure.axes:
        bounds = axes.get_position(original=True).bounds
        np.testing.assert_allclose(bounds, np.round(bounds, 6), rtol=0, atol=1e-12)


def test_long_names_of_shots_fit_the_width_of_their_figure() -> None:
    names = [f"shot {shot}: class {shot % 4}" for shot in range(1000, 1005)]
    figure = traces_figure(np.arange(50) * 40e-12, np.zeros((5, 1, 50)), shots=names, ports=["port 2"])
    figure.draw_without_rendering()
    (legend,) = figure.legends
    assert legend.get_window_extent().width <= figure.bbox.width


def test_one_sample_is_a_point(recwarn: pytest.WarningsRecorder) -> None:
    figure = traces_figure(np.zeros(1), np.ones((1, 1, 1)), shots=["digit 1"], ports=["port 2"])
    figure.draw_without_rendering()
    assert figure.axes[0].lines[0].get_marker() == "o"
    assert not list(recwarn)
