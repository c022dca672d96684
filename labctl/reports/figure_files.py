"""Figures as files: PNG and SVG for a screen, PDF at the width of a journal's column; simulated ones are marked so."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fontTools import subset
from fontTools.ttLib import TTFont
from matplotlib.axes import Axes
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_pdf import Op, PdfFile, RendererPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from labctl.reports.canvas import styled
from labctl.reports.pictures import PIXELS_PER_INCH, lay_out, marked, print_png
from labctl.runs.format.origin import Origin

POINTS_PER_INCH = 72
COLUMN, PAGE = 86 / 25.4, 178 / 25.4
"""Widths of a PDF, inches: one column of a journal, and both."""
REDUCED = 7 / 9
"""Text that is laid out with 9 points is printed in a column with 7."""
NARROWEST = 6.4
"""Figures across both columns are laid out for at least this width, inches."""
OF_NO_USE = ("GDEF", "GPOS", "GSUB", "OS/2", "cmap", "gasp", "kern", "name", "post")
"""Of a font, what chooses, places or describes glyphs: a PDF names each by its number (ISO 32000-1, 9.9)."""
LEAST_PANEL = 0.5
"""A panel that is a smaller part of its figure's width has no place in one column."""


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
    own = marked(figure, origin)
    pictures = Pictures(*(stem.with_name(f"{stem.name}.{kind}") for kind in ("png", "svg", "pdf")))
    for path in (pictures.png, pictures.svg, pictures.pdf):
        path.unlink(missing_ok=True)  # it may lead somewhere else
    print_png(figure, pictures.png)
    FigureCanvasSVG(figure).print_svg(pictures.svg, metadata={"Date": None, "Creator": None})  # as print_png
    _print(figure, _column(figure, own), pictures.pdf)
    return pictures


def _column(figure: Figure, own: float) -> float:
    """Lay a figure out for one column if it fits there, otherwise for two; returns the width to print at, inches."""
    natural, narrow = figure.get_figwidth(), COLUMN / REDUCED
    panels = [axes for axes in figure.axes if axes.get_visible()]
    if natural <= narrow or len(panels) == 1:
        lay_out(figure, narrow, own)
        if natural <= narrow or _fits(figure, panels[0]):
            return COLUMN
    if figure.get_figwidth() < NARROWEST:
        lay_out(figure, max(natural, NARROWEST), own)
    return PAGE


def _fits(figure: Figure, panel: Axes) -> bool:
    """Whether nothing is cut off, and the panel is wide enough to be read."""
    drawn, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    inside = min(drawn.x0, drawn.y0) > -0.01 and drawn.x1 < width + 0.01 and drawn.y1 < height + 0.01
    legend = panel.get_legend()
    clear = legend is None or legend.get_window_extent().width < 0.95 * panel.get_window_extent().width
    return bool(inside and clear and panel.get_position().width > LEAST_PANEL)


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
        with _glyphs_alone():
            file.finalize()
    finally:
        file.close()


@contextmanager
def _glyphs_alone() -> Iterator[None]:
    """Fonts are embedded without what is `OF_NO_USE`, which most of the time goes into: it would be made smaller too.

    matplotlib has no setting for it, and lets fontTools load the fonts.
    """
    load = subset.load_font

    def load_glyphs(*what: Any, **how: Any) -> TTFont:
        font = load(*what, **how)
        for table in set(OF_NO_USE) & set(font.keys()):
            del font[table]
        return font

    subset.load_font = load_glyphs
    try:
        yield
    finally:
        subset.load_font = load
