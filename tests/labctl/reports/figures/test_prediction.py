from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from labctl.reports.canvas import Level
from labctl.reports.figures.prediction import prediction_figure
from tests.labctl.reports.figures.drawn import check_figure, legend, noise


def prediction() -> Figure:
    return prediction_figure(noise(80), noise(80) + 0.1, nmse=0.0634, first_step=3000, paper=Level("paper", 0.08))


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(prediction, tmp_path)


def test_a_prediction_states_its_error() -> None:
    figure = prediction()
    above, below = figure.axes
    assert above.get_title(loc="right") == "NMSE = 0.0634  (paper: 0.08)"
    assert [axes.get_ylabel() for axes in figure.axes] == ["series", "error"], "nothing is scaled here"
    assert legend(figure) == ["target", "prediction"]
    np.testing.assert_allclose(np.asarray(below.lines[1].get_ydata(), float), 0.1)
    assert np.asarray(below.lines[1].get_xdata())[0] == 3000
