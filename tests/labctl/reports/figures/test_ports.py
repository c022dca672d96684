from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from labctl.reports.canvas import Level, Series
from labctl.reports.figures.ports import port_accuracy_figure, port_error_figure
from tests.labctl.reports.figures.drawn import beside, check_figure

PORTS = (1, 2, 3, 5, 13)


def error() -> Figure:
    curve = Series("chip, N = 4", PORTS, [0.5, 0.26, 0.19, 0.11, 0.06], [0.05, 0.03, 0.02, 0.01, 0.009])
    return port_error_figure([curve], levels=[Level("AR(10)", 0.19), Level("echo state network", 0.0039)])


def accuracy() -> Figure:
    random = Series("random split", PORTS, [0.7, 0.8, 0.9, 0.95, 0.98], [0.02] * 5, "random")
    speaker = Series("split by speaker", PORTS, [0.6, 0.7, 0.75, 0.8, 0.82], [0.05] * 5, "by speaker")
    return port_accuracy_figure([random, speaker], chance=0.25, levels=[Level("MLP-100", 0.963)])


def test_they_are_sound(tmp_path: Path) -> None:
    check_figure(error, tmp_path)
    check_figure(accuracy, tmp_path)


def test_errors_are_logarithmic_with_baselines_beside() -> None:
    (axes,) = error().axes
    assert axes.get_yscale() == "log"
    assert beside(axes) == ["AR(10)", "echo state network"]
    low, high = axes.get_ylim()
    assert low < 0.0039
    assert high > 0.55


def test_accuracies_are_in_percent() -> None:
    (axes,) = accuracy().axes
    assert axes.get_ylim() == (21, 101)
    np.testing.assert_allclose(np.asarray(axes.lines[0].get_ydata(), float), [70, 80, 90, 95, 98])
    assert beside(axes) == ["random", "by speaker", "MLP-100", "chance"]
    assert axes.get_xlabel() == "number of output ports $M$"
