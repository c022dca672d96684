"""The figure of one image in two runs: their records on top of each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.reports.canvas import look, styled, thinned, volt_scale

MOST_PORTS = 8


@dataclass(frozen=True)
class SameImage:
    """Records of the same images in two runs.

    Attributes:
        dataset_index: (images,) index in the data set.
        labels: (images,) class.
        ports: name of each port.
        time_s: of the samples of each run, s after its first: bursts begin later after their trigger than single shots.
        volts: of each run, (images, ports, samples) V.
    """

    dataset_index: NDArray[np.int64]
    labels: NDArray[np.int64]
    ports: tuple[str, ...]
    time_s: tuple[NDArray[np.float64], NDArray[np.float64]]
    volts: tuple[NDArray[np.float64], NDArray[np.float64]]


@styled
def same_image_figure(same: SameImage, names: Sequence[str]) -> Figure:
    """Records of the same images in two runs on top of each other: a row a port, a column an image.

    Args:
        same: The records; the first `MOST_PORTS` ports are drawn.
        names: Name of each run.
    """
    ports, images = same.ports[:MOST_PORTS], len(same.labels)
    figure = Figure(figsize=(2.6 * images + 1.0, 1.05 * len(ports) + 0.9))
    panels = figure.subplots(len(ports), images, squeeze=False, sharex=True, sharey="row")
    factor, unit = volt_scale(np.concatenate([volts.ravel() for volts in same.volts]))
    handles: list[Any] = []
    for row, port in enumerate(ports):
        for column, axes in enumerate(panels[row]):
            handles = []
            for position, (time_s, volts) in enumerate(zip(same.time_s, same.volts, strict=True)):
                style = look(position)
                x, y = thinned(1e9 * time_s, factor * volts[column, row], bins=300)
                handles += axes.plot(x, y, color=style.colour, linestyle=style.dashes, linewidth=1.2)
            axes.locator_params(nbins=4)
            axes.tick_params(labelsize=7)
            if row == 0:
                axes.set_title(f"image {same.dataset_index[column]}, class {same.labels[column]}", fontsize=8)
        panels[row, 0].set_ylabel(port, fontsize=8)
    for axes in panels[-1]:
        axes.set_xlabel("time (ns)", fontsize=8)
    figure.supylabel(f"signal ({unit})", fontsize=9)
    figure.legend(handles, list(names), loc="outside upper center", ncols=2)
    return figure
