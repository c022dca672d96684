"""The figure of traces: what the oscilloscope saw of a few shots on every port."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from labctl.reports.canvas import legend_below, look, styled, thinned


@styled
def traces_figure(time_s: ArrayLike, volts: NDArray[Any], *, shots: Sequence[str], ports: Sequence[str]) -> Figure:
    """Traces of a few shots, one panel a port, all shots in each.

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
            axes.plot(*thinned(time_ns, trace), color=style.colour, linestyle=style.dashes, linewidth=1.2)
        axes.set_title(port, loc="left", fontsize=8, pad=2)
        axes.locator_params(axis="y", nbins=3)
    stack[-1].set_xlabel("time (ns)")
    stack[-1].set_xlim(time_ns[0], time_ns[-1])
    figure.supylabel("signal (V)", fontsize=9)
    legend_below(figure, list(stack[0].lines), shots)
    return figure
