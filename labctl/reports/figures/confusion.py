"""The figure of confusion matrices: which class is taken for which."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from labctl.reports.canvas import styled


@styled
def confusion_figure(panels: Sequence[tuple[str, ArrayLike]], classes: Sequence[str]) -> Figure:
    """Confusion matrices side by side: true class by row, predicted class by column, colour = share of the row.

    Args:
        panels: Title and counts (k, k) of each matrix.
        classes: (k,) names.
    """
    side = 0.52 * len(classes) + 0.8
    long = max(map(len, classes)) > 4
    figure = Figure(figsize=(side * len(panels) + 0.9, side + 0.5))
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
