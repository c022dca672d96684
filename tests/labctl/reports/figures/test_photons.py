from collections.abc import Callable
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from labctl.reports.canvas import Level, Series
from labctl.reports.figures.photons import bits_figure, photons_figure
from tests.labctl.reports.figures.drawn import check_figure


def photons() -> Figure:
    measured = Series("receiver, 2 ns", [0.4, 3.2, 31.0, 290.0], [0.6, 0.85, 0.94, 0.95], [0.02] * 4)
    ideal = Series("ideal counter, 2 ns", [0.1, 1.0, 10.0, 100.0], [0.5, 0.8, 0.93, 0.95], [0.02] * 4)
    return photons_figure([measured, ideal], chance=0.25, levels=[Level("90 %", 0.9)])


def bits() -> Figure:
    trained = Series("trained", [1, 2, 4, 8], [0.85, 0.9, 0.92, 0.92], [0.02] * 4)
    return bits_figure([trained], chance=0.25, levels=[Level("digital", 0.92)])


@pytest.mark.parametrize("draw", [photons, bits])
def test_it_is_sound(draw: Callable[[], Figure], tmp_path: Path) -> None:
    check_figure(draw, tmp_path)


def test_axes_have_plain_numbers() -> None:
    for figure, wanted in ((photons(), "0.1"), (bits(), "8")):
        figure.draw_without_rendering()
        assert wanted in [label.get_text() for label in figure.axes[0].get_xticklabels()]
