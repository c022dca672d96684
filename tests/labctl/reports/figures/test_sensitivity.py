from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from labctl.reports.canvas import Level
from labctl.reports.figures.sensitivity import Sensitivity, sensitivity_figure
from tests.labctl.reports.figures.drawn import check_figure, legend


def sensitivity() -> Figure:
    panels = [
        Sensitivity(f"parameter {number} (GHz)", [1, 2, 10], [0.8, 0.9, 0.99], [0.02] * 3, 2, logarithmic=number > 2)
        for number in range(4)
    ]
    return sensitivity_figure(panels, title="acquisition time 0.4 ns", required=Level("must reach", 0.9))


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(sensitivity, tmp_path)


def test_it_marks_the_default_and_hides_empty_panels() -> None:
    figure = sensitivity()
    assert [axes.get_visible() for axes in figure.axes] == [True] * 4 + [False] * 2
    assert figure.axes[3].get_xscale() == "log"
    assert set(legend(figure)) == {"default", "must reach", "mean ± sd"}
    default = figure.axes[0].lines[0]
    assert list(np.asarray(default.get_xdata())) == [2, 2]
