"""Figures of an alignment, one a step, readable in grey."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.analysis.decorrelation import Decorrelation
from labctl.analysis.drive_depth import DriveDepth
from labctl.analysis.estimates import Estimate
from labctl.analysis.light_delay import LightDelay
from labctl.reports.canvas import BLACK, BLUE, GREY, SHADE, VERMILLION, look, styled

SHOWN_FRAMES = 12
MOST_BINS = 40
BOTH_WAYS = np.array([-1.0, 1.0])
DASHED = (0, (4, 1.5))


@styled
def dark_figure(volts: NDArray[np.float64], channels: Sequence[int]) -> Figure:
    """How often each voltage was seen in the dark, a panel a channel; volts (frames, channels, samples)."""
    figure = Figure(figsize=(6.4, 2.4))
    panels = figure.subplots(1, len(channels), sharey=True, squeeze=False)[0]
    for place, (axes, channel) in enumerate(zip(panels, channels, strict=True)):
        values = 1e3 * volts[:, place].ravel()
        axes.hist(values, bins=_bins(values), color=BLUE)
        axes.axvline(values.mean(), color=VERMILLION, linestyle=DASHED)
        axes.set_title(f"channel {channel}", fontsize=8)
        axes.set_xlabel("signal (mV)")
        axes.locator_params(nbins=4)
    panels[0].set_ylabel("samples")
    return figure


@styled
def range_figure(
    volts: NDArray[np.float64],
    channels: Sequence[int],
    *,
    full_scale_v: NDArray[np.float64],
    to_be_used: float,
    interval_s: float,
) -> Figure:
    """All images of each channel in its range; the ends of the range are lines.

    Args:
        volts: (2, images, channels, samples) V.
        channels: Of the oscilloscope.
        full_scale_v: (channels,) range of each, V.
        to_be_used: Part of the range that the images should fill, 0..1.
        interval_s: From sample to sample, s.
    """
    mean = volts.mean(axis=0)
    figure, panels = _panels(channels)
    for place, axes in enumerate(panels):
        for position, trace in enumerate(mean[:, place]):
            style = look(position)
            time_ns = _time_ns(trace, interval_s)
            axes.plot(time_ns, 1e3 * trace, color=style.colour, linestyle=style.dashes, linewidth=0.8)
        middle = (mean[:, place].max() + mean[:, place].min()) / 2
        ends, wanted = (1e3 * (middle + full_scale_v[place] * part / 2 * BOTH_WAYS) for part in (1, to_be_used))
        axes.axhspan(*wanted, color=SHADE, linewidth=0, zorder=0)
        for end in ends:
            axes.axhline(end, color=BLACK, linewidth=1.2)
    wanted_part = f"grey: {to_be_used:.0%} of it, which they should fill"
    figure.suptitle(f"images of a run; black lines: the ends of the range; {wanted_part}", fontsize=9)
    return figure


@styled
def repeats_figure(volts: NDArray[np.float64], channels: Sequence[int], *, interval_s: float) -> Figure:
    """One image again and again: single frames in grey, their mean, two standard deviations about it.

    Args:
        volts: (frames, channels, samples) V.
        channels: Of the oscilloscope.
        interval_s: From sample to sample, s.
    """
    figure, panels = _panels(channels)
    for place, axes in enumerate(panels):
        mean, spread = volts[:, place].mean(axis=0), 2 * volts[:, place].std(axis=0, ddof=1)
        time_ns = _time_ns(mean, interval_s)
        axes.fill_between(time_ns, 1e3 * (mean - spread), 1e3 * (mean + spread), color=SHADE, linewidth=0)
        for trace in volts[:SHOWN_FRAMES, place]:
            axes.plot(time_ns, 1e3 * trace, color=GREY, linewidth=0.3)
        axes.plot(time_ns, 1e3 * mean, color=BLUE, linewidth=1.4)
    figure.suptitle("one image: mean, and two standard deviations of a frame about it", fontsize=9)
    return figure


@styled
def contrast_figure(volts: NDArray[np.float64], channels: Sequence[int], *, interval_s: float) -> Figure:
    """Mean of all images, and how they spread about it at each time.

    Args:
        volts: (2, images, channels, samples) V.
        channels: Of the oscilloscope.
        interval_s: From sample to sample, s.
    """
    images = volts.mean(axis=0)
    figure, panels = _panels(channels)
    for place, axes in enumerate(panels):
        mean, spread = images[:, place].mean(axis=0), images[:, place].std(axis=0, ddof=1)
        time_ns = _time_ns(mean, interval_s)
        axes.fill_between(time_ns, 1e3 * (mean - spread), 1e3 * (mean + spread), color=SHADE, linewidth=0)
        axes.plot(time_ns, 1e3 * mean, color=BLACK, linewidth=1.2)
    figure.suptitle(f"{len(images)} images: mean, and their standard deviation about it", fontsize=9)
    return figure


@styled
def delay_figure(found: LightDelay, whole: Estimate, *, hold_s: float) -> Figure:
    """Power of the responses against the time after the trigger, what the model expects, and the first light.

    Args:
        found: The delay, modulo the period of the drive.
        whole: The delay with all its periods, s.
        hold_s: How long the drive holds a sample, s.
    """
    shift = whole.value - found.delay.value
    figure = Figure(figsize=(6.4, 3.2))
    axes = figure.subplots()
    time_ns = 1e9 * (found.time_s + shift)
    top = found.power.max()
    axes.plot(time_ns, found.power / top, color=BLUE, marker="o", markersize=3, linewidth=0.8, label="measured")
    axes.plot(time_ns, found.expected / top, color=VERMILLION, linestyle=DASHED, label="expected on average")
    first_ns = 1e9 * whole.value
    axes.axvspan(first_ns, first_ns + 1e9 * hold_s, color=SHADE, linewidth=0, label="one sample of the drive")
    axes.axvline(first_ns, color=BLACK, label=f"first light, {first_ns:.4f} ns")
    axes.set_xlabel("time after the trigger (ns)")
    axes.set_ylabel("power of the response\n(1 = highest)")
    axes.ticklabel_format(axis="x", useOffset=False)
    axes.legend(loc="upper right")
    return figure


@styled
def depth_figure(found: DriveDepth) -> Figure:
    """Phase against the drive's level, and how strongly each drive moves the mean signal."""
    figure = Figure(figsize=(6.4, 3.0))
    left, right = figure.subplots(1, 2)
    left.plot(found.levels, found.phase / np.pi, color=BLUE, marker="o")
    left.set_xlabel("level of the drive (1 = full scale)")
    left.set_ylabel("phase (π rad)")
    numbers = np.arange(len(found.pairs))
    for row, (moved, expected) in enumerate(zip(found.moved, found.expected, strict=True)):
        style = look(row)
        right.plot(numbers, expected, color=style.colour, linestyle=style.dashes, label=f"hold {row + 1}, expected")
        right.plot(numbers, moved, color=style.colour, marker=style.marker, linestyle="none", label="measured")
    names = [f"{found.levels[low]:g}\n{found.levels[high]:g}" for low, high in found.pairs]
    right.set_xticks(numbers, names, fontsize=7)
    right.set_xlabel("levels that the drive hops between")
    right.set_ylabel("change of the mean signal\n(1 = largest)")
    right.set_ylim(0, 1.05)
    right.legend(fontsize=7, loc="lower right")
    return figure


@styled
def scan_figure(found: Decorrelation) -> Figure:
    """Correlation of traces against detuning; the half width where it is known."""
    figure = Figure(figsize=(6.4, 3.0))
    axes = figure.subplots()
    axes.plot(1e3 * found.detuning_nm, found.correlation, color=BLUE, marker="o", markersize=3.5)
    axes.axhline(0.5, color=GREY, linewidth=0.8, linestyle=(0, (1, 1.2)))
    if found.half_width_nm is not None:
        axes.axvline(1e3 * found.half_width_nm, color=VERMILLION, linestyle=DASHED)
    axes.set_xlabel("detuning (pm)")
    axes.set_ylabel("correlation (1 = same)")
    return figure


def _bins(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Edges of bins that hold equally many of the digitiser's levels each: others would make a comb of them."""
    levels = np.unique(values.round(6))
    step = np.diff(levels).min() if levels.size > 1 else 1.0
    spread = levels[-1] - levels[0]
    width = step * max(1, round(spread / step / MOST_BINS))
    return np.asarray(levels[0] - step / 2 + width * np.arange(int(spread / width) + 2))


def _panels(channels: Sequence[int]) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(6.4, 1.2 + 1.1 * len(channels)))
    panels = list(figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0])
    for axes, channel in zip(panels, channels, strict=True):
        axes.set_ylabel(f"channel {channel}\n(mV)", fontsize=8)
        axes.locator_params(axis="y", nbins=4)
    panels[-1].set_xlabel("time after the trigger (ns)")
    return figure, panels


def _time_ns(trace: NDArray[np.float64], interval_s: float) -> NDArray[np.float64]:
    return 1e9 * interval_s * np.arange(trace.size, dtype=np.float64)
