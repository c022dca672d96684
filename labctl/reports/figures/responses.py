"""The figure of responses: a series and what the chip makes of it on each port."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from labctl.reports.canvas import BLACK, BLUE, styled, thinned, volt_scale


@styled
def responses_figure(time_s: ArrayLike, inputs: ArrayLike, volts: NDArray[Any], *, ports: Sequence[str]) -> Figure:
    """The series that enters the chip above what comes out of each port, on one time axis.

    Args:
        time_s: (samples,) s.
        inputs: (samples,) the input at those times, scaled.
        volts: (ports, samples) V.
        ports: Name of each port.
    """
    figure = Figure(figsize=(6.4, 0.55 * len(ports) + 2.0))
    panels = figure.subplots(1 + len(ports), 1, sharex=True, height_ratios=[1.7, *[1.0] * len(ports)])
    time_ns = np.asarray(time_s) * 1e9
    factor, unit = volt_scale(volts)
    panels[0].plot(*thinned(time_ns, inputs), color=BLACK, linewidth=1)
    panels[0].set_ylabel("input $u$\n(scaled)", fontsize=8)
    for axes, name, trace in zip(panels[1:], ports, volts, strict=True):
        axes.plot(*thinned(time_ns, factor * trace), color=BLUE, linewidth=1)
        axes.locator_params(axis="y", nbins=2)
        axes.tick_params(labelsize=7)
        axes.text(1.01, 0.5, name, transform=axes.transAxes, va="center", fontsize=8)
    panels[1 + len(ports) // 2].set_ylabel(f"signal ({unit})", fontsize=9)
    panels[-1].set_xlabel("time (ns)")
    panels[-1].set_xlim(time_ns[0], time_ns[-1])
    figure.align_ylabels()
    return figure
