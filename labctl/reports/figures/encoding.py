"""The figure of the encoding: images next to the traces they become."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from labctl.reports.canvas import BLACK, BLUE, styled, thinned, volt_scale


@styled
def encoding_figure(
    images: NDArray[Any], time_s: ArrayLike, volts: NDArray[Any], *, classes: Sequence[str], ports: Sequence[str]
) -> Figure:
    """One image of each class next to its traces: a row a class, a column the image and then one for each port.

    The panels of a column share their vertical axis, so that the classes can be compared.

    Args:
        images: (k, rows, columns) what the mirrors showed, bright = towards the fibre.
        time_s: (samples,) s.
        volts: (k, ports, samples) V.
        classes: Name of each image's class.
        ports: Name of each port, in the order of `volts`; the one before the chip first.
    """
    figure = Figure(figsize=(1.0 + 1.45 * len(ports), 0.95 * len(classes) + 0.9))
    panels = figure.subplots(len(classes), 1 + len(ports), squeeze=False, width_ratios=[0.62, *[1.0] * len(ports)])
    time_ns = np.asarray(time_s) * 1e9
    factor, unit = volt_scale(volts)
    tops = [factor * float(np.max(volts[:, port])) * 1.05 for port in range(len(ports))]
    bottoms = [min(0.0, factor * float(np.min(volts[:, port])) * 1.05) for port in range(len(ports))]
    for row, (image, name) in enumerate(zip(images, classes, strict=True)):
        panels[row, 0].imshow(image, cmap="gray", interpolation="none")
        panels[row, 0].set(xticks=[], yticks=[])
        panels[row, 0].set_ylabel(name, rotation=0, ha="right", va="center")
        for port, axes in enumerate(panels[row, 1:]):
            colour = BLACK if port == 0 else BLUE
            axes.plot(*thinned(time_ns, factor * volts[row, port], bins=300), color=colour, linewidth=1)
            axes.set(xlim=(time_ns[0], time_ns[-1]), ylim=(bottoms[port], tops[port]))
            axes.locator_params(nbins=3)
            axes.tick_params(labelsize=7, labelbottom=row == len(classes) - 1)
    panels[0, 0].set_title("image", fontsize=8)
    for axes, name in zip(panels[0, 1:], ports, strict=True):
        axes.set_title(name, fontsize=8)
    for axes in panels[-1, 1:]:
        axes.set_xlabel("time (ns)", fontsize=8)
    for axes in panels[:, 1]:
        axes.set_ylabel(f"signal ({unit})", fontsize=8)
    return figure
