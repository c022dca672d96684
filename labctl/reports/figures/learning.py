"""The figure of a learning curve: accuracy against the number of training images."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

from labctl.reports.canvas import (
    Level,
    Series,
    draw_series,
    label_accuracies,
    number_ticks,
    panel,
    styled,
)


@styled
def learning_figure(curve: Series, *, chance: float, levels: Sequence[Level] = ()) -> Figure:
    """Accuracy against the number of training images on a logarithmic axis.

    Args:
        curve: x = number of training images; mean and sd of the accuracy, 0..1.
        chance: Accuracy of guessing, 0..1; the axis starts below it.
        levels: Accuracies (0..1) to compare with.
    """
    figure, axes = panel()
    drawn = [curve.scaled(1, 100)]
    axes.set_xscale("log")
    draw_series(axes, drawn, highest=100)
    number_ticks(axes.xaxis, FixedLocator(list(curve.x)))
    axes.set_xlabel("number of training images")
    label_accuracies(figure, axes, drawn, chance=chance, levels=levels)
    return figure
