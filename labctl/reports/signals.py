"""Figures of signals: images turned into traces, responses of the chip to a series, predictions of a series."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from labctl.reports.axes import Level
from labctl.reports.envelope import reduced, volt_scale
from labctl.reports.style import BLACK, BLUE, GREY, SHADE, STYLE, VERMILLION


def encoding_figure(
    images: NDArray[Any],
    time_s: ArrayLike,
    volts: NDArray[Any],
    *,
    classes: Sequence[str],
    ports: Sequence[str],
    window_s: float | None = None,
) -> Figure:
    """One image of each class beside its traces: a row a class, a column the image and then one for each port.

    The panels of a column share their vertical axis, so that the classes can be compared.

    Args:
        images: (k, rows, columns) what the mirrors showed, bright = towards the fibre.
        time_s: (samples,) s.
        volts: (k, ports, samples) V.
        classes: Name of each image's class.
        ports: Name of each port, in the order of `volts`; the one before the chip first.
        window_s: Acquisition time to shade from time 0 on, s; None = no shade.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(1.0 + 1.45 * len(ports), 0.95 * len(classes) + 0.9), layout="constrained")
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
                if window_s is not None:
                    axes.axvspan(0, window_s * 1e9, color=SHADE, linewidth=0)
                colour = BLACK if port == 0 else BLUE
                axes.plot(*reduced(time_ns, factor * volts[row, port], bins=300), color=colour, linewidth=1)
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
        if window_s is not None:
            shade = [panels[0, 1].patches[0]]
            figure.legend(shade, [f"acquisition time $T_N$ = {window_s * 1e9:g} ns"], loc="outside upper right")
    return figure


def responses_figure(
    time_s: ArrayLike,
    inputs: ArrayLike,
    volts: NDArray[Any],
    *,
    ports: Sequence[str],
    input_name: str = "input $u$\n(scaled)",
) -> Figure:
    """The series that enters the chip above what comes out of each port, on one time axis.

    Args:
        time_s: (samples,) s.
        inputs: (samples,) the input at those times.
        volts: (ports, samples) V.
        ports: Name of each port.
        input_name: What the input is, with its unit.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 0.55 * len(ports) + 2.0), layout="constrained")
        panels = figure.subplots(1 + len(ports), 1, sharex=True, height_ratios=[1.7, *[1.0] * len(ports)])
        time_ns = np.asarray(time_s) * 1e9
        factor, unit = volt_scale(volts)
        panels[0].plot(*reduced(time_ns, np.asarray(inputs)), color=BLACK, linewidth=1)
        panels[0].set_ylabel(input_name, fontsize=8)
        for axes, name, trace in zip(panels[1:], ports, volts, strict=True):
            axes.plot(*reduced(time_ns, factor * trace), color=BLUE, linewidth=1)
            axes.locator_params(axis="y", nbins=2)
            axes.tick_params(labelsize=7)
            axes.text(1.01, 0.5, name, transform=axes.transAxes, va="center", fontsize=8)
        panels[1 + len(ports) // 2].set_ylabel(f"signal ({unit})", fontsize=9)
        panels[-1].set_xlabel("time (ns)")
        panels[-1].set_xlim(time_ns[0], time_ns[-1])
        figure.align_ylabels()
    return figure


def prediction_figure(
    target: ArrayLike, predicted: ArrayLike, *, nmse: float, first_step: int = 0, paper: Level | None = None
) -> Figure:
    """Target and prediction against the step, with the error below.

    Args:
        target: (steps,) scaled series that was to be predicted; some hundred steps can be read.
        predicted: (steps,) prediction.
        nmse: Mean squared error over the variance of the target, of the whole test.
        first_step: Number of the first step.
        paper: NMSE to write beside the own one; None = none.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
        target, predicted = np.asarray(target, np.float64), np.asarray(predicted, np.float64)
        steps = np.arange(first_step, first_step + target.size)
        above.plot(*reduced(steps, target), color=BLACK, linewidth=1.3, label="target")
        drawn = {"color": VERMILLION, "linewidth": 1.1, "linestyle": (0, (4, 1.5)), "marker": "o", "markersize": 2.2}
        above.plot(*reduced(steps, predicted), label="prediction", **drawn)
        above.set_ylabel("series (scaled)")
        above.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
        words = f"NMSE = {nmse:.3g}" + ("" if paper is None else f"  ({paper.label}: {paper.value:g})")
        above.set_title(words, loc="right", fontsize=9)
        below.axhline(0, color=GREY, linewidth=0.6)
        below.plot(*reduced(steps, predicted - target), color=BLUE, linewidth=1)
        below.set_ylabel("error (scaled)")
        below.set_xlabel("step $n$")
        below.set_xlim(steps[0], steps[-1])
        figure.align_ylabels()
    return figure
