"""The figure of a prediction: the series that was to be predicted, what was predicted, and the difference."""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from labctl.reports.canvas import BLACK, BLUE, GREY, VERMILLION, Level, styled, thinned


@styled
def prediction_figure(target: ArrayLike, predicted: ArrayLike, *, nmse: float, first_step: int, paper: Level) -> Figure:
    """Target and prediction against the step, with the error below.

    Args:
        target: (steps,) series that was to be predicted, in the unit of its data set; some hundred steps can be read.
        predicted: (steps,) prediction, likewise.
        nmse: Mean squared error over the variance of the target, of the whole test.
        first_step: Number of the first step.
        paper: NMSE in the paper, written next to this one.
    """
    figure = Figure(figsize=(6.4, 3.6))
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    target, predicted = np.asarray(target, np.float64), np.asarray(predicted, np.float64)
    steps = np.arange(first_step, first_step + target.size)
    above.plot(*thinned(steps, target), color=BLACK, linewidth=1.3, label="target")
    drawn = {"color": VERMILLION, "linewidth": 1.1, "linestyle": (0, (4, 1.5)), "marker": "o", "markersize": 2.2}
    above.plot(*thinned(steps, predicted), label="prediction", **drawn)
    above.set_ylabel("series")
    above.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    above.set_title(f"NMSE = {nmse:.3g}  ({paper.label}: {paper.value:g})", loc="right", fontsize=9)
    below.axhline(0, color=GREY, linewidth=0.6)
    below.plot(*thinned(steps, predicted - target), color=BLUE, linewidth=1)
    below.set_ylabel("error")
    below.set_xlabel("step $n$")
    below.set_xlim(steps[0], steps[-1])
    figure.align_ylabels()
    return figure
