"""The figure of what a result rests on: accuracy against each of several parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from labctl.reports.canvas import BLUE, GREY, VERMILLION, Level, number_ticks, styled

PANEL_CHARACTERS = 34
"""So many fit below a small panel."""


@dataclass(frozen=True)
class Sensitivity:
    """Accuracy against one parameter, all others at their defaults.

    Attributes:
        name: Name of the parameter, with its unit in brackets.
        values: (k,) its values.
        mean: (k,) mean accuracy, 0..1.
        spread: (k,) how far that is uncertain, or scatters.
        marked: The value that is marked, such as the one that all experiments use.
        logarithmic: Whether the values are spaced by factors.
    """

    name: str
    values: Sequence[float]
    mean: Sequence[float]
    spread: Sequence[float]
    marked: float
    logarithmic: bool = False


@styled
def sensitivity_figure(
    panels: Sequence[Sensitivity],
    *,
    mark: str = "default",
    spread: str = "sd",
    title: str | None = None,
    required: Level | None = None,
) -> Figure:
    """Accuracy against each of several parameters: small panels with a common vertical axis.

    Args:
        panels: One for each parameter.
        mark: What the marked value is.
        spread: What the bars are.
        title: What is common to all panels.
        required: Accuracy (0..1) to compare with; None = none.
    """
    rows = -(-len(panels) // 3)
    figure = Figure(figsize=(7.6, 2.3 * rows + 0.5))
    grid = figure.subplots(rows, min(3, len(panels)), sharey=True, squeeze=False)
    for axes, panel in zip(grid.flat, panels, strict=False):
        mean, bar = 100 * np.asarray(panel.mean), 100 * np.nan_to_num(panel.spread)
        if panel.logarithmic:
            axes.set_xscale("log")
            number_ticks(axes.xaxis, LogLocator(subs=(1, 2, 5)))
        axes.axvline(panel.marked, color=VERMILLION, linewidth=1.1, linestyle="--", label=mark)
        if required is not None:
            axes.axhline(100 * required.value, color=GREY, linewidth=1, linestyle=":", label=required.label)
        bars = {"color": BLUE, "marker": "o", "markersize": 4, "linewidth": 1.2, "capsize": 2.5}
        axes.errorbar(panel.values, mean, np.minimum([bar, bar], [bar, 100 - mean]), label=f"mean ± {spread}", **bars)
        axes.set_xlabel(fill(panel.name, PANEL_CHARACTERS))
        axes.grid(visible=True, axis="y")
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes in grid[:, 0]:
        axes.set_ylabel("accuracy (%)")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, title=title)
    return figure
