from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from labctl.reports.figures.same_image import MOST_PORTS, SameImage, same_image_figure
from tests.labctl.reports.figures.drawn import check_figure, legend, noise


def same_image(ports: int = 2) -> Figure:
    same = SameImage(
        dataset_index=np.array([7, 9]),
        labels=np.array([0, 3]),
        ports=tuple(f"port {port}" for port in range(ports)),
        time_s=(np.linspace(0, 2.4e-9, 60), np.linspace(0, 3.6e-9, 90)),
        volts=(noise(2, ports, 60), noise(2, ports, 90)),
    )
    return same_image_figure(same, ["<one>", "two"])


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(same_image, tmp_path)


def test_both_runs_are_named_and_an_image_is_a_column() -> None:
    figure = same_image()
    assert legend(figure) == ["<one>", "two"]
    assert [axes.get_title() for axes in figure.axes[:2]] == ["image 7, class 0", "image 9, class 3"]


def test_no_more_ports_are_drawn_than_can_be_read() -> None:
    assert len(same_image(ports=20).axes) == 2 * MOST_PORTS
