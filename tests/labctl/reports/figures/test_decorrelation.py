from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from labctl.reports.figures.decorrelation import decorrelation_figure, open_decorrelation_figure
from tests.labctl.reports.figures.drawn import beside, check_figure, legend, visible_words

DETUNING_NM = np.linspace(0, 0.06, 61)


def measured() -> Figure:
    curve = 1 / (1 + (DETUNING_NM / 0.01) ** 2)
    return decorrelation_figure(DETUNING_NM, [("measured", curve)], half_width_nm=0.01, bound_nm=0.02)


def too_short() -> Figure:
    return open_decorrelation_figure(DETUNING_NM, 1 / (1 + (DETUNING_NM / 0.1) ** 2), label="measured")


def test_they_are_sound(tmp_path: Path) -> None:
    check_figure(measured, tmp_path)
    check_figure(too_short, tmp_path)


def test_the_half_width_is_marked_in_picometres() -> None:
    figure = measured()
    assert "half width 10 pm" in visible_words(figure)
    assert legend(figure) == ["measured", "paper: below 20 pm"]
    wide = decorrelation_figure([-1.0, 0.0, 1.0], [("measured", [0.1, 1, 0.1])], half_width_nm=0.6)
    assert wide.axes[0].get_xlabel() == "detuning (nm)"


def test_a_scan_that_is_too_short_shows_where_one_half_is() -> None:
    (axes,) = too_short().axes
    assert beside(axes) == ["one half"]
    assert axes.get_xlabel() == "detuning (pm)"
