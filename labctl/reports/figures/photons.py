"""Figures against what a readout may cost: photons a sample, bits of a weight."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator

from labctl.reports.canvas import Level, Series, draw_series, label_accuracies, number_ticks, panel, styled


@styled
def photons_figure(curves: Sequence[Series], *, chance: float, levels: Sequence[Level] = ()) -> Figure:
    """Accuracy against mean photons a sample, on a logarithmic axis.

    Args:
        curves: x = photons a sample; mean and sd of the accuracy, 0..1.
        chance: Accuracy of guessing, 0..1; the axis starts below it.
        levels: Accuracies (0..1) to compare with.
    """
    figure, axes = panel(height=4.4)
    drawn = [one.scaled(1, 100) for one in curves]
    axes.set_xscale("log")
    draw_series(axes, drawn, highest=100)
    number_ticks(axes.xaxis, LogLocator())
    axes.set_xlabel("photons a sample (40 ps), mean over images and ports")
    label_accuracies(figure, axes, drawn, chance=chance, levels=levels)
    return figure


@styled
def bits_figure(curves: Sequence[Series], *, chance: float, levels: Sequence[Level] = ()) -> Figure:
    """Accuracy against the bits of a weight.

    Args:
        curves: x = bits; mean and sd of the accuracy, 0..1. The first gives the tick marks.
        chance: Accuracy of guessing, 0..1; the axis starts below it.
        levels: Accuracies (0..1) to compare with, such as that of weights without levels.
    """
    figure, axes = panel(height=4.4)
    drawn = [one.scaled(1, 100) for one in curves]
    draw_series(axes, drawn, highest=100)
    number_ticks(axes.xaxis, FixedLocator(list(curves[0].x)))
    axes.set_xlabel("resolution of an attenuator (bits)")
    label_accuracies(figure, axes, drawn, chance=chance, levels=levels)
    return figure
