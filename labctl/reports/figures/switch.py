"""The figure of a switch: a scene that changes while it is watched."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from labctl.reports.canvas import BLACK, SHADE, Look, legend_below, look, styled, write_beside

STRETCHES = 400
"""Most points of a curve: each is a stretch of windows."""


@styled
def switch_figure(
    time_s: ArrayLike,
    correlations: Mapping[str, ArrayLike],
    probabilities: NDArray[Any],
    classes: Sequence[str],
    *,
    transit_s: tuple[float, float],
    switch_s: float | None = None,
) -> Figure:
    """Short-time correlation and class probabilities against time; more windows than can be drawn show as bands.

    A line is the median of a stretch of windows, the band around it their full range.

    Args:
        time_s: (n,) start of each window, s.
        correlations: (n,) correlation with the reference of a class, by the name of the class.
        probabilities: (n, k) probability of each class.
        classes: (k,) names.
        transit_s: From when to when the mirrors move, s.
        switch_s: Time from which the new class stays the most probable, s; None = it never does.
    """
    figure = Figure(figsize=(6.4, 4.3))
    above, below = figure.subplots(2, 1, sharex=True)
    time_us = np.asarray(time_s) * 1e6
    start_us, stop_us = (1e6 * moment for moment in transit_s)
    for axes in (above, below):
        axes.axvspan(start_us, stop_us, color=SHADE, linewidth=0, label="mirrors move")
        if switch_s is not None:
            axes.axvline(switch_s * 1e6, color=BLACK, linewidth=1, linestyle=":", label="new class stays")
    looks = {name: look(position) for position, name in enumerate(classes)}
    _draw_windows(above, time_us, correlations, looks)
    _draw_windows(below, time_us, dict(zip(classes, probabilities.T, strict=True)), looks)
    above.set_ylabel("correlation")
    below.set_ylabel("probability")
    below.set_xlabel("time (µs)")
    if switch_s is not None:
        words = f"switch seen at {switch_s * 1e6:.2f} µs; mirrors move from {start_us:.2f} to {stop_us:.2f} µs"
        above.set_title(words, fontsize=9, loc="left")
    legend_below(figure, *below.get_legend_handles_labels())
    return figure


def _draw_windows(
    axes: Axes, time_us: NDArray[Any], curves: Mapping[str, ArrayLike], looks: Mapping[str, Look]
) -> None:
    ends = []
    for position, (name, values) in enumerate(curves.items()):
        style = looks[name]
        middle, low, median, high = envelope(time_us, values, stretches=STRETCHES)
        if middle.size < time_us.size:
            axes.fill_between(middle, low, high, color=style.colour, alpha=0.15, linewidth=0)
        axes.plot(
            middle,
            median,
            color=style.colour,
            linestyle=style.dashes,
            marker=style.marker,
            markevery=(position * middle.size // 60, max(1, middle.size // 15)),
            markersize=4,
            linewidth=1.2,
            label=name,
        )
        ends.append((float(time_us[-1]), float(np.median(median[-max(1, median.size // 20) :])), name, style.colour))
    axes.set_ylim(min(-0.03, axes.get_ylim()[0]), 1.03)
    axes.set_xlim(time_us[0], time_us[-1])
    write_beside(axes, ends, gap=0.11)


def envelope(x: ArrayLike, y: ArrayLike, *, stretches: int) -> NDArray[np.float64]:
    """Position, lowest, median and highest value of each of so many stretches, (4, k); (4, n) for shorter series."""
    x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
    if y.size <= stretches:
        return np.stack([x, y, y, y])
    edges = np.linspace(0, y.size, stretches + 1).astype(int)
    slices = [slice(first, last) for first, last in pairwise(edges)]
    return np.array([(x[s].mean(), y[s].min(), np.median(y[s]), y[s].max()) for s in slices]).T
