"""Figures of results: built without global state, saved as PNG and SVG with the same bytes every time.

Colours are those of Okabe and Ito (Color Universal Design, 2008), which readers with colour-vision deficiencies can
tell apart; curves differ in marker as well.
"""

from collections.abc import Callable, Sequence
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
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator
from numpy.typing import ArrayLike, NDArray

BLUE, VERMILLION, GREEN, ORANGE, SKY, PURPLE, BLACK = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#E69F00",
    "#56B4E9",
    "#CC79A7",
    "#000000",
)
PALETTE = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY, BLACK)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
GREY = "#595959"
PIXELS_PER_INCH = 150
STYLE: dict[Any, object] = {
    "axes.axisbelow": True,
    "axes.grid": False,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": "medium",
    "figure.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "grid.color": "#D9D9D9",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "path.simplify": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "labctl",
}


@dataclass(frozen=True)
class Curve:
    """Accuracy against acquisition time.

    Attributes:
        label: Name in the legend.
        windows_s: (k,) acquisition times T_N, s.
        mean: (k,) mean accuracy, 0..1.
        sd: (k,) its standard deviation.
    """

    label: str
    windows_s: Sequence[float]
    mean: Sequence[float]
    sd: Sequence[float]


@dataclass(frozen=True)
class Claim:
    """A statement to draw: accuracy above `accuracy` (0..1) for acquisition times of at least `window_s`."""

    text: str
    window_s: float
    accuracy: float


PAPER_CLAIM = Claim("paper: > 90 % for $T_N$ ≥ 0.4 ns", 0.4e-9, 0.9)


def accuracy_figure(
    curves: Sequence[Curve], *, tau_s: float, chance: float, claim: Claim | None = PAPER_CLAIM, pixels: int = 28 * 28
) -> Figure:
    """Accuracy against acquisition time, with bands of one standard deviation and a second axis C = N / pixels.

    Args:
        curves: One or more curves; the tick marks stand at the windows of the first.
        tau_s: Sampling interval, s, that turns acquisition time into samples N.
        chance: Accuracy of guessing, 0..1; the vertical axis starts there.
        claim: Statement to mark; None = nothing.
        pixels: Pixels of an image.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.4), layout="constrained")
        axes = figure.add_subplot()
        axes.set_xscale("log")
        axes.grid(visible=True, axis="y")
        for position, curve in enumerate(curves):
            _draw_curve(axes, curve, PALETTE[position % len(PALETTE)], MARKERS[position % len(MARKERS)])
        windows_ns = [window * 1e9 for window in curves[0].windows_s]
        if claim is not None:
            _draw_claim(axes, claim, last_ns=windows_ns[-1])
        axes.set_xlim(windows_ns[0] / 1.12, windows_ns[-1] * 1.12)
        axes.set_ylim(100 * chance, 101)
        axes.xaxis.set_major_locator(FixedLocator(windows_ns))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlabel("acquisition time $T_N$ (ns)")
        axes.set_ylabel("accuracy (%), mean ± sd")
        axes.legend(loc="lower right")
        percent_per_ns = 100 * 1e-9 / tau_s / pixels
        ratio = axes.secondary_xaxis("top", functions=(_times(percent_per_ns), _times(1 / percent_per_ns)))
        ratio.xaxis.set_major_locator(FixedLocator([window * percent_per_ns for window in windows_ns]))
        ratio.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.2f}"))
        ratio.xaxis.set_minor_formatter(NullFormatter())
        ratio.xaxis.set_minor_locator(NullLocator())
        ratio.set_xlabel(f"compressive ratio $C = N$ / {pixels} (%)")
    return figure


def _times(factor: float) -> Callable[[ArrayLike], NDArray[np.float64]]:
    return lambda values: factor * np.asarray(values, np.float64)


def _draw_curve(axes: Axes, curve: Curve, colour: str, marker: str) -> None:
    windows_ns = np.asarray(curve.windows_s) * 1e9
    mean, sd = 100 * np.asarray(curve.mean), 100 * np.asarray(curve.sd)
    axes.fill_between(windows_ns, mean - sd, np.minimum(mean + sd, 100), color=colour, alpha=0.18, linewidth=0)
    axes.plot(windows_ns, mean, color=colour, marker=marker, markersize=4.5, linewidth=1.6, label=curve.label)


def _draw_claim(axes: Axes, claim: Claim, *, last_ns: float) -> None:
    start_ns, percent = claim.window_s * 1e9, 100 * claim.accuracy
    axes.plot([start_ns, last_ns * 1.12], [percent, percent], color=GREY, linestyle="--", linewidth=1.1, zorder=1)
    axes.plot([start_ns, start_ns], [percent, 101], color=GREY, linestyle="--", linewidth=1.1, zorder=1)
    axes.annotate(
        claim.text,
        (start_ns, percent),
        xytext=(-5, 22),
        textcoords="offset points",
        ha="right",
        va="bottom",
        color=GREY,
    )


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
                axes.axvspan(0, window_s * 1e9, color="#E8E8E8", linewidth=0)
            for position, trace in enumerate(traces):
                axes.plot(time_ns, trace, color=PALETTE[position % len(PALETTE)], linewidth=1.2)
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
        figure.legend(handles, names, loc="outside upper center", ncols=min(len(names), 6))
    return figure


def images_figure(images: NDArray[Any], titles: Sequence[str], *, columns: int = 8) -> Figure:
    """Example images (n, rows, columns) with a title each, bright pixels white."""
    with mpl.rc_context(STYLE):
        rows = -(-len(images) // columns)
        across = min(columns, len(images))
        figure = Figure(figsize=(0.8 * across + 0.2, 1.0 * rows + 0.2), layout="constrained")
        for position, (image, title) in enumerate(zip(images, titles, strict=True)):
            axes = figure.add_subplot(rows, across, position + 1)
            axes.imshow(image, cmap="gray", interpolation="nearest")
            axes.set_title(title, fontsize=8, pad=3)
            axes.set_axis_off()
    return figure


def save_figure(figure: Figure, stem: Path) -> tuple[Path, Path]:
    """Save as `<stem>.png` and `<stem>.svg` (text as text, no date); returns both paths."""
    png, svg = stem.with_name(stem.name + ".png"), stem.with_name(stem.name + ".svg")
    with mpl.rc_context(STYLE):
        FigureCanvasAgg(figure).print_figure(png, dpi=PIXELS_PER_INCH, metadata={"Software": None})
        FigureCanvasSVG(figure).print_figure(svg, metadata={"Date": None, "Creator": None})
    return png, svg
