import re
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from labctl.reports.figures.scores import scores_figure
from labctl.reports.pictures import marked
from labctl.runs.format.origin import Origin
from tests.labctl.reports.figures.drawn import check_figure, legend

SCORE = "anomaly score $(y - 1)^2$"


def scores() -> Figure:
    random = np.random.default_rng(2)
    normal, crack = random.normal(0, 0.1, 300) ** 2, random.normal(1, 0.2, 200) ** 2
    return scores_figure(normal, crack, threshold=0.2, score=SCORE)


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(scores, tmp_path)


def test_histograms_state_what_lies_above_the_threshold() -> None:
    figure = scores()
    first, second, threshold = legend(figure)
    assert re.fullmatch(r"normal \(\$n\$ = 300, \d+\.\d % above\)", first)
    assert re.fullmatch(r"crack \(\$n\$ = 200, 100\.0 % above\)", second)
    assert threshold == "threshold 0.2"
    assert figure.axes[0].get_xscale() == "log"


def test_the_legend_is_inside_the_figure_and_clear_of_the_mark() -> None:
    random = np.random.default_rng(2)
    normal, crack = random.normal(0, 0.1, 1000) ** 2, random.normal(1, 0.2, 500) ** 2
    figure = scores_figure(normal, crack, threshold=0.0234, score=SCORE)
    marked(figure, Origin.SIMULATED)
    FigureCanvasAgg(figure).draw()
    (words,), (mark,) = figure.legends, figure.texts
    box = words.get_window_extent()
    assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
    assert not box.overlaps(mark.get_window_extent())


def test_scores_that_are_all_zero_are_drawn() -> None:
    (axes,) = scores_figure([0.0, 0.0], [0.0], threshold=0.0, score=SCORE).axes
    assert axes.get_xscale() == "linear"
