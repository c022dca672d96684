"""The figure of traces: what the oscilloscope saw of a few shots on every port."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from labctl.reports.canvas import legend_below, look, styled, thinned

FLATTENS = 2.0
"""A trace that swings so many times wider than all others is cut, so that these can be seen."""
MARGIN = 0.05


@styled
def traces_figure(time_s: ArrayLike, volts: NDArray[Any], *, shots: Sequence[str], ports: Sequence[str]) -> Figure:
    """Traces of a few shots, one panel a port, all shots in each; one that would flatten the others is cut, and named.

    Args:
        time_s: (samples,) s.
        volts: (shots, ports, samples) V.
        shots: Name of each shot (its class).
        ports: Name of each port.
    """
    figure = Figure(figsize=(6.4, 1.1 * len(ports) + 0.9))
    stack = np.atleast_1d(figure.subplots(len(ports), 1, sharex=True))
    time_ns = np.asarray(time_s) * 1e9
    for axes, port, traces in zip(stack, ports, np.swapaxes(volts, 0, 1), strict=True):
        for position, trace in enumerate(traces):
            style = look(position)
            line = {"color": style.colour, "linestyle": style.dashes, "linewidth": 1.2}
            axes.plot(*thinned(time_ns, trace), marker="" if len(trace) > 1 else style.marker, **line)
        title = port
        if (cut := _flattening(traces)) is not None:
            others = np.delete(traces, cut, axis=0)
            low, high = others.min(), others.max()
            axes.set_ylim(low - MARGIN * (high - low), high + MARGIN * (high - low))
            title = f"{port}; {shots[cut]} is cut, {traces[cut].min():.2g} to {traces[cut].max():.2g} V"
        axes.set_title(title, loc="left", fontsize=8, pad=2)
        axes.locator_params(axis="y", nbins=3)
    stack[-1].set_xlabel("time (ns)")
    if len(time_ns) > 1:
        stack[-1].set_xlim(time_ns[0], time_ns[-1])
    figure.supylabel("signal (V)", fontsize=9)
    legend_below(figure, list(stack[0].lines), shots)
    return figure


def _flattening(traces: NDArray[Any]) -> int | None:
    """The trace, of (shots, samples), beside which the others would be flat; None where there is none."""
    if len(traces) < 3:
        return None
    swings = np.abs(traces - np.median(traces)).max(axis=1)
    first, second = np.argsort(swings)[[-1, -2]]
    return int(first) if swings[first] > FLATTENS * swings[second] else None
