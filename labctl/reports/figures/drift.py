"""The figure of drift: how one image looked over a run."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from labctl.reports.canvas import legend_below, look, styled, volt_scale

TIME_UNITS = (("h", 3600.0), ("min", 60.0), ("s", 1.0), ("ms", 1e-3))


@styled
def drift_figure(
    time_s: NDArray[np.float64],
    level: NDArray[np.float64],
    correlation: NDArray[np.float64],
    *,
    ports: Sequence[str],
) -> Figure:
    """Level of the reference images, and their correlation with the first one, over the run.

    Args:
        time_s: (shots, ports) when each port was measured, s.
        level: (shots, ports) mean signal, V.
        correlation: (shots, ports) with the first reference image.
        ports: Name of each port.
    """
    figure = Figure(figsize=(6.4, 4.4))
    above, below = figure.subplots(2, 1, sharex=True)
    name, second = next((pair for pair in TIME_UNITS if np.ptp(time_s) >= 3 * pair[1]), TIME_UNITS[-1])
    factor, unit = volt_scale(level)
    for position, port in enumerate(ports):
        style = look(position)
        drawn: dict[str, Any] = {"color": style.colour, "linestyle": style.dashes, "linewidth": 1.2}
        drawn |= {"marker": style.marker, "markersize": 3.5}
        above.plot(time_s[:, position] / second, factor * level[:, position], label=port, **drawn)
        below.plot(time_s[:, position] / second, correlation[:, position], **drawn)
    above.set_ylabel(f"mean signal ({unit})")
    below.set_ylabel("correlation with\nthe first (1 = same)")
    below.set_xlabel(f"time since the run began ({name})")
    for axes in (above, below):
        axes.grid(visible=True, axis="y")
        axes.yaxis.set_major_locator(MaxNLocator(5))
    above.set_title("reference images", loc="left", fontsize=9)
    figure.align_ylabels()
    legend_below(figure, *above.get_legend_handles_labels())
    return figure
