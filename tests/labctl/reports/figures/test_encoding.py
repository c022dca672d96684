from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from labctl.reports.figures.encoding import encoding_figure
from tests.labctl.reports.figures.drawn import check_figure, noise


def encoding() -> Figure:
    time_s = np.arange(60) * 40e-12 - 0.4e-9
    names = ["before the chip", "port 2", "port 3"]
    return encoding_figure(noise(3, 28, 28), time_s, noise(3, 3, 60), classes=['"0"', '"1"', '"2"'], ports=names)


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(encoding, tmp_path)


def test_it_has_a_row_for_each_class_and_a_column_for_each_port() -> None:
    figure = encoding()
    assert len(figure.axes) == 3 * 4
    assert figure.axes[0].get_ylabel() == '"0"'
    assert [axes.get_title() for axes in figure.axes[:4]] == ["image", "before the chip", "port 2", "port 3"]
    assert figure.axes[1].get_ylabel() == "signal (V)"
    assert figure.axes[1].get_ylim() == figure.axes[5].get_ylim()
