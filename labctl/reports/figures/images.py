"""Figures of images: examples, what was made of them, and how they change with time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.reports.canvas import look, styled

COLUMNS = 8
APART = 1.1, 1.35
"""From one image to the next, across and down, in widths of an image."""


@dataclass(frozen=True)
class ImageRow:
    """A row of images of one kind.

    Attributes:
        label: What they are, such as "original" or "network, RMSE 0.18"; a line break is kept.
        images: (n, rows, columns) pixels of 0..1; values outside are drawn as 0 or 1.
    """

    label: str
    images: NDArray[Any]


@styled
def images_figure(images: NDArray[Any], titles: Sequence[str]) -> Figure:
    """Example images (n, rows, columns) with a title each, bright pixels white."""
    rows = -(-len(images) // COLUMNS)
    across = min(COLUMNS, len(images))
    figure = Figure(figsize=(0.8 * across + 0.2, 1.0 * rows + 0.2))
    axes = figure.add_subplot()  # one for all: each has to be laid out
    for position, (image, title) in enumerate(zip(images, titles, strict=True)):
        line, column = divmod(position, COLUMNS)
        left, top = APART[0] * column, APART[1] * line
        axes.imshow(image, cmap="gray", interpolation="none", extent=(left, left + 1, top + 1, top))
        axes.text(left + 0.5, top, title, fontsize=8, ha="center", va="bottom")
    axes.set(xlim=(-0.05, APART[0] * across), ylim=(APART[1] * rows - 0.3, -0.3))
    axes.set_axis_off()
    return figure


@styled
def image_rows_figure(rows: Sequence[ImageRow]) -> Figure:
    """Images in rows of one length below each other: originals, binarised images, reconstructions of the same."""
    across = len(rows[0].images)
    longest = max(len(line) for row in rows for line in row.label.split("\n"))
    figure = Figure(figsize=(0.76 * across + 0.3 + 0.075 * longest, 0.78 * len(rows) + 0.2))
    for line, row in zip(figure.subplots(len(rows), across, squeeze=False), rows, strict=True):
        for axes, image in zip(line, row.images, strict=True):
            _draw_image(axes, image)
            axes.spines[:].set(visible=True, color="#BFBFBF", linewidth=0.5)
        line[0].set_ylabel(row.label, rotation=0, ha="right", va="center")
    return figure


@styled
def filmstrip_figure(
    strips: Mapping[str, NDArray[Any]], times_s: Sequence[float], *, transit_s: tuple[float, float]
) -> Figure:
    """Images at several times, a row for each source; those taken while the mirrors move are framed.

    Args:
        strips: (n, rows, columns) images of 0..1 by the name of what made them, such as the network.
        times_s: (n,) start of the window of each image, s.
        transit_s: From when to when the mirrors move, s.
    """
    figure = Figure(figsize=(0.78 * len(times_s) + 0.9, 0.86 * len(strips) + 0.6))
    panels = figure.subplots(len(strips), len(times_s), squeeze=False)
    moving = [transit_s[0] <= time <= transit_s[1] for time in times_s]
    for row, (name, images) in zip(panels, strips.items(), strict=True):
        for axes, image, framed in zip(row, images, moving, strict=True):
            _draw_image(axes, image)
            axes.spines[:].set(visible=framed, linewidth=2.2, color=look(1).colour, linestyle="-")
        row[0].set_ylabel(name, rotation=0, ha="right", va="center")
    for top, bottom, time, framed in zip(panels[0], panels[-1], times_s, moving, strict=True):
        top.set_title("moving" if framed else "", fontsize=8, pad=4)
        bottom.set_xlabel(f"{time * 1e6:.2f}", fontsize=8)
    figure.supxlabel("time (µs)", fontsize=9)
    return figure


def _draw_image(axes: Axes, image: NDArray[Any]) -> None:
    axes.imshow(image, cmap="gray", vmin=0, vmax=1, interpolation="none")
    axes.set(xticks=[], yticks=[])
