"""Figures as files: PNG and SVG for a screen, PDF at the width of a journal's column; simulated ones are marked so."""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_pdf import Op, PdfFile, RendererPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from PIL import Image

from labctl.reports.canvas import BLACK, PURPLE, styled
from labctl.runs.format.origin import Origin

PIXELS_PER_INCH = 150
POINTS_PER_INCH = 72
COLUMN, PAGE = 86 / 25.4, 178 / 25.4
"""Widths of a PDF, inches: one column of a journal, and both."""
REDUCED = 7 / 9
"""Text that is laid out with 9 points is printed in a column with 7."""
NARROWEST = 6.4
"""Figures across both columns are laid out for at least this width, inches."""
LEAST_PANEL = 0.5
"""A panel that is a smaller part of its figure's width has no place in one column."""
STRIP = 0.27
"""Height of the strip for the mark, inches."""
MARKS = {Origin.SIMULATED: "simulated bench", Origin.PARTLY_SIMULATED: "partly simulated bench"}


@dataclass(frozen=True)
class Pictures:
    """The files of a figure."""

    png: Path
    svg: Path
    pdf: Path


@styled
def save_figure(figure: Figure, stem: Path, origin: Origin) -> Pictures:
    """Save as `<stem>.png`, `.svg` (text as text) and `.pdf` (one or two columns wide, fonts inside), without dates.

    Args:
        figure: It is used up: laid out anew for print.
        stem: Path without suffix.
        origin: Of the records that it shows; what is simulated, wholly or in part, is marked in the figure.
    """
    own = _mark(figure, origin)
    _lay_out(figure, figure.get_figwidth(), own)
    pictures = Pictures(*(stem.with_name(f"{stem.name}.{kind}") for kind in ("png", "svg", "pdf")))
    for path in (pictures.png, pictures.svg, pictures.pdf):
        path.unlink(missing_ok=True)  # it may lead somewhere else
    FigureCanvasAgg(figure).print_figure(pictures.png, dpi=PIXELS_PER_INCH, metadata={"Software": None})
    FigureCanvasSVG(figure).print_figure(pictures.svg, metadata={"Date": None, "Creator": None})
    _print(figure, _column(figure, own), pictures.pdf)
    return pictures


@styled
def png_of(figure: Figure, origin: Origin, *, dpi: float = PIXELS_PER_INCH) -> bytes:
    """A figure as PNG that is shown and not kept, marked as in `save_figure`; it is used up."""
    _lay_out(figure, figure.get_figwidth(), _mark(figure, origin))
    data = BytesIO()
    FigureCanvasAgg(figure).print_figure(data, dpi=dpi, metadata={"Software": None})
    return data.getvalue()


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


def _mark(figure: Figure, origin: Origin) -> float:
    """Say in a strip on top that the records are simulated; returns which part of the height is left to the rest."""
    if origin not in MARKS:
        return 1.0
    height = figure.get_figheight()
    figure.set_figheight(height + STRIP)
    text = figure.text(0.99, 1 - 0.08 / (height + STRIP), MARKS[origin], ha="right", va="top", color=BLACK)
    text.set(fontsize=8, fontweight="bold", in_layout=False)
    text.set_bbox({"boxstyle": "square,pad=0.3", "facecolor": PURPLE, "linewidth": 0})
    return height / (height + STRIP)


def _lay_out(figure: Figure, width: float, own: float) -> None:
    """Lay a figure out once for `width` (inches), in the lower part `own` of its height, and round its positions.

    The last digits of matplotlib's layout solver depend on where its objects lie in memory, and the names of the clip
    paths in an SVG on those digits.
    """
    figure.set_figwidth(width)
    for axes in figure.axes:
        axes.set_in_layout(True)
    figure.set_layout_engine("constrained", rect=(0, 0, 1, own))
    figure.draw_without_rendering()
    _thin_numbers(figure)
    figure.set_layout_engine("none")
    for axes in figure.axes:
        left, bottom, width, height = np.round(axes.get_position(original=True).bounds, 6)
        axes.set_position((left, bottom, width, height))
    for text in figure.texts:
        x, y = text.get_position()
        text.set_position((round(x, 6), round(y, 6)))


def _column(figure: Figure, own: float) -> float:
    """Lay a figure out for one column if it fits there, otherwise for two; returns the width to print at, inches."""
    natural, narrow = figure.get_figwidth(), COLUMN / REDUCED
    panels = [axes for axes in figure.axes if axes.get_visible()]
    if natural <= narrow or len(panels) == 1:
        _lay_out(figure, narrow, own)
        if natural <= narrow or _fits(figure, panels[0]):
            return COLUMN
    if figure.get_figwidth() < NARROWEST:
        _lay_out(figure, max(natural, NARROWEST), own)
    return PAGE


def _fits(figure: Figure, panel: Axes) -> bool:
    """Whether nothing is cut off, and the panel is wide enough to be read."""
    drawn, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    inside = min(drawn.x0, drawn.y0) > -0.01 and drawn.x1 < width + 0.01 and drawn.y1 < height + 0.01
    legend = panel.get_legend()
    clear = legend is None or legend.get_window_extent().width < 0.95 * panel.get_window_extent().width
    return bool(inside and clear and panel.get_position().width > LEAST_PANEL)


def _thin_numbers(figure: Figure) -> None:
    """Leave out numbers at horizontal axes that would touch the one before."""
    for axis in figure.findobj(XAxis):
        end = -np.inf
        for label in axis.get_ticklabels():
            box = label.get_window_extent()
            label.set_visible(box.x0 > end + 3)
            end = box.x1 if label.get_visible() else end


def _print(figure: Figure, width: float, path: Path) -> None:
    """Write a PDF of this width, inches: the figure as it is laid out, made smaller or larger as a whole."""
    across, up = figure.get_size_inches()
    scale = width / across
    dpi, figure.dpi = PIXELS_PER_INCH / scale, POINTS_PER_INCH
    file = PdfFile(path, metadata={"CreationDate": None, "Creator": None, "Producer": None})
    try:
        file.newPage(width, up * scale)
        file.width, file.height = across, up  # what lies outside is left out
        file.output(scale, 0, 0, scale, 0, 0, Op.concat_matrix)
        renderer = MixedModeRenderer(figure, across, up, dpi, RendererPdf(file, dpi, up, across))
        figure.draw(renderer)  # type: ignore[arg-type]  # it hands every call on to one
        renderer.finalize()
        file.finalize()
    finally:
        file.close()
