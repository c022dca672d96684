"""Figures against the number of output ports: accuracy, and the error of a prediction."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator

from labctl.reports.canvas import (
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


@styled
def port_accuracy_figure(curves: Sequence[Series], *, chance: float, levels: Sequence[Level] = ()) -> Figure:
    """Accuracy against the number of ports M.

    Args:
        curves: x = M, mean and sd of the accuracy, 0..1.
        chance: Accuracy of guessing, 0..1; the axis starts below it.
        levels: Accuracies (0..1) to compare with, such as a baseline on the raw data.
    """
    figure, axes = panel()
    drawn = [one.scaled(1, 100) for one in curves]
    draw_series(axes, drawn, highest=100)
    _port_axis(axes)
    label_accuracies(figure, axes, drawn, chance=chance, levels=levels)
    return figure


@styled
def port_error_figure(curves: Sequence[Series], *, levels: Sequence[Level] = ()) -> Figure:
    """Normalised mean squared error, on a logarithmic axis labelled at 1, 2 and 5, against the number of ports M.

    Args:
        curves: x = M, mean and sd of the error.
        levels: Errors to compare with.
    """
    figure, axes = panel()
    draw_series(axes, curves)
    _port_axis(axes)
    axes.set_ylabel("NMSE, mean ± sd")
    axes.set_yscale("log")
    means = [*(value for one in curves for value in one.mean), *(level.value for level in levels)]
    low, high = min(means) / 1.4, 1.3 * max([*means, *(one.top for one in curves)])
    axes.set_ylim(low, high)
    marks = [digit * 10.0**power for power in range(-9, 4) for digit in (1, 2, 5)]
    number_ticks(axes.yaxis, FixedLocator([mark for mark in marks if low <= mark <= high]))
    label_curves(axes, curves, levels)
    place_legend(figure, axes, inside="upper right")
    return figure


def _port_axis(axes: Axes) -> None:
    axes.set_xlabel("number of output ports $M$")
    axes.xaxis.set_major_locator(MaxNLocator(14, integer=True))
