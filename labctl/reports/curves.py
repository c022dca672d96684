"""Figures of one quantity against one setting: ports, acquisition time, training images, twin parameters, detuning."""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullLocator
from numpy.typing import ArrayLike

from labctl.reports.axes import Level, Series, draw_series, label_curves, place_legend, window_axis
from labctl.reports.style import BLUE, GREY, STYLE, VERMILLION

PANEL_CHARACTERS = 34
"""So many fit below a small panel."""


@dataclass(frozen=True)
class Sensitivity:
    """Accuracy against one parameter, all others at their defaults.

    Attributes:
        name: Name of the parameter, with its unit in brackets.
        values: (k,) its values.
        mean: (k,) mean accuracy, 0..1.
        sd: (k,) its standard deviation.
        default: The value that all experiments use.
        logarithmic: Whether the values are spaced by factors.
    """

    name: str
    values: Sequence[float]
    mean: Sequence[float]
    sd: Sequence[float]
    default: float
    logarithmic: bool = False


def ports_figure(
    curves: Sequence[Series],
    *,
    quantity: Literal["accuracy", "nmse"],
    levels: Sequence[Level] = (),
    chance: float = 0.0,
) -> Figure:
    """Accuracy, or normalised mean squared error on a logarithmic axis, against the number of ports M.

    Args:
        curves: x = M, mean and sd of the accuracy (0..1) or of the NMSE.
        quantity: Which of the two.
        levels: Values to compare with, such as a baseline on the raw data.
        chance: Accuracy of guessing, 0..1; the axis starts there.
    """
    with mpl.rc_context(STYLE):
        figure, axes = _panel()
        factor = 100.0 if quantity == "accuracy" else 1.0
        drawn = [one.scaled(1, factor) for one in curves]
        lines = [Level(level.label, factor * level.value) for level in levels]
        draw_series(axes, drawn, highest=100 if quantity == "accuracy" else np.inf)
        axes.set_xlabel("number of output ports $M$")
        axes.xaxis.set_major_locator(MaxNLocator(14, integer=True))
        if quantity == "accuracy":
            axes.set_ylabel("accuracy (%), mean ± sd")
            axes.set_ylim(100 * chance, 101)
        else:
            axes.set_ylabel("NMSE, mean ± sd")
            _logarithmic(axes, drawn, lines)
        label_curves(axes, drawn, lines)
        place_legend(figure, axes, inside="lower right" if quantity == "accuracy" else "upper right")
    return figure


def rmse_window_figure(
    curves: Sequence[Series], *, tau_s: float, levels: Sequence[Level] = (), pixels: int = 28 * 28
) -> Figure:
    """Error of reconstructed images against acquisition time, with the compressive ratio above.

    Args:
        curves: x = acquisition times, s; mean and sd of the root mean squared error of pixels of 0..1. The first curve
            gives the tick marks; single results (`joined=False`) stand as open symbols beside the curves.
        tau_s: Sampling interval, s.
        levels: Errors to compare with, such as that of the mean image.
        pixels: Pixels of an image.
    """
    with mpl.rc_context(STYLE):
        figure, axes = _panel(height=4.2)
        drawn = [one.scaled(1e9, 1) for one in curves]
        window_axis(axes, [one.x for one in curves], tau_s=tau_s, pixels=pixels)
        draw_series(axes, drawn)
        axes.set_ylabel("RMSE of pixels (0 to 1), mean ± sd")
        lowest = min(min(one.mean) for one in drawn)
        highest = max([*_tops(drawn), *(level.value for level in levels)])
        margin = max(highest - lowest, 0.1 * highest)
        axes.set_ylim(lowest - 0.15 * margin, highest + 0.06 * margin)
        label_curves(axes, drawn, levels)
        place_legend(figure, axes, inside="lower left")
    return figure


def learning_figure(curves: Sequence[Series], *, chance: float, levels: Sequence[Level] = ()) -> Figure:
    """Accuracy against the number of training images on a logarithmic axis.

    Args:
        curves: x = number of training images; mean and sd of the accuracy, 0..1.
        chance: Accuracy of guessing, 0..1; the axis starts there.
        levels: Accuracies (0..1) to compare with.
    """
    with mpl.rc_context(STYLE):
        figure, axes = _panel()
        drawn = [one.scaled(1, 100) for one in curves]
        axes.set_xscale("log")
        draw_series(axes, drawn, highest=100)
        axes.xaxis.set_major_locator(FixedLocator(list(curves[0].x)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlabel("number of training images")
        axes.set_ylabel("accuracy (%), mean ± sd")
        axes.set_ylim(100 * chance, 101)
        label_curves(axes, drawn, [Level(level.label, 100 * level.value) for level in levels])
        place_legend(figure, axes)
    return figure


def sensitivity_figure(panels: Sequence[Sensitivity], *, window_s: float, required: float | None = None) -> Figure:
    """Accuracy at one acquisition time against each of several parameters: small panels with a common vertical axis.

    Args:
        panels: One for each parameter.
        window_s: Acquisition time, s.
        required: Accuracy (0..1) to mark; None = none.
    """
    with mpl.rc_context(STYLE):
        rows = -(-len(panels) // 3)
        figure = Figure(figsize=(7.6, 2.3 * rows + 0.5), layout="constrained")
        grid = figure.subplots(rows, min(3, len(panels)), sharey=True, squeeze=False)
        for axes, panel in zip(grid.flat, panels, strict=False):
            mean, sd = 100 * np.asarray(panel.mean), 100 * np.nan_to_num(panel.sd)
            if panel.logarithmic:
                axes.set_xscale("log")
                axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
                axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                axes.xaxis.set_minor_locator(NullLocator())
            axes.axvline(panel.default, color=VERMILLION, linewidth=1.1, linestyle="--", label="default")
            if required is not None:
                axes.axhline(100 * required, color=GREY, linewidth=1, linestyle=":", label="must reach")
            bars = {"color": BLUE, "marker": "o", "markersize": 4, "linewidth": 1.2, "capsize": 2.5}
            axes.errorbar(panel.values, mean, np.minimum([sd, sd], [sd, 100 - mean]), label="mean ± sd", **bars)
            axes.set_xlabel(fill(panel.name, PANEL_CHARACTERS))
            axes.grid(visible=True, axis="y")
        for axes in grid.flat[len(panels) :]:
            axes.set_visible(False)
        for axes in grid[:, 0]:
            axes.set_ylabel("accuracy (%)")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside upper center", ncols=3, title=f"acquisition time {window_s * 1e9:g} ns"
        )
    return figure


def decorrelation_figure(
    detuning_nm: ArrayLike,
    curves: Sequence[tuple[str, ArrayLike]],
    *,
    half_width_nm: float,
    bound_nm: float | None = None,
) -> Figure:
    """Correlation of the speckle, or of traces, with those at zero detuning, its half width marked.

    Args:
        detuning_nm: (k,) change of wavelength, nm; drawn in pm where small.
        curves: Label and correlation (k,) of each curve; measured first.
        half_width_nm: Detuning at which the first curve falls to one half, nm.
        bound_nm: Largest half width that was stated elsewhere, nm; None = none.
    """
    with mpl.rc_context(STYLE):
        figure, axes = _panel(height=3.6)
        nm = np.asarray(detuning_nm, np.float64)
        factor, unit = (1e3, "pm") if np.max(np.abs(nm)) < 0.5 else (1.0, "nm")
        series = [
            Series(label, list(factor * nm), list(np.asarray(one, np.float64)), [0] * nm.size) for label, one in curves
        ]
        draw_series(axes, series)
        axes.axhline(0, color=GREY, linewidth=0.6)
        half = factor * half_width_nm
        axes.plot([half, half], [0, 0.5], color=GREY, linestyle="--", linewidth=1)
        axes.plot([min(0.0, factor * float(nm.min())), half], [0.5, 0.5], color=GREY, linestyle="--", linewidth=1)
        clear = {"facecolor": "white", "edgecolor": "none", "pad": 1}
        axes.text(half + 0.02 * np.ptp(axes.get_xlim()), 0.53, f"half width {half:.3g} {unit}", color=GREY, bbox=clear)
        if bound_nm is not None:
            bound = factor * bound_nm
            axes.axvline(bound, color=GREY, linestyle=":", linewidth=1.2, label=f"paper: below {bound:g} {unit}")
        axes.set_xlabel(f"detuning ({unit})")
        axes.set_ylabel("correlation (1 = same)")
        axes.set_ylim(min(-0.05, float(min(np.min(one.mean) for one in series)) * 1.1), 1.05)
        place_legend(figure, axes, inside="upper right")
    return figure


def _panel(height: float = 4.0) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(6.4, height), layout="constrained")
    axes = figure.add_subplot()
    axes.grid(visible=True, axis="y")
    return figure, axes


def _tops(series: Sequence[Series]) -> list[float]:
    return [float(np.max(np.asarray(one.mean) + np.nan_to_num(one.sd))) for one in series]


def _logarithmic(axes: Axes, series: Sequence[Series], levels: Sequence[Level]) -> None:
    """A logarithmic vertical axis that holds all means and levels, labelled at 1, 2 and 5."""
    means = [*(value for one in series for value in one.mean), *(level.value for level in levels)]
    axes.set_yscale("log")
    low, high = min(means) / 1.4, 1.3 * max(means + _tops(series))
    axes.set_ylim(low, high)
    marks = [digit * 10.0**power for power in range(-9, 4) for digit in (1, 2, 5)]
    axes.yaxis.set_major_locator(FixedLocator([mark for mark in marks if low <= mark <= high]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
