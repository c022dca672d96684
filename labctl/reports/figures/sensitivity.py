"""The figure of what a result rests on: accuracy against each of several parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from labctl.reports.canvas import BLUE, GREY, VERMILLION, number_ticks, styled

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


@styled
def sensitivity_figure(panels: Sequence[Sensitivity], *, window_s: float, required: float | None = None) -> Figure:
    """Accuracy at one acquisition time against each of several parameters: small panels with a common vertical axis.

    Args:
        panels: One for each parameter.
        window_s: Acquisition time, s.
        required: Accuracy (0..1) to mark; None = none.
    """
    rows = -(-len(panels) // 3)
    figure = Figure(figsize=(7.6, 2.3 * rows + 0.5))
    grid = figure.subplots(rows, min(3, len(panels)), sharey=True, squeeze=False)
    for axes, panel in zip(grid.flat, panels, strict=False):
        mean, sd = 100 * np.asarray(panel.mean), 100 * np.nan_to_num(panel.sd)
        if panel.logarithmic:
            axes.set_xscale("log")
            number_ticks(axes.xaxis, LogLocator(subs=(1, 2, 5)))
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
    title = f"acquisition time {window_s * 1e9:g} ns"
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, title=title)
    return figure
