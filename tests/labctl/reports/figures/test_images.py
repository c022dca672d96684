from pathlib import Path

from matplotlib.figure import Figure

from labctl.reports.figures.images import ImageRow, filmstrip_figure, image_rows_figure, images_figure
from tests.labctl.reports.figures.drawn import check_figure, noise, visible_words


def examples() -> Figure:
    return images_figure(noise(10, 28, 28) > 0.5, [str(number) for number in range(10)])


def rows() -> Figure:
    return image_rows_figure([ImageRow("original", noise(4, 28, 28)), ImageRow("linear\nRMSE 0.15", noise(4, 28, 28))])


def strip() -> Figure:
    images = {"on the mirrors": noise(5, 28, 28), "network": noise(5, 28, 28)}
    return filmstrip_figure(images, [4e-6, 4.6e-6, 5e-6, 5.4e-6, 6e-6], transit_s=(4.5e-6, 5.5e-6))


def test_they_are_sound(tmp_path: Path) -> None:
    for draw in (examples, rows, strip):
        check_figure(draw, tmp_path)


def test_rows_of_images_carry_labels() -> None:
    figure = rows()
    assert len(figure.axes) == 8
    assert {"original", "linear\nRMSE 0.15"} <= set(visible_words(figure))


def test_images_taken_in_transit_are_framed() -> None:
    figure = strip()
    framed = [bool(axes.spines["left"].get_visible()) for axes in figure.axes]
    assert framed == [False, True, True, True, False] * 2
    assert [axes.get_xlabel() for axes in figure.axes[5:]] == ["4.00", "4.60", "5.00", "5.40", "6.00"]
