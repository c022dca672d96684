"""Figures against acquisition time: accuracy, and the error of reconstructed images."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator, StrMethodFormatter

from labctl.reports.canvas import (
    GREY,
    Level,
    Series,
    draw_series,
    label_accuracies,
    label_curves,
    number_ticks,
    panel,
    place_legend,
    styled,
)

PIXELS = 28 * 28
"""Of an image, for the compressive ratio."""


@dataclass(frozen=True)
class Claim:
    """A statement to draw: accuracy above `accuracy` (0..1) for acquisition times of at least `window_s`."""

    text: str
    window_s: float
    accuracy: float


PAPER_CLAIM = Claim("paper: > 90 % for $T_N$ ≥ 0.4 ns", 0.4e-9, 0.9)


@styled
def accuracy_figure(
    curves: Sequence[Series],
    *,
    tau_s: float,
    chance: float,
    claim: Claim | None = None,
    levels: Sequence[Level] = (),
) -> Figure:
    """Accuracy against acquisition time, with one standard deviation and a second axis C = N / pixels.

    Args:
        curves: x = acquisition times T_N, s; mean and sd of the accuracy, 0..1. The first gives the tick marks.
        tau_s: Sampling interval, s, that turns acquisition time into samples N.
        chance: Accuracy of guessing, 0..1; the axis starts below it.
        claim: Statement to mark; None = nothing.
        levels: Accuracies (0..1) to compare with that do not depend on the acquisition time, such as raw pixels.
    """
    figure, axes = panel(height=4.4)
    drawn = [one.scaled(1e9, 100) for one in curves]
    _window_axis(axes, curves, tau_s)
    draw_series(axes, drawn, highest=100)
    if claim is not None:
        start_ns, percent = claim.window_s * 1e9, 100 * claim.accuracy
        corner = [start_ns, start_ns, axes.get_xlim()[1]], [101, percent, percent]
        axes.plot(*corner, color=GREY, linestyle="--", linewidth=1, zorder=1, label=claim.text)
    label_accuracies(figure, axes, drawn, chance=chance, levels=levels)
    return figure


@styled
def rmse_figure(curves: Sequence[Series], *, tau_s: float, levels: Sequence[Level] = ()) -> Figure:
    """Error of reconstructed images against acquisition time, with the compressive ratio above.

    Args:
        curves: x = acquisition times, s; mean and sd of the root mean squared error of pixels of 0..1. The first curve
            gives the tick marks; single results (`joined=False`) are open symbols next to the curves.
        tau_s: Sampling interval, s.
        levels: Errors to compare with, such as that of the mean image.
    """
    figure, axes = panel(height=4.2)
    drawn = [one.scaled(1e9, 1) for one in curves]
    _window_axis(axes, curves, tau_s)
    draw_series(axes, drawn)
    axes.set_ylabel("RMSE of pixels (0 to 1), mean ± sd")
    lowest = min(min(one.mean) for one in drawn)
    highest = max([*(one.top for one in drawn), *(level.value for level in levels)])
    margin = max(highest - lowest, 0.1 * highest)
    axes.set_ylim(lowest - 0.15 * margin, highest + 0.06 * margin)
    label_curves(axes, drawn, levels)
    place_legend(figure, axes, inside="lower left")
    return figure


@styled
def interval_figure(curves: Sequence[Series], *, tau_s: float, quantity: str, levels: Sequence[Level] = ()) -> Figure:
    """Accuracies, or their differences, against acquisition time, as large as their intervals allow.

    Args:
        curves: x = acquisition times, s; mean of the quantity (-1..1), and its interval. The first curve gives the tick
            marks.
        tau_s: Sampling interval, s.
        quantity: What it is, with its unit: per cent or points.
        levels: Values (-1..1) to compare with.
    """
    figure, axes = panel(height=4.2)
    drawn = [one.scaled(1e9, 100) for one in curves]
    compared = [replace(level, value=100 * level.value) for level in levels]
    _window_axis(axes, curves, tau_s)
    draw_series(axes, drawn)
    axes.set_ylabel(f"{quantity}, 95 % interval")
    highest = max([*(one.top for one in drawn), *(level.value for level in compared)])
    lowest = min([*(float(np.min(one.ends[0])) for one in drawn), *(level.value for level in compared)])
    margin = 0.08 * max(highest - lowest, 1)
    axes.set_ylim(lowest - margin, highest + margin)
    label_curves(axes, drawn, compared)
    place_legend(figure, axes)
    return figure


def _window_axis(axes: Axes, curves: Sequence[Series], tau_s: float) -> None:
    """Acquisition time on a logarithmic axis (ns) below, compressive ratio C = N / pixels (%) above.

    The axis holds all curves; tick marks are at the windows of the first, except where they are too close to be read.
    """
    marks = _readable([window * 1e9 for window in curves[0].x])
    axes.set_xscale("log")
    axes.set_xlim(1e9 * min(min(one.x) for one in curves) / 1.12, 1e9 * max(max(one.x) for one in curves) * 1.12)
    number_ticks(axes.xaxis, FixedLocator(marks))
    axes.set_xlabel("acquisition time $T_N$ (ns)")
    percent_per_ns = 100 * 1e-9 / tau_s / PIXELS
    ratio = axes.secondary_xaxis(
        "top", functions=(partial(np.multiply, percent_per_ns), partial(np.multiply, 1 / percent_per_ns))
    )
    ratio.xaxis.set_major_locator(FixedLocator([mark * percent_per_ns for mark in marks]))
    ratio.xaxis.set_major_formatter(StrMethodFormatter("{x:.2f}"))
    ratio.xaxis.set_minor_formatter(NullFormatter())
    ratio.xaxis.set_minor_locator(NullLocator())
    ratio.set_xlabel(f"compressive ratio $C = N$ / {PIXELS} (%)")


def _readable(values: Sequence[float]) -> list[float]:
    nearest = np.log(values[-1] / values[0]) / 18
    kept = [values[0]]
    for value in values[1:]:
        if np.log(value / kept[-1]) > nearest:
            kept.append(value)
    return kept
