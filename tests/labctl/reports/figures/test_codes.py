from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from labctl.reports.figures.codes import codes_figure
from tests.labctl.reports.figures.drawn import check_figure


def codes() -> Figure:
    counts = np.random.default_rng(3).integers(0, 500, (2, 64))
    return codes_figure(np.arange(-128, 128, 4), counts, [0.0, 0.015], ports=["port 2", "port 3"])


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(codes, tmp_path)


def test_clipping_is_stated_for_each_port() -> None:
    stated = [axes.get_title(loc="right") for axes in codes().axes]
    assert stated == ["clipped: 0 % of the frames", "clipped: 1.5 % of the frames"]
