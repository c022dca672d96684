"""A figure of a sweep: accuracy against what was varied."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

from labctl.reports.canvas import Level, Series, draw_series, label_curves, panel, place_legend, styled


@styled
def sweep_figure(curves: Sequence[Series], *, axis: str, ticks: Sequence[str] | None, chance: float | None) -> Figure:
    """Accuracy against an axis of a sweep, with its interval.

    Args:
        curves: x = positions on the axis, in its unit; mean of the accuracy, 0..1, and its interval.
        axis: What was varied, with its unit.
        ticks: Texts at positions 0, 1, 2, ... where values are no numbers.
        chance: Accuracy of guessing, 0..1, which is marked; None where it is not the same at all points.
    """
    figure, axes = panel(height=4.2)
    drawn = [one.scaled(1, 100) for one in curves]
    draw_series(axes, drawn, highest=100)
    if ticks is not None:
        axes.xaxis.set_major_locator(FixedLocator(list(range(len(ticks)))))
        axes.xaxis.set_major_formatter(FixedFormatter(ticks))
        axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel(axis)
    axes.set_ylabel("accuracy (%), 95 % interval")
    axes.set_ylim(0, 101)
    label_curves(axes, drawn, [] if chance is None else [Level("chance", 100 * chance)])
    place_legend(figure, axes)
    return figure
