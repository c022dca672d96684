"""Figures of two runs beside each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.reports.envelope import reduced, volt_scale
from labctl.reports.style import STYLE, look

MOST_PORTS = 8


@dataclass(frozen=True)
class SameImage:
    """Records of the same images in two runs.

    Attributes:
        dataset_index: (images,) index in the data set.
        labels: (images,) class.
        ports: name of each port.
        time_s: of the samples of each run, s.
        volts: of each run, (images, ports, samples) V.
    """

    dataset_index: NDArray[np.int64]
    labels: NDArray[np.int64]
    ports: tuple[str, ...]
    time_s: tuple[NDArray[np.float64], NDArray[np.float64]]
    volts: tuple[NDArray[np.float64], NDArray[np.float64]]

    @property
    def correlation(self) -> list[float | None]:
        """Of the two records of each port over all images, 1 = same shape; None where they are not sampled alike."""
        first, second = (np.swapaxes(volts, 0, 1).reshape(len(self.ports), -1) for volts in self.volts)
        if self.time_s[0].shape != self.time_s[1].shape or not np.allclose(*self.time_s, rtol=1e-9, atol=1e-15):
            return [None] * len(self.ports)
        return [
            float(np.corrcoef(one, other)[0, 1]) if np.ptp(one) and np.ptp(other) else None
            for one, other in zip(first, second, strict=True)
        ]


def same_image_figure(same: SameImage, names: Sequence[str]) -> Figure:
    """Records of the same images in two runs on top of each other: a row a port, a column an image.

    Args:
        same: The records; the first `MOST_PORTS` ports are drawn.
        names: Name of each run.
    """
    with mpl.rc_context(STYLE):
        ports, images = same.ports[:MOST_PORTS], len(same.labels)
        figure = Figure(figsize=(2.6 * images + 1.0, 1.05 * len(ports) + 0.9), layout="constrained")
        panels = figure.subplots(len(ports), images, squeeze=False, sharex=True, sharey="row")
        factor, unit = volt_scale(np.concatenate([volts.ravel() for volts in same.volts]))
        handles: list[Any] = []
        for row, port in enumerate(ports):
            for column, axes in enumerate(panels[row]):
                handles = []
                for position, (time_s, volts) in enumerate(zip(same.time_s, same.volts, strict=True)):
                    style = look(position)
                    x, y = reduced(1e9 * time_s, factor * volts[column, row], bins=300)
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
