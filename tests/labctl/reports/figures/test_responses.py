from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from labctl.reports.figures.responses import responses_figure
from tests.labctl.reports.figures.drawn import beside, check_figure, noise


def responses() -> Figure:
    names = [f"port {port}" for port in range(1, 5)]
    return responses_figure(np.arange(5000) * 40e-12, noise(5000), 0.05 * noise(4, 5000), ports=names)


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(responses, tmp_path)


def test_responses_are_thinned_and_drawn_in_millivolts() -> None:
    figure = responses()
    assert len(figure.axes) == 5
    assert len(np.asarray(figure.axes[1].lines[0].get_xdata())) <= 2002
    assert "signal (mV)" in [axes.get_ylabel() for axes in figure.axes]
    assert [beside(axes)[0] for axes in figure.axes[1:]] == ["port 1", "port 2", "port 3", "port 4"]
