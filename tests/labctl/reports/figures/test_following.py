from pathlib import Path

from matplotlib.figure import Figure

from labctl.reports.canvas import Series
from labctl.reports.figures.following import following_figure
from tests.labctl.reports.figures.drawn import check_figure

TITLES = ("no drift", "0.99 per 1000 images", "0.97 per 1000 images")


def following() -> Figure:
    curves = [
        Series("recursive least squares", [1500, 2000, 2500], [0.9, 0.89, 0.9], [0.01] * 3),
        Series("softmax, frozen", [1500, 2000, 2500], [0.9, 0.85, 0.8], [0.01] * 3),
    ]
    return following_figure(dict.fromkeys(TITLES, curves), chance=0.25)


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(following, tmp_path)


def test_a_panel_for_each_drift() -> None:
    figure = following()
    assert [axes.get_title(loc="left") for axes in figure.axes if axes.get_visible()] == list(TITLES)
