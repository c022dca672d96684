"""The figure of digitiser codes: how much of its range the oscilloscope used."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike, NDArray

from labctl.reports.canvas import BLUE, GREY, VERMILLION, number_ticks, styled


@styled
def codes_figure(
    first_code: ArrayLike, counts: NDArray[np.int64], clipped: Sequence[float], *, ports: Sequence[str]
) -> Figure:
    """Histogram of digitiser codes, one panel a port, with the part of its frames that touch the end of the range.

    Args:
        first_code: (bins,) the first code of each bin.
        counts: (ports, bins) samples in each bin.
        clipped: (ports,) part of the frames that are clipped, 0..1.
        ports: Name of each port.
    """
    figure = Figure(figsize=(6.4, 1.1 * len(ports) + 0.7))
    stack = np.atleast_1d(figure.subplots(len(ports), 1, sharex=True))
    edges = np.asarray(first_code, np.float64)
    edges = np.append(edges, 2 * edges[-1] - edges[-2])
    for axes, port, found, part in zip(stack, ports, counts, clipped, strict=True):
        axes.stairs(np.where(found, found, np.nan), edges, fill=True, baseline=0.5, color=BLUE)
        axes.set_yscale("log")
        axes.set_ylim(bottom=0.5)
        number_ticks(axes.yaxis, LogLocator(numticks=4))
        for end in edges[[0, -1]]:
            axes.axvline(end, color=GREY, linestyle="--", linewidth=1)
        axes.set_title(port, loc="left", fontsize=8, pad=2)
        colour = VERMILLION if part else GREY
        axes.set_title(f"clipped: {100 * part:.3g} % of the frames", loc="right", fontsize=8, pad=2, color=colour)
    margin = 0.02 * (edges[-1] - edges[0])
    stack[-1].set_xlim(edges[0] - margin, edges[-1] + margin)
    stack[-1].set_xlabel("digitiser code (dashed: ends of the range)")
    figure.supylabel("samples", fontsize=9)
    return figure
