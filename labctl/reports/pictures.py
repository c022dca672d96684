"""Figures of images: rows of originals and what was made of them, and bars of their errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.reports.axes import Level
from labctl.reports.style import GREY, PALETTE, STYLE

HATCHES = ("", "////", "\\\\\\\\", "xxxx", "----", "||||", "++++")


@dataclass(frozen=True)
class ImageRow:
    """A row of images of one kind.

    Attributes:
        label: What they are, such as "original" or "network, RMSE 0.18"; a line break is kept.
        images: (n, rows, columns) pixels of 0..1; values outside are drawn as 0 or 1.
        notes: (n,) a short text below each image; empty = none.
    """

    label: str
    images: NDArray[Any]
    notes: Sequence[str] = ()


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


def image_rows_figure(rows: Sequence[ImageRow], *, titles: Sequence[str] = ()) -> Figure:
    """Images in rows, one below the other: originals, binarised images, reconstructions of the same samples.

    Args:
        rows: The rows, all of the same length.
        titles: (n,) title of each column, such as the class; empty = none.
    """
    with mpl.rc_context(STYLE):
        across = len(rows[0].images)
        noted = any(row.notes for row in rows)
        height = (0.92 if noted else 0.78) * len(rows) + (0.4 if titles else 0.2)
        longest = max(len(line) for row in rows for line in row.label.split("\n"))
        figure = Figure(figsize=(0.76 * across + 0.3 + 0.075 * longest, height), layout="constrained")
        panels = figure.subplots(len(rows), across, squeeze=False)
        for line, row in zip(panels, rows, strict=True):
            for axes, image in zip(line, row.images, strict=True):
                axes.imshow(image, cmap="gray", vmin=0, vmax=1, interpolation="none")
                axes.set(xticks=[], yticks=[])
                axes.spines[:].set(visible=True, color="#BFBFBF", linewidth=0.5)
            for axes, note in zip(line, row.notes, strict=False):
                axes.set_xlabel(note, fontsize=7, labelpad=2)
            line[0].set_ylabel(row.label, rotation=0, ha="right", va="center")
        for axes, title in zip(panels[0], titles, strict=False):
            axes.set_title(title, fontsize=8, pad=3)
    return figure


def bars_figure(groups: Sequence[Bars], *, quantity: str = "RMSE of pixels (0 to 1), mean ± sd") -> Figure:
    """Lying bars with their values, a panel for each group, and lines for the values to compare with.

    Args:
        groups: One panel each, all with the same horizontal axis.
        quantity: What the bars show, with its unit.
    """
    with mpl.rc_context(STYLE):
        lengths = [len(group.bars) for group in groups]
        figure = Figure(figsize=(6.4, 0.34 * sum(lengths) + 0.62 * len(groups) + 0.5), layout="constrained")
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
        stack[-1].set_xlabel(quantity)
    return figure
