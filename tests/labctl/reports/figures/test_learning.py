from pathlib import Path

from matplotlib.figure import Figure

from labctl.reports.canvas import Level, Series
from labctl.reports.figures.learning import learning_figure
from tests.labctl.reports.figures.drawn import check_figure


def learning() -> Figure:
    curve = Series("with the chip", [50, 100, 900], [0.7, 0.8, 0.91], [0.0] * 3)
    return learning_figure(curve, chance=0.25, levels=[Level("raw pixels", 0.954)])


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(learning, tmp_path)


def test_training_images_are_marked_as_numbers() -> None:
    figure = learning()
    figure.draw_without_rendering()
    assert [label.get_text() for label in figure.axes[0].get_xticklabels()] == ["50", "100", "900"]
