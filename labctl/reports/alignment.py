"""The pictures and the report of an alignment: one picture a step, readable in grey."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Protocol

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.analysis.decorrelation import Decorrelation
from labctl.analysis.drive_depth import DriveDepth
from labctl.analysis.estimates import Estimate
from labctl.analysis.light_delay import LightDelay
from labctl.reports.figures import save_figure
from labctl.reports.page import Paragraph, Part, Picture, Section, Table, write_report
from labctl.reports.style import BLACK, BLUE, GREY, SHADE, STYLE, VERMILLION, look

TITLES = {
    "dark": "Dark level and noise",
    "range": "Vertical range",
    "contrast": "Contrast between images",
    "repeatability": "Repeatability of one image",
    "delay": "Trigger to light",
    "depth": "Drive depth",
    "decorrelation": "Speckle against wavelength",
}
INTERVAL_S = 40e-12
SHOWN_FRAMES = 12
WELL_USED = 0.7
"""Part of the range that is to be used."""
BOTH_WAYS = np.array([-1.0, 1.0])


class Finding(Protocol):
    """What a report needs of a finding."""

    @property
    def good(self) -> bool:
        """Whether there is nothing to do."""

    def line(self) -> str:
        """The finding as a person reads it."""


class Result(Protocol):
    """What a report needs of a step."""

    @property
    def step(self) -> str:
        """Its name."""

    @property
    def findings(self) -> Sequence[Finding]:
        """What it found."""

    @property
    def figure(self) -> Figure | None:
        """Its picture."""


class Ranges(Protocol):
    """Images in their ranges, as `protocols.alignment` has them."""

    @property
    def volts(self) -> NDArray[np.float64]:
        """(2, images, channels, samples) V."""

    @property
    def full_scale_v(self) -> NDArray[np.float64]:
        """(channels,) V."""


def alignment_report(directory: Path, name: str, started: datetime, results: Sequence[Result]) -> Path:
    """Write `figures/` and `report.html` of an alignment into `directory`; returns the path of the report."""
    figures = directory / "figures"
    figures.mkdir(exist_ok=True)
    lines = [finding for result in results for finding in result.findings]
    rows = [(finding.line(), "good" if finding.good else "look at this") for finding in lines]
    sections = [Section("What was found", (Table(("finding", "verdict"), rows),))]
    for result in results:
        parts: list[Part] = [Paragraph(finding.line()) for finding in result.findings]
        if result.figure is not None:
            _, svg = save_figure(result.figure, figures / result.step)
            parts.append(Picture(svg, TITLES[result.step], ""))
        sections.append(Section(TITLES[result.step], parts))
    report = directory / "report.html"
    write_report(report, title=f"Alignment of {name}, {started:%Y-%m-%d %H:%M} UTC", sections=sections)
    return report


def dark_figure(volts: NDArray[np.float64], channels: Sequence[int]) -> Figure:
    """How often each voltage was seen in the dark, a panel a channel; volts (frames, channels, samples)."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 2.4), layout="constrained")
        panels = figure.subplots(1, len(channels), sharey=True, squeeze=False)[0]
        for place, (axes, channel) in enumerate(zip(panels, channels, strict=True)):
            values = 1e3 * volts[:, place].ravel()
            axes.hist(values, bins=40, color=BLUE)
            axes.axvline(values.mean(), color=VERMILLION, linestyle=(0, (4, 1.5)))
            axes.set_title(f"channel {channel}", fontsize=8)
            axes.set_xlabel("signal (mV)")
            axes.locator_params(nbins=4)
        panels[0].set_ylabel("samples")
    return figure


def range_figure(piece: Ranges, channels: Sequence[int]) -> Figure:
    """All images of each channel in its range; the ends of the range are lines."""
    mean = piece.volts.mean(axis=0)
    with mpl.rc_context(STYLE):
        figure, panels = _panels(channels)
        for place, axes in enumerate(panels):
            for position, trace in enumerate(mean[:, place]):
                style = look(position)
                axes.plot(_time_ns(trace), 1e3 * trace, color=style.colour, linestyle=style.dashes, linewidth=0.8)
            middle = (mean[:, place].max() + mean[:, place].min()) / 2
            ends, wanted = (
                1e3 * (middle + piece.full_scale_v[place] * part / 2 * BOTH_WAYS) for part in (1, WELL_USED)
            )
            axes.axhspan(*wanted, color=SHADE, linewidth=0, zorder=0)
            for end in ends:
                axes.axhline(end, color=BLACK, linewidth=1.2)
        wanted_part = f"grey: {WELL_USED:.0%} of it, which they should fill"
        figure.suptitle(f"images of a run; black lines: the ends of the range; {wanted_part}", fontsize=9)
    return figure


def repeats_figure(volts: NDArray[np.float64], channels: Sequence[int]) -> Figure:
    """One image again and again: single frames in grey, their mean, two standard deviations about it."""
    with mpl.rc_context(STYLE):
        figure, panels = _panels(channels)
        for place, axes in enumerate(panels):
            mean, spread = volts[:, place].mean(axis=0), 2 * volts[:, place].std(axis=0, ddof=1)
            axes.fill_between(_time_ns(mean), 1e3 * (mean - spread), 1e3 * (mean + spread), color=SHADE, linewidth=0)
            for trace in volts[:SHOWN_FRAMES, place]:
                axes.plot(_time_ns(trace), 1e3 * trace, color=GREY, linewidth=0.3)
            axes.plot(_time_ns(mean), 1e3 * mean, color=BLUE, linewidth=1.4)
        figure.suptitle("one image: mean, and two standard deviations of a frame about it", fontsize=9)
    return figure


def contrast_figure(volts: NDArray[np.float64], channels: Sequence[int]) -> Figure:
    """Mean of all images, and how they spread about it at each time; volts (2, images, channels, samples)."""
    images = volts.mean(axis=0)
    with mpl.rc_context(STYLE):
        figure, panels = _panels(channels)
        for place, axes in enumerate(panels):
            mean, spread = images[:, place].mean(axis=0), images[:, place].std(axis=0, ddof=1)
            axes.fill_between(_time_ns(mean), 1e3 * (mean - spread), 1e3 * (mean + spread), color=SHADE, linewidth=0)
            axes.plot(_time_ns(mean), 1e3 * mean, color=BLACK, linewidth=1.2)
        figure.suptitle(f"{len(images)} images: mean, and their standard deviation about it", fontsize=9)
    return figure


def delay_figure(found: LightDelay, whole: Estimate) -> Figure:
    """Power of the responses against the time after the trigger, what the model expects, and the first light."""
    shift = whole.value - found.delay.value
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.2), layout="constrained")
        axes = figure.subplots()
        time_ns = 1e9 * (found.time_s + shift)
        top = found.power.max()
        axes.plot(time_ns, found.power / top, color=BLUE, marker="o", markersize=3, linewidth=0.8, label="measured")
        dashes = (0, (4, 1.5))
        axes.plot(time_ns, found.expected / top, color=VERMILLION, linestyle=dashes, label="expected on average")
        first_ns = 1e9 * whole.value
        axes.axvspan(first_ns, first_ns + 1e9 * INTERVAL_S, color=SHADE, linewidth=0, label="one sample of the drive")
        axes.axvline(first_ns, color=BLACK, label=f"first light, {first_ns:.4f} ns")
        axes.set_xlabel("time after the trigger (ns)")
        axes.set_ylabel("power of the response\n(1 = highest)")
        axes.ticklabel_format(axis="x", useOffset=False)
        axes.legend(loc="upper right")
    return figure


def depth_figure(found: DriveDepth) -> Figure:
    """Phase against the drive's level, and how strongly each drive moves the mean signal."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.0), layout="constrained")
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


def decorrelation_picture(found: Decorrelation) -> Figure:
    """Correlation of traces against detuning; the half width where it is known."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.0), layout="constrained")
        axes = figure.subplots()
        axes.plot(1e3 * found.detuning_nm, found.correlation, color=BLUE, marker="o", markersize=3.5)
        axes.axhline(0.5, color=GREY, linewidth=0.8, linestyle=(0, (1, 1.2)))
        if found.half_width_nm is not None:
            axes.axvline(1e3 * found.half_width_nm, color=VERMILLION, linestyle=(0, (4, 1.5)))
        axes.set_xlabel("detuning (pm)")
        axes.set_ylabel("correlation (1 = same)")
    return figure


def _panels(channels: Sequence[int]) -> tuple[Figure, list[mpl.axes.Axes]]:
    figure = Figure(figsize=(6.4, 1.2 + 1.1 * len(channels)), layout="constrained")
    panels = list(figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0])
    for axes, channel in zip(panels, channels, strict=True):
        axes.set_ylabel(f"channel {channel}\n(mV)", fontsize=8)
        axes.locator_params(axis="y", nbins=4)
    panels[-1].set_xlabel("time after the trigger (ns)")
    return figure, panels


def _time_ns(trace: NDArray[np.float64]) -> NDArray[np.float64]:
    return 1e9 * INTERVAL_S * np.arange(trace.size, dtype=np.float64)
