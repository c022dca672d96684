"""The figure of receiver operating characteristics: what is found against what is taken for it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.reports.canvas import GREY, legend_below, look, styled

CORNER = (0.2, 0.8)
"""Largest false and smallest true positive rate of the magnified corner."""


@dataclass(frozen=True)
class RocCurve:
    """How one score separates abnormal from normal images.

    Attributes:
        label: Name of the score.
        false_positive: (k,) share of normal images taken for abnormal, 0..1.
        true_positive: (k,) share of abnormal images found, 0..1.
        auc: Area under the curve, mean.
        auc_sd: Its standard deviation; None = a single one.
    """

    label: str
    false_positive: Sequence[float] | NDArray[np.float64]
    true_positive: Sequence[float] | NDArray[np.float64]
    auc: float
    auc_sd: float | None = None


@styled
def roc_figure(curves: Sequence[RocCurve], *, paper: float | None = None) -> Figure:
    """True against false positive rate, as a whole and magnified in the corner that matters; areas in the legend.

    Args:
        curves: One for each score.
        paper: Area under the curve that the paper reports; None = not stated.
    """
    figure = Figure(figsize=(7.2, 4.0))
    whole, corner = figure.subplots(1, 2)
    for position, curve in enumerate(curves):
        style = look(position)
        false, true = 100 * np.asarray(curve.false_positive), 100 * np.asarray(curve.true_positive)
        spread = "" if curve.auc_sd is None else f" ± {curve.auc_sd:.3f}"
        label = f"{curve.label}: AUC {curve.auc:.3f}{spread}"
        for axes, every in ((whole, 0.12), (corner, 0.1)):
            axes.plot(
                false,
                true,
                color=style.colour,
                linestyle=style.dashes,
                marker=style.marker,
                markevery=(0.02 * position, every),
                markersize=4,
                linewidth=1.4,
                label=label,
            )
    whole.plot([0, 100], [0, 100], color=GREY, linewidth=0.8, linestyle=":", label="guessing: AUC 0.500")
    whole.set(xlim=(-1, 101), ylim=(-1, 101), aspect="equal", title="whole")
    corner.set(xlim=(0, 100 * CORNER[0]), ylim=(100 * CORNER[1], 100.4), box_aspect=1, title="upper left corner")
    for axes in (whole, corner):
        axes.set_xlabel("false positive rate (%)")
        axes.set_ylabel("true positive rate (%)")
        axes.grid(visible=True)
    title = None if paper is None else f"paper: AUC {paper:.3f}"
    legend_below(figure, *whole.get_legend_handles_labels(), title=title)
    return figure
