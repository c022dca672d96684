"""The figure of lying bars: values to compare with each other, such as the errors of readouts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from labctl.reports.canvas import GREY, PALETTE, Level, styled

HATCHES = ("", "////", "\\\\\\\\", "xxxx", "----", "||||", "++++")


@dataclass(frozen=True)
class Bar:
    """One value with its spread, such as the error of a readout."""

    label: str
    mean: float
    sd: float


@dataclass(frozen=True)
class Bars:
    """Bars to compare with each other, such as all readouts on one data set, and values to compare them with."""

    title: str
    bars: Sequence[Bar]
    levels: Sequence[Level] = ()


@styled
def bars_figure(groups: Sequence[Bars]) -> Figure:
    """Lying bars of errors with their values, a panel for each group, and lines for the values to compare with.

    Args:
        groups: Root mean squared errors of pixels of 0..1; one panel each, all with the same horizontal axis.
    """
    lengths = [len(group.bars) for group in groups]
    figure = Figure(figsize=(6.4, 0.34 * sum(lengths) + 0.62 * len(groups) + 0.5))
    stack = np.atleast_1d(figure.subplots(len(groups), 1, sharex=True, height_ratios=[n + 0.6 for n in lengths]))
    ends = [bar.mean + np.nan_to_num(bar.sd) for group in groups for bar in group.bars]
    last = 1.2 * max(*ends, *(level.value for group in groups for level in group.levels))
    for axes, group in zip(stack, groups, strict=True):
        for position, bar in enumerate(group.bars):
            sd = float(np.nan_to_num(bar.sd))
            axes.barh(
                position,
                bar.mean,
                xerr=sd or None,
                height=0.68,
                color="white",
                edgecolor=PALETTE[position % len(PALETTE)],
                hatch=HATCHES[position % len(HATCHES)],
                capsize=2.5,
            )
            words = f"{bar.mean:.3f}" + (f" ± {sd:.3f}" if sd else "")
            clear = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
            axes.text(bar.mean + sd + 0.012 * last, position, words, va="center", fontsize=8, bbox=clear)
        for level, dashes in zip(group.levels, ("--", ":", "-."), strict=False):
            label = f"{level.label} {level.value:g}"
            axes.axvline(level.value, color=GREY, linestyle=dashes, linewidth=1.1, label=label)
        axes.set_yticks(range(len(group.bars)), [bar.label for bar in group.bars])
        axes.set_ylim(len(group.bars) - 0.5, -0.5)
        axes.set_title(group.title, loc="left", fontsize=9)
        if group.levels:
            axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, fontsize=8, borderpad=0.1)
    stack[-1].set_xlim(0, last)
    stack[-1].set_xlabel("RMSE of pixels (0 to 1), mean ± sd")
    return figure
