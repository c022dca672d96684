"""A figure in a notebook that shows the latest traces in the place of those before."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from instruments.ports import port_name
from labctl.errors import LabctlError
from labctl.reports.canvas import look, place_legend, styled, volt_scale
from labctl.reports.pictures import png_of
from labctl.runs.format.origin import Origin

WIDTH = 640
"""On the screen, in pixels of a notebook: it has more, for screens that do."""


class LiveTrace:
    """Traces of some ports as they come, with their count; scales only grow, so that what moves is the signal."""

    def __init__(self) -> None:
        """Nothing is shown before the first traces.

        Raises:
            LabctlError: there is no IPython, which a notebook has.
        """
        try:
            from IPython.display import Image, display
        except ModuleNotFoundError:
            raise LabctlError("a live trace is shown in a notebook: pip install jupyter, and call it there") from None
        self._image: Any = Image
        self._display: Any = display
        self._shown: Any = None
        self._count = 0
        self._low = self._high = 0.0

    def show(self, time_s: NDArray[Any], volts: NDArray[Any], ports: Sequence[int], origin: Origin) -> None:
        """Draw traces (ports, samples) in V over those before; what is simulated is marked as in any figure."""
        self._count += 1
        self._low, self._high = min(self._low, float(np.min(volts))), max(self._high, float(np.max(volts)))
        figure = trace_figure(time_s, volts, ports, ends_v=(self._low, self._high), count=self._count)
        picture = self._image(data=png_of(figure, origin), width=WIDTH)
        if self._shown is None:
            self._shown = self._display(picture, display_id=True)
        else:
            self._shown.update(picture)


@styled
def trace_figure(
    time_s: NDArray[Any], volts: NDArray[Any], ports: Sequence[int], *, ends_v: tuple[float, float], count: int
) -> Figure:
    """One panel with a trace a port.

    Args:
        time_s: (samples,) s.
        volts: (ports, samples) V.
        ports: Number of each port.
        ends_v: Lowest and highest V that the vertical axis has room for.
        count: The traces are the how manyth.
    """
    figure = Figure(figsize=(6.4, 2.8))
    axes = figure.add_subplot()
    low_v, high_v = ends_v
    factor, unit = volt_scale(ends_v)
    for position, (port, trace) in enumerate(zip(ports, volts, strict=True)):
        style = look(position)
        axes.plot(1e9 * time_s, factor * trace, color=style.colour, linestyle=style.dashes, label=port_name(port))
    axes.set(xlabel="time (ns)", ylabel=f"signal ({unit})", title=f"trace {count}")
    margin_v = 0.1 * (high_v - low_v)
    axes.set_ylim(factor * (low_v - margin_v), factor * (high_v + margin_v))
    place_legend(figure, axes, inside="upper right")
    return figure
