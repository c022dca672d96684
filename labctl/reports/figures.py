"""Figures of results: built without global state, saved as PNG and SVG with the same bytes every time."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from labctl.reports.axes import Level, Series, draw_series, label_curves, legend_below, place_legend, window_axis
from labctl.reports.envelope import reduced
from labctl.reports.style import GREY, SHADE, STYLE, look

PIXELS_PER_INCH = 150


@dataclass(frozen=True)
class Curve:
    """Accuracy against acquisition time.

    Attributes:
        label: Name in the legend.
        windows_s: (k,) acquisition times T_N, s.
        mean: (k,) mean accuracy, 0..1.
        sd: (k,) its standard deviation.
        tag: Short name to write beside the curve; empty = the label, where all labels are short.
    """

    label: str
    windows_s: Sequence[float]
    mean: Sequence[float]
    sd: Sequence[float]
    tag: str = ""


@dataclass(frozen=True)
class Claim:
    """A statement to draw: accuracy above `accuracy` (0..1) for acquisition times of at least `window_s`."""

    text: str
    window_s: float
    accuracy: float


PAPER_CLAIM = Claim("paper: > 90 % for $T_N$ ≥ 0.4 ns", 0.4e-9, 0.9)


def accuracy_figure(
    curves: Sequence[Curve],
    *,
    tau_s: float,
    chance: float,
    claim: Claim | None = PAPER_CLAIM,
    levels: Sequence[Level] = (),
    lowest: float | None = None,
    pixels: int = 28 * 28,
) -> Figure:
    """Accuracy against acquisition time, with one standard deviation and a second axis C = N / pixels.

    Args:
        curves: One or more curves; the tick marks stand at the windows of the first.
        tau_s: Sampling interval, s, that turns acquisition time into samples N.
        chance: Accuracy of guessing, 0..1.
        claim: Statement to mark; None = nothing.
        levels: Accuracies (0..1) to compare with that do not depend on the acquisition time, such as raw pixels.
        lowest: Accuracy (0..1) at which the vertical axis starts; None = at `chance`.
        pixels: Pixels of an image.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.4), layout="constrained")
        axes = figure.add_subplot()
        axes.grid(visible=True, axis="y")
        series = [Series(one.label, one.windows_s, one.mean, one.sd, one.tag).scaled(1e9, 100) for one in curves]
        window_axis(axes, [one.windows_s for one in curves], tau_s=tau_s, pixels=pixels)
        draw_series(axes, series, highest=100)
        if claim is not None:
            _draw_claim(axes, claim, last_ns=axes.get_xlim()[1])
        axes.set_ylim(100 * (chance if lowest is None else lowest), 101)
        axes.set_ylabel("accuracy (%), mean ± sd")
        label_curves(axes, series, [Level(level.label, 100 * level.value) for level in levels])
        place_legend(figure, axes)
    return figure


def _draw_claim(axes: Axes, claim: Claim, *, last_ns: float) -> None:
    start_ns, percent = claim.window_s * 1e9, 100 * claim.accuracy
    corner = [start_ns, start_ns, last_ns], [101, percent, percent]
    axes.plot(*corner, color=GREY, linestyle="--", linewidth=1, zorder=1, label=claim.text)


def confusion_figure(panels: Sequence[tuple[str, ArrayLike]], classes: Sequence[str]) -> Figure:
    """Confusion matrices side by side: true class by row, predicted class by column, colour = share of the row.

    Args:
        panels: Title and counts (k, k) of each matrix.
        classes: (k,) names.
    """
    with mpl.rc_context(STYLE):
        side = 0.52 * len(classes) + 0.8
        long = max(map(len, classes)) > 4
        figure = Figure(figsize=(side * len(panels) + 0.9, side + 0.5), layout="constrained")
        row = [figure.add_subplot(1, len(panels), position + 1) for position in range(len(panels))]
        for axes, (title, counts) in zip(row, panels, strict=True):
            table = np.asarray(counts, np.float64)
            shares = 100 * table / np.maximum(table.sum(axis=1, keepdims=True), 1)
            image = axes.imshow(shares, cmap="Blues", vmin=0, vmax=100)
            for (true, predicted), share in np.ndenumerate(shares):
                colour = "white" if share > 55 else "black"
                axes.text(predicted, true, f"{share:.1f}", ha="center", va="center", color=colour, fontsize=8)
            axes.set_title(title)
            axes.set_xticks(range(len(classes)), classes, rotation=45 if long else 0, ha="right" if long else "center")
            axes.set_yticks(range(len(classes)), classes if axes is row[0] else [""] * len(classes))
            axes.tick_params(length=0)
            axes.spines[:].set_visible(False)
            axes.set_xlabel("predicted class")
        row[0].set_ylabel("true class")
        figure.colorbar(image, ax=row, label="share of the true class (%)", fraction=0.05)
    return figure


def traces_figure(
    time_s: ArrayLike, volts: NDArray[Any], *, shots: Sequence[str], ports: Sequence[str], window_s: float | None = None
) -> Figure:
    """Traces of a few shots, one panel a port, all shots in each.

    Args:
        time_s: (samples,) s.
        volts: (shots, ports, samples) V.
        shots: Name of each shot (its class).
        ports: Name of each port.
        window_s: Acquisition time to mark from time 0 on, s; None = no mark.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 1.1 * len(ports) + 0.9), layout="constrained")
        stack = np.atleast_1d(figure.subplots(len(ports), 1, sharex=True))
        time_ns = np.asarray(time_s) * 1e9
        for axes, port, traces in zip(stack, ports, np.swapaxes(volts, 0, 1), strict=True):
            if window_s is not None:
                axes.axvspan(0, window_s * 1e9, color=SHADE, linewidth=0)
            for position, trace in enumerate(traces):
                style = look(position)
                axes.plot(*reduced(time_ns, trace), color=style.colour, linestyle=style.dashes, linewidth=1.2)
            axes.set_title(port, loc="left", fontsize=8, pad=2)
            axes.locator_params(axis="y", nbins=3)
        stack[-1].set_xlabel("time (ns)")
        stack[-1].set_xlim(time_ns[0], time_ns[-1])
        figure.supylabel("signal (V)", fontsize=9)
        handles: list[Artist] = list(stack[0].lines)
        names = list(shots)
        if window_s is not None:
            handles.append(stack[0].patches[0])
            names.append(f"$T_N$ = {window_s * 1e9:g} ns")
        legend_below(figure, handles, names)
    return figure


def images_figure(images: NDArray[Any], titles: Sequence[str], *, columns: int = 8) -> Figure:
    """Example images (n, rows, columns) with a title each, bright pixels white."""
    with mpl.rc_context(STYLE):
        rows = -(-len(images) // columns)
        across = min(columns, len(images))
        figure = Figure(figsize=(0.8 * across + 0.2, 1.0 * rows + 0.2), layout="constrained")
        for position, (image, title) in enumerate(zip(images, titles, strict=True)):
            axes = figure.add_subplot(rows, across, position + 1)
            axes.imshow(image, cmap="gray", interpolation="none")
            axes.set_title(title, fontsize=8, pad=3)
            axes.set_axis_off()
    return figure


def save_figure(figure: Figure, stem: Path) -> tuple[Path, Path]:
    """Save as `<stem>.png` and `<stem>.svg` (text as text, no date); returns both paths. The layout is final then."""
    png, svg = save_png(figure, stem), stem.with_name(stem.name + ".svg")
    with mpl.rc_context(STYLE):
        FigureCanvasSVG(figure).print_figure(svg, metadata={"Date": None, "Creator": None})
    return png, svg


def save_png(figure: Figure, stem: Path) -> Path:
    """Save as `<stem>.png` and return its path. The layout is final then."""
    png = stem.with_name(stem.name + ".png")
    with mpl.rc_context(STYLE):
        _settle(figure)
        FigureCanvasAgg(figure).print_figure(png, dpi=PIXELS_PER_INCH, metadata={"Software": None})
    return png


def _settle(figure: Figure) -> None:
    """Lay the figure out once and round its positions.

    The last digits of matplotlib's layout solver depend on where its objects lie in memory, and the names of the clip
    paths in an SVG on those digits.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        left, bottom, width, height = np.round(axes.get_position(original=True).bounds, 6)
        axes.set_position((left, bottom, width, height))
    for text in figure.texts:
        x, y = text.get_position()
        text.set_position((round(x, 6), round(y, 6)))
