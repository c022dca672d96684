from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from labctl.reports.figures.confusion import confusion_figure
from tests.labctl.reports.figures.drawn import beside, check_figure


def confusion() -> Figure:
    counts = np.diag([90, 80, 70]) + 5
    return confusion_figure([("with", counts), ("without", np.zeros((3, 3)))], ["T-shirt", "bag", "coat"])


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(confusion, tmp_path)


def test_it_shows_shares_of_the_true_class() -> None:
    assert beside(confusion().axes[0])[:3] == ["90.5", "4.8", "4.8"]
