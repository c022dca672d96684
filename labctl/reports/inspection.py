"""Figures of a run as it was measured: how the digitiser's range is used, and how the bench drifted."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from labctl.reports.axes import legend_below
from labctl.reports.envelope import volt_scale
from labctl.reports.style import BLUE, GREY, STYLE, VERMILLION, look

LONG_S = (("h", 3600.0), ("min", 60.0), ("s", 1.0), ("ms", 1e-3))


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
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 1.1 * len(ports) + 0.7), layout="constrained")
        stack = np.atleast_1d(figure.subplots(len(ports), 1, sharex=True))
        edges = np.asarray(first_code, np.float64)
        edges = np.append(edges, 2 * edges[-1] - edges[-2])
        for axes, port, found, part in zip(stack, ports, counts, clipped, strict=True):
            axes.stairs(np.where(found, found, np.nan), edges, fill=True, baseline=0.5, color=BLUE)
            axes.set_yscale("log")
            axes.set_ylim(bottom=0.5)
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
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.4), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        name, second = next((pair for pair in LONG_S if np.ptp(time_s) >= 3 * pair[1]), LONG_S[-1])
        factor, unit = volt_scale(level)
        for position, port in enumerate(ports):
            style = look(position)
            marks = {
                "color": style.colour,
                "marker": style.marker,
                "markersize": 3.5,
                "linestyle": style.dashes,
                "linewidth": 1.2,
            }
            above.plot(time_s[:, position] / second, factor * level[:, position], label=port, **marks)
            below.plot(time_s[:, position] / second, correlation[:, position], **marks)
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


def one_picture(parts: Sequence[Path], out: Path) -> None:
    """Put pictures (PNG) below each other into one, on white; it appears complete or not at all."""
    pictures = [Image.open(part).convert("RGB") for part in parts]
    page = Image.new("RGB", (max(one.width for one in pictures), sum(one.height for one in pictures)), "white")
    top = 0
    for one in pictures:
        page.paste(one, (0, top))
        top += one.height
    partial = out.with_name(out.name + ".partial")
    page.save(partial, "PNG")
    partial.replace(out)
