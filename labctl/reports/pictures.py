"""Figures as PNG for a screen; simulated ones are marked so."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.axis import XAxis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from PIL import Image

from labctl.reports.canvas import BLACK, PURPLE, styled
from labctl.runs.format.origin import Origin

PIXELS_PER_INCH = 150
STRIP = 0.27
"""Height of the strip for the mark, inches."""
MARKS = {Origin.SIMULATED: "simulated bench", Origin.MIXED: "partly simulated bench", Origin.REPLAYED: "recording"}


def save_png(figure: Figure, path: Path, origin: Origin) -> None:
    """Save for a screen alone; otherwise as `labctl.reports.figure_files.save_figure` does."""
    picture = png_of(figure, origin)
    path.unlink(missing_ok=True)  # it may lead somewhere else
    path.write_bytes(picture)


@styled
def png_of(figure: Figure, origin: Origin) -> bytes:
    """The bytes of a PNG, as `save_figure` writes it; the figure is used up."""
    marked(figure, origin)
    image = BytesIO()
    print_png(figure, image)
    return image.getvalue()


def join_pictures(parts: Sequence[Path], out: Path) -> None:
    """Put pictures (PNG) below each other into one, on white; it appears complete or not at all."""
    pictures = [Image.open(part).convert("RGB") for part in parts]
    page = Image.new("RGB", (max(one.width for one in pictures), sum(one.height for one in pictures)), "white")
    top = 0
    for one in pictures:
        page.paste(one, (0, top))
        top += one.height
    partial = out.with_name(out.name + ".partial")
    partial.unlink(missing_ok=True)  # it may lead somewhere else
    page.save(partial, "PNG")
    partial.replace(out)


def marked(figure: Figure, origin: Origin) -> float:
    """Lay a figure out for a screen under its mark; returns which part of the height that leaves to the rest."""
    own = _mark(figure, origin)
    lay_out(figure, figure.get_figwidth(), own)
    return own


def _mark(figure: Figure, origin: Origin) -> float:
    """Say in a strip on top that the records are simulated; returns which part of the height is left to the rest."""
    if origin not in MARKS:
        return 1.0
    height = figure.get_figheight()
    figure.set_figheight(height + STRIP)
    text = figure.text(0.99, 1 - 0.08 / (height + STRIP), MARKS[origin], ha="right", va="top", color=BLACK)
    text.set(fontsize=8, in_layout=False)
    text.set_bbox({"boxstyle": "square,pad=0.3", "facecolor": PURPLE, "linewidth": 0})
    return height / (height + STRIP)


def lay_out(figure: Figure, width: float, own: float) -> None:
    """Lay a figure out once for `width` (inches), in the lower part `own` of its height, and round its positions.

    The last digits of matplotlib's layout solver depend on where its objects lie in memory, and the names of the clip
    paths in an SVG on those digits.
    """
    figure.set_figwidth(width)
    for axes in figure.axes:
        axes.set_in_layout(True)
    layout = ConstrainedLayoutEngine(rect=(0, 0, 1, own))
    figure.set_layout_engine(layout)
    layout.execute(figure)
    _thin_numbers(figure)
    figure.set_layout_engine("none")
    for axes in figure.axes:
        left, bottom, width, height = np.round(axes.get_position(original=True).bounds, 6)
        axes.set_position((left, bottom, width, height))
    for text in figure.texts:
        x, y = text.get_position()
        text.set_position((round(x, 6), round(y, 6)))


def _thin_numbers(figure: Figure) -> None:
    """Leave out numbers at horizontal axes that would touch the one before."""
    for axis in figure.findobj(XAxis):
        end = -np.inf
        for label in axis.get_ticklabels():
            box = label.get_window_extent()
            label.set_visible(box.x0 > end + 3)
            end = box.x1 if label.get_visible() else end


def print_png(figure: Figure, file: Path | BytesIO) -> None:
    """Write a figure that is `marked` as PNG, without a date."""
    dpi, figure.dpi = figure.dpi, PIXELS_PER_INCH
    FigureCanvasAgg(figure).print_png(file, metadata={"Software": None})  # print_figure would draw twice
    figure.dpi = dpi
