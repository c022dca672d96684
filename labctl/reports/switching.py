"""Figures of a scene that changes while it is watched: correlation and class probabilities against time, film strip."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from labctl.reports.axes import legend_below, write_beside
from labctl.reports.envelope import envelope, volt_scale
from labctl.reports.style import BLACK, GREY, SHADE, STYLE, Look, look


def switching_figure(
    time_s: ArrayLike,
    correlations: Mapping[str, ArrayLike],
    probabilities: NDArray[Any],
    classes: Sequence[str],
    *,
    transit_s: tuple[float, float],
    switch_s: float | None = None,
    trace: tuple[ArrayLike, ArrayLike] | None = None,
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
        trace: Time (m,) in s and signal (m,) in V to draw on top; None = none.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.3 if trace is None else 5.4), layout="constrained")
        stack = figure.subplots(2 + (trace is not None), 1, sharex=True)
        time_us = np.asarray(time_s) * 1e6
        for axes in stack:
            axes.axvspan(transit_s[0] * 1e6, transit_s[1] * 1e6, color=SHADE, linewidth=0, label="mirrors move")
            if switch_s is not None:
                axes.axvline(switch_s * 1e6, color=BLACK, linewidth=1, linestyle=":", label="new class stays")
        if trace is not None:
            factor, unit = volt_scale(trace[1])
            middle, low, median, high = envelope(np.asarray(trace[0]) * 1e6, factor * np.asarray(trace[1]), bins=600)
            stack[0].fill_between(middle, low, high, color=GREY, alpha=0.45, linewidth=0)
            stack[0].plot(middle, median, color=BLACK, linewidth=0.7)
            stack[0].set_ylabel(f"signal ({unit})")
        looks = {name: look(position) for position, name in enumerate(classes)}
        _draw_windows(stack[-2], time_us, correlations, looks)
        _draw_windows(stack[-1], time_us, dict(zip(classes, probabilities.T, strict=True)), looks)
        stack[-2].set_ylabel("correlation")
        stack[-1].set_ylabel("probability")
        stack[-1].set_xlabel("time (µs)")
        if switch_s is not None:
            start_us, stop_us = (1e6 * moment for moment in transit_s)
            words = f"switch seen at {switch_s * 1e6:.2f} µs; mirrors move from {start_us:.2f} to {stop_us:.2f} µs"
            stack[0].set_title(words, fontsize=9, loc="left")
        handles, labels = stack[-1].get_legend_handles_labels()
        legend_below(figure, handles, labels)
    return figure


def _draw_windows(
    axes: Axes, time_us: NDArray[Any], curves: Mapping[str, ArrayLike], looks: Mapping[str, Look]
) -> None:
    ends = []
    for position, (name, values) in enumerate(curves.items()):
        style = looks[name]
        middle, low, median, high = envelope(time_us, values)
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


def filmstrip_figure(
    strips: Mapping[str, NDArray[Any]], times_s: Sequence[float], *, transit_s: tuple[float, float]
) -> Figure:
    """Images at several times, a row for each source; those taken while the mirrors move are framed.

    Args:
        strips: (n, rows, columns) images of 0..1 by the name of what made them, such as the network.
        times_s: (n,) start of the window of each image, s.
        transit_s: From when to when the mirrors move, s.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(0.78 * len(times_s) + 0.9, 0.86 * len(strips) + 0.6), layout="constrained")
        panels = figure.subplots(len(strips), len(times_s), squeeze=False)
        for row, (name, images) in zip(panels, strips.items(), strict=True):
            for axes, image, time in zip(row, images, times_s, strict=True):
                moving = transit_s[0] <= time <= transit_s[1]
                axes.imshow(image, cmap="gray", vmin=0, vmax=1, interpolation="none")
                axes.set(xticks=[], yticks=[])
                axes.spines[:].set(visible=moving, linewidth=2.2, color=look(1).colour, linestyle="-")
            row[0].set_ylabel(name, rotation=0, ha="right", va="center")
        for axes, time in zip(panels[0], times_s, strict=True):
            axes.set_title("moving" if transit_s[0] <= time <= transit_s[1] else "", fontsize=8, pad=4)
        for axes, time in zip(panels[-1], times_s, strict=True):
            axes.set_xlabel(f"{time * 1e6:.2f}", fontsize=8)
        figure.supxlabel("time (µs)", fontsize=9)
    return figure
