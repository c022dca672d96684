"""What figures are drawn with: style, panels, curves with their spread, labels and legends that do not collide.

Colours are those of Okabe and Ito (Color Universal Design, 2008), which readers with colour-vision deficiencies can
tell apart. Curves differ in marker and line style as well, so that a figure still reads when printed in grey.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Self

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import Locator, NullLocator, StrMethodFormatter
from numpy.typing import ArrayLike, NDArray

BLUE, VERMILLION, GREEN, ORANGE = "#0072B2", "#D55E00", "#009E73", "#E69F00"
SKY, PURPLE, BLACK = "#56B4E9", "#CC79A7", "#000000"
GREY, SHADE = "#595959", "#E3E3E3"
PALETTE = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY, BLACK)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (5, 1.5, 1, 1.5)),
    (0, (2, 1)),
    (0, (8, 2, 1, 2, 1, 2)),
    (0, (9, 2)),
    ":",
)
STYLE: dict[Any, object] = {
    "axes.axisbelow": True,
    "axes.grid": False,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": "medium",
    "axes.titley": 1.0,  # where it belongs: to look for room above the panel costs a quarter of a layout
    "figure.constrained_layout.use": True,
    "figure.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "grid.color": "#D9D9D9",
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.6,
    "legend.frameon": False,
    "path.simplify": False,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "labctl",
}
MOST_BANDS = 3
"""More curves than this carry error bars: bands lying on each other cannot be read."""
LONGEST_TAG = 14
"""Where no label is longer than so many characters, labels are written next to their curves as they are."""
GAP = 0.055
"""Least distance of labels next to a panel, in panel heights."""

styled = mpl.rc_context(STYLE)
"""Decorator of a function that draws: the style holds while it runs, and matplotlib's own settings stay as they are."""


@dataclass(frozen=True)
class Look:
    """Colour, marker and line style of the n-th curve of a panel."""

    colour: str
    marker: str
    dashes: Any


def look(position: int) -> Look:
    """The look of the curve at `position`; repeats after seven."""
    turn = position % len(PALETTE)
    return Look(PALETTE[turn], MARKERS[turn], DASHES[turn])


@dataclass(frozen=True)
class Series:
    """A quantity with its spread against another.

    Attributes:
        label: Name in the legend.
        x: (k,) positions, in the unit that the figure function expects.
        mean: (k,) mean of the quantity.
        sd: (k,) its standard deviation; 0 or NaN = nothing is drawn for it.
        tag: Short name to write next to the curve; empty = the label, where all labels are short.
        joined: False draws points alone: a few single results, not a dependence.
        alike: Position of the curve whose colour and marker these points take; None = their own.
        intervals: (k, 2) ends of the spread where it is not `sd` to either side; empty = it is.
    """

    label: str
    x: Sequence[float]
    mean: Sequence[float]
    sd: Sequence[float]
    tag: str = ""
    joined: bool = True
    alike: int | None = None
    intervals: Sequence[tuple[float, float]] = ()

    @classmethod
    def of(cls, label: str, results: Mapping[Any, Mapping[str, float]], *, unit: float = 1.0, **drawn: Any) -> Self:
        """Results `{"mean", "sd"}` by their position in multiples of `unit`, a number or its text."""
        means, sds = ([result[name] for result in results.values()] for name in ("mean", "sd"))
        return cls(label, [float(position) * unit for position in results], means, sds, **drawn)

    @classmethod
    def with_intervals(cls, label: str, results: Mapping[Any, Mapping[str, Any]], *, unit: float = 1.0) -> Self:
        """The same of `{"mean", "low", "high"}`, with the interval as spread; None = no interval."""
        means = [one["mean"] for one in results.values()]
        return cls(
            label,
            [float(position) * unit for position in results],
            means,
            [0.0] * len(means),
            intervals=[
                (one["mean"], one["mean"]) if one["low"] is None else (one["low"], one["high"])
                for one in results.values()
            ],
        )

    @property
    def ends(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper end (k,) of the spread at every position."""
        if self.intervals:
            low, high = np.array(self.intervals, np.float64).T
            return low, high
        mean, sd = np.asarray(self.mean, np.float64), np.nan_to_num(np.asarray(self.sd, np.float64))
        return mean - sd, mean + sd

    @property
    def top(self) -> float:
        """The highest point of the curve with its spread."""
        return float(np.max(self.ends[1]))

    def scaled(self, x: float, y: float) -> Self:
        """The same series in other units: positions times `x`, quantity times `y`."""
        return replace(
            self,
            x=[x * value for value in self.x],
            mean=[y * value for value in self.mean],
            sd=[y * value for value in self.sd],
            intervals=[(y * low, y * high) for low, high in self.intervals],
        )


@dataclass(frozen=True)
class Level:
    """A value to compare with, drawn as a line across the panel, such as a baseline that does not depend on x."""

    label: str
    value: float


def panel(height: float = 4.0) -> tuple[Figure, Axes]:
    """A figure of one panel with horizontal grid lines, as wide as a page; `height` in inches."""
    figure = Figure(figsize=(6.4, height))
    axes = figure.add_subplot()
    axes.grid(visible=True, axis="y")
    return figure, axes


def number_ticks(axis: Axis, locator: Locator) -> None:
    """Plain numbers where `locator` puts tick marks and nothing between them, on logarithmic axes too."""
    axis.set_major_locator(locator)
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_locator(NullLocator())


def draw_series(axes: Axes, series: Sequence[Series], *, highest: float = np.inf) -> None:
    """Draw curves with their spread, in the panel's units; bands up to `MOST_BANDS` curves, error bars beyond.

    Args:
        axes: Panel to draw in.
        series: The curves, in the order of the legend.
        highest: Largest possible value: a spread is cut there.
    """
    bands = len(series) <= MOST_BANDS
    for position, one in enumerate(series):
        style = look(position if one.alike is None else one.alike)
        x, mean = (np.asarray(values, np.float64) for values in (one.x, one.mean))
        lower, upper = one.ends
        spread = np.any(upper > lower)
        upper = np.minimum(upper, np.maximum(highest, mean))
        if spread and bands and one.joined:
            axes.fill_between(x, lower, upper, color=style.colour, alpha=0.18, linewidth=0)
        elif spread:
            axes.vlines(x, lower, upper, color=style.colour, linewidth=0.9)
        axes.plot(
            x,
            mean,
            color=style.colour,
            marker=style.marker,
            markevery=max(1, x.size // 20),
            markersize=4.5 if one.joined else 7,
            markerfacecolor=style.colour if one.joined else "white",
            linestyle=style.dashes if one.joined else "none",
            linewidth=1.6,
            label=one.label,
        )


def label_curves(axes: Axes, series: Sequence[Series], levels: Sequence[Level] = ()) -> None:
    """Draw `levels`; write short names of them and of the curves in the right margin. The limits are final.

    A curve whose whole name stands there is not named in a legend again.
    """
    last = axes.get_xlim()[1]
    ends: list[tuple[float, float, str, str]] = []
    curves = [one for one in series if one.joined]
    short = len(curves) > 1 and all(len(one.label) <= LONGEST_TAG for one in curves)
    for position, one in enumerate(series):
        tag = one.tag or (one.label if short and one.joined else "")
        if tag:
            ends.append((one.x[-1], one.mean[-1], tag, look(position).colour))
        for line in axes.lines if tag == one.label else ():
            if line.get_label() == one.label:
                line.set_label("_beside")
    for level in levels:
        axes.axhline(level.value, color=GREY, linewidth=1, linestyle=(0, (1, 1.2)), zorder=1)
        ends.append((last, level.value, level.label, GREY))
    write_beside(axes, ends)


def label_accuracies(
    figure: Figure, axes: Axes, series: Sequence[Series], *, chance: float, levels: Sequence[Level]
) -> None:
    """Name what is drawn in a panel of accuracies: axis, curves, levels, legend.

    Args:
        figure: Figure of the panel.
        axes: Panel; its horizontal axis is final.
        series: Curves that were drawn, in per cent.
        chance: Accuracy of guessing, 0..1; the axis starts below it.
        levels: Accuracies (0..1) to compare with.
    """
    axes.set_ylabel("accuracy (%), mean ± sd")
    axes.set_ylim(max(100 * chance - 4, 0), 101)
    label_curves(axes, series, [replace(one, value=100 * one.value) for one in (*levels, Level("chance", chance))])
    place_legend(figure, axes)


def write_beside(axes: Axes, ends: Sequence[tuple[float, float, str, str]], *, gap: float = GAP) -> None:
    """Write texts in the right margin, each led to its point, none on another.

    Args:
        axes: Panel; its limits and scales are final.
        ends: x, y (data), text and colour of each.
        gap: Least distance of two texts, in panel heights.
    """
    to_panel = axes.transScale + axes.transLimits
    heights = [float(to_panel.transform((x, y))[1]) for x, y, _, _ in ends]
    for (x, y, text, colour), height in zip(ends, spread_out(heights, gap), strict=True):
        axes.annotate(
            text,
            (x, y),
            xytext=(1.03, height),
            textcoords="axes fraction",
            color=colour,
            fontsize=8,
            va="center",
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.6, "shrinkA": 1, "relpos": (0, 0.5)},
        )


def spread_out(heights: Sequence[float], gap: float) -> list[float]:
    """Heights of 0..1 moved apart to at least `gap` without changing their order, inside 0..1 where there is room."""
    order = np.argsort(heights, kind="stable")
    placed = np.clip(np.asarray(heights, np.float64)[order], 0, 1)
    for _ in range(100):  # neighbours push each other apart until all are clear; each round halves what is missing
        for lower in range(placed.size - 1):
            missing = gap - (placed[lower + 1] - placed[lower])
            if missing > 0:
                placed[lower] -= missing / 2
                placed[lower + 1] += missing / 2
        if placed.size and placed[-1] > 1:
            placed[-1] = 1
        if placed.size and placed[0] < 0:
            placed[0] = 0
    result = np.empty_like(placed)
    result[order] = placed
    return [float(height) for height in result]


def place_legend(figure: Figure, axes: Axes, *, inside: Any = "lower right") -> None:
    """Legend of a panel: inside for up to four entries, below the figure for more."""
    handles, labels = axes.get_legend_handles_labels()
    if 0 < len(labels) <= 4:
        on_white = {"frameon": True, "facecolor": "white", "edgecolor": "none", "framealpha": 0.85}
        axes.legend(handles, labels, loc=inside, handlelength=3, **on_white)
    elif labels:
        legend_below(figure, handles, labels)


def legend_below(figure: Figure, handles: Sequence[Any], labels: Sequence[str], *, title: str | None = None) -> None:
    """Legend below all panels, in as many columns as fit; the figure grows by its height."""
    for columns in range(len(labels), 0, -1):
        legend = figure.legend(handles, labels, loc="outside lower center", ncols=columns, handlelength=3, title=title)
        if legend.get_window_extent().width <= figure.bbox.width or columns == 1:
            rows = -(-len(labels) // columns) + (title is not None)
            figure.set_figheight(figure.get_figheight() + 0.2 * rows)
            return
        legend.remove()


def thinned(x: ArrayLike, y: ArrayLike, *, bins: int = 1000) -> tuple[NDArray[Any], NDArray[Any]]:
    """A record (n,) thinned to the first, the last, and the lowest and highest point of each of `bins` stretches.

    Every peak stays, and the file small. Records of at most 2 `bins` points come back as they are.
    """
    x, y = np.asarray(x), np.asarray(y)
    if y.size <= 2 * bins:
        return x, y
    kept = [0, y.size - 1]
    for first, last in pairwise(np.linspace(0, y.size, bins + 1).astype(int)):
        kept += [first + int(np.argmin(y[first:last])), first + int(np.argmax(y[first:last]))]
    positions = np.unique(kept)
    return x[positions], y[positions]


def volt_scale(volts: ArrayLike) -> tuple[float, str]:
    """Factor and unit in which signals (V) read well: V, or mV below 0.1 V."""
    return (1.0, "V") if float(np.nanmax(np.abs(volts))) >= 0.1 else (1e3, "mV")
