"""What figures share: curves with their spread, labels beside curves, the axis of acquisition times, legends."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator
from numpy.typing import ArrayLike, NDArray

from labctl.reports.style import GREY, look

MOST_BANDS = 3
"""More curves than this carry error bars: bands lying on each other cannot be read."""
LONGEST_TAG = 14
"""Where no label is longer than so many characters, labels are written beside their curves as they are."""
GAP = 0.055
"""Least distance of labels beside a panel, in panel heights."""


@dataclass(frozen=True)
class Series:
    """A quantity with its spread against another.

    Attributes:
        label: Name in the legend.
        x: (k,) positions, in the unit that the figure function asks for.
        mean: (k,) mean of the quantity.
        sd: (k,) its standard deviation; 0 or NaN = nothing is drawn for it.
        tag: Short name to write beside the curve; empty = the label, where all labels are short.
        joined: False draws points alone: a few single results, not a dependence.
        alike: Position of the curve whose colour and marker these points take; None = their own.
    """

    label: str
    x: Sequence[float]
    mean: Sequence[float]
    sd: Sequence[float]
    tag: str = ""
    joined: bool = True
    alike: int | None = None

    def scaled(self, x: float, y: float) -> "Series":
        """The same series in other units: positions times `x`, quantity times `y`."""
        return replace(
            self,
            x=[x * value for value in self.x],
            mean=[y * value for value in self.mean],
            sd=[y * value for value in self.sd],
        )


@dataclass(frozen=True)
class Level:
    """A value to compare with, drawn as a line across the panel, such as a baseline that does not depend on x."""

    label: str
    value: float


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
        x, mean, sd = (np.asarray(values, np.float64) for values in (one.x, one.mean, np.nan_to_num(one.sd)))
        spread = np.any(sd > 0)
        upper = np.minimum(mean + sd, np.maximum(highest, mean))
        if spread and bands and one.joined:
            axes.fill_between(x, mean - sd, upper, color=style.colour, alpha=0.18, linewidth=0)
        elif spread:
            axes.vlines(x, mean - sd, upper, color=style.colour, linewidth=0.9)
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
    """Draw `levels`; write short names of them and of the curves in the right margin. The limits are final."""
    last = axes.get_xlim()[1]
    ends: list[tuple[float, float, str, str]] = []
    curves = [one for one in series if one.joined]
    short = len(curves) > 1 and all(len(one.label) <= LONGEST_TAG for one in curves)
    for position, one in enumerate(series):
        tag = one.tag or (one.label if short and one.joined else "")
        if tag:
            ends.append((one.x[-1], one.mean[-1], tag, look(position).colour))
    for level in levels:
        axes.axhline(level.value, color=GREY, linewidth=1, linestyle=(0, (1, 1.2)), zorder=1)
        ends.append((last, level.value, level.label, GREY))
    write_beside(axes, ends)


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
    for _ in range(100):  # neighbours push each other apart until all stand clear; each round halves what is missing
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


def window_axis(axes: Axes, windows_s: Sequence[Sequence[float]], *, tau_s: float, pixels: int) -> None:
    """Acquisition time on a logarithmic axis (ns) below, compressive ratio C = N / pixels (%) above.

    Args:
        axes: Panel, drawn against time in ns.
        windows_s: Increasing acquisition times of each curve, s. The axis holds them all; tick marks stand at those of
            the first curve, except where they are too close to be read.
        tau_s: Sampling interval that turns acquisition time into samples N, s.
        pixels: Pixels of an image.
    """
    marks = _readable([window * 1e9 for window in windows_s[0]])
    axes.set_xscale("log")
    axes.set_xlim(1e9 * min(map(min, windows_s)) / 1.12, 1e9 * max(map(max, windows_s)) * 1.12)
    axes.xaxis.set_major_locator(FixedLocator(marks))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("acquisition time $T_N$ (ns)")
    percent_per_ns = 100 * 1e-9 / tau_s / pixels
    ratio = axes.secondary_xaxis("top", functions=(_times(percent_per_ns), _times(1 / percent_per_ns)))
    ratio.xaxis.set_major_locator(FixedLocator([mark * percent_per_ns for mark in marks]))
    ratio.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.2f}"))
    ratio.xaxis.set_minor_formatter(NullFormatter())
    ratio.xaxis.set_minor_locator(NullLocator())
    ratio.set_xlabel(f"compressive ratio $C = N$ / {pixels} (%)")


def _readable(values: Sequence[float]) -> list[float]:
    nearest = np.log(values[-1] / values[0]) / 18
    kept = [values[0]]
    for value in values[1:]:
        if np.log(value / kept[-1]) > nearest:
            kept.append(value)
    return kept


def _times(factor: float) -> Callable[[ArrayLike], NDArray[np.float64]]:
    return lambda values: factor * np.asarray(values, np.float64)


def place_legend(figure: Figure, axes: Axes, *, inside: Any = "lower right") -> None:
    """Legend of a panel: inside for up to four entries, below the figure for more."""
    handles, labels = axes.get_legend_handles_labels()
    if len(labels) <= 4:
        axes.legend(handles, labels, loc=inside, handlelength=3)
    else:
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
