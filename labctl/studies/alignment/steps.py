"""What each piece of an alignment says: findings with verdicts, and the picture that shows why."""

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.analysis.alignment import contrast, flat_top, level, noise, repeatability_db, used_range
from labctl.analysis.decorrelation import Scan, decorrelation
from labctl.analysis.drive_depth import UNTOLD, drive_depth
from labctl.analysis.estimates import Estimate
from labctl.analysis.light_delay import light_delay, responses
from labctl.errors import AnalysisError
from labctl.reports.figures import alignment as figures
from labctl.studies.alignment.findings import COVERAGE, Finding
from protocols.alignment import SAMPLE_RATE, Answered, Dark, Hopped, Ranged, Repeated
from protocols.base import MOST_AVERAGES
from protocols.image_readout import DRIVE_RATE

WELL_USED = 0.6
"""Part of its range that a channel's images should fill: 1 / 1.3 at most, less what noise has of single triggers."""
FAR_BELOW = 0.05
"""Part of its range by which a channel may seem to go below its dark level: ranges have offsets of their own."""
NOISY_V = 5e-3
"""Noise in the dark that a detector of this kind does not have by itself."""
REPEATABLE_DB = 10.0
DIFFERENT = 0.1
"""Contrast between images below which a readout has little to learn from."""
PART_OF_A_SAMPLE = 0.25
"""Standard uncertainty of the delay, in samples of the drive, that is well below one."""
INTERVAL_S, HOLD_S = 1 / SAMPLE_RATE, 1 / DRIVE_RATE
SHALLOW, DEEP = math.pi, 3 * math.pi
"""Drive depths, rad: below, much of the speckle does not move; above, the amplifier is beyond what 2 pi needs."""
UNCERTAIN = 0.5
"""Part of the depth that its stated uncertainty is at most, but of a drive that is shallow all the same."""
LONGEST_DELAY_S = 1e-6
"""Delays that are told apart: from one period of the finer sequence before the trigger to this behind it."""


@dataclass(frozen=True)
class Result:
    """A step's findings and picture; `ends` says why no later step can be measured, if so."""

    step: str
    findings: tuple[Finding, ...]
    figure: Figure | None = None
    ends: str = ""


def of_dark(piece: Dark, channels: tuple[int, ...]) -> Result:
    """Dark level and noise of every channel."""
    findings: list[Finding] = []
    quiet = f"some, {NOISY_V * 1e3:g} mV at most"
    for place, channel in enumerate(channels):
        volts = piece.volts[:, place]
        found, spread = level(volts), noise(volts)
        advice = ""
        if piece.clipped[place]:
            advice = "beyond the finest range: look for stray light, or for an offset of the detector"
        findings.append(Finding("dark", "dark level", channel, found, "V", advice, "within the finest range"))
        advice = ""
        if spread.value > NOISY_V:
            advice = f"more than {NOISY_V * 1e3:g} mV: check the detector's supply and its cable"
        elif piece.clipped[place]:
            advice = "mend the dark level first"
        elif spread.value == 0:
            advice = "no noise at all: the channel is off or its input grounded; check its cable"
        if piece.clipped[place]:
            advice = f"at least that, since the record clips: {advice}"
        findings.append(Finding("dark", "noise in the dark", channel, spread, "V", advice, quiet))
    return Result("dark", tuple(findings), figures.dark_figure(piece.volts, channels))


def lit_channels(piece: Ranged, dark: Dark) -> NDArray[np.bool_]:
    """Which channels see light: more than their noise in the dark, on average over all images, (channels,)."""
    light = piece.volts.mean(axis=(0, 1, 3)) - dark.volts.mean(axis=(0, 2))
    return np.asarray(light > dark.volts.std(axis=(0, 2)))


def _below_dark(piece: Ranged, dark: Dark, place: int) -> bool:
    """Whether a channel's images go below its dark level by more than noise and the offsets of ranges."""
    volts, level_v = dark.volts[:, place], float(piece.volts[:, :, place].min())
    return bool(volts.mean() - level_v > max(FAR_BELOW * piece.full_scale_v[place], 3 * volts.std()))


def of_range(piece: Ranged, dark: Dark, channels: tuple[int, ...], *, projector: bool) -> Result:
    """How much of each channel's range the images use, and whether they reach its ends or the detector's.

    Where no channel has light, the mirrors of a `projector` in its way may be why.

    Images that are cut say nothing of delay, depth or noise: those wait until it is mended. A single frame may clip by
    its noise.
    """
    lit = lit_channels(piece, dark)
    mirrors = ", and that the DMD shows its pictures" if projector and not lit.any() else ""
    findings = []
    cut: list[int] = []
    for place, channel in enumerate(channels):
        used = used_range(piece.volts[:, :, place], float(piece.full_scale_v[place]))
        flat = bool(lit[place]) and flat_top(piece.volts[:, :, place])
        advice = ""
        if piece.clipped[place]:
            why = "the coarsest range: attenuate the light" if piece.coarsest[place] else "lower the gain or the light"
            top = f"{piece.volts[:, :, place].max() * 1e3:.3g} mV"
            advice = f"clips at {top}: {why}"
        elif _below_dark(piece, dark, place):
            advice = "goes below the dark level, as no light does: check that the detector passes DC"
        elif not lit[place]:
            advice = f"no light: check the laser's shutter, the fibre into this detector and its patching{mirrors}"
        elif flat:
            top = f"{piece.volts[:, :, place].max() * 1e3:.3g} mV"
            advice = f"flat at {top}, below the range's end: the detector gives no more: attenuate its light"
        elif used.value < WELL_USED:
            why = "more light or gain is needed" if piece.finest[place] else "find out what the brightest image is"
            advice = f"less than {WELL_USED:.0%} of the range is used: {why}"
        if flat:
            cut.append(channel)
        findings.append(
            Finding("range", "range used", channel, used, "1", advice, f"{100 * WELL_USED:g} % at least, not cut")
        )
    ends = f"mend channel {', '.join(map(str, cut))} first, whose signal is cut" if cut else ""
    if not lit.any():
        ends = "no light on any channel"
    figure = figures.range_figure(
        piece.volts, channels, full_scale_v=piece.full_scale_v, to_be_used=WELL_USED, interval_s=INTERVAL_S
    )
    return Result("range", tuple(findings), figure, ends)


def of_repeats(piece: Repeated, channels: tuple[int, ...], lit: NDArray[np.bool_]) -> Result:
    """Signal to noise of one image, shown again and again."""
    findings = []
    repeatable = f"{REPEATABLE_DB:g} dB at least"
    for place in np.flatnonzero(lit):
        found = repeatability_db(piece.volts[:, place])
        advice = ""
        if found.value < REPEATABLE_DB:
            averages = 2 ** math.ceil((REPEATABLE_DB - found.value) / 3)
            otherwise = "check modulator and RF amplifier" if averages > MOST_AVERAGES else f"--set averages={averages}"
            advice = f"below {REPEATABLE_DB:g} dB: more light, or {otherwise}"
        findings.append(Finding("repeatability", "signal to noise", channels[place], found, "dB", advice, repeatable))
    figure = figures.repeats_figure(piece.volts, channels, interval_s=INTERVAL_S)
    return Result("repeatability", tuple(findings), figure)


def of_contrast(piece: Ranged, dark: Dark, channels: tuple[int, ...], lit: NDArray[np.bool_]) -> Result:
    """How much different images differ."""
    findings = []
    different = f"{100 * DIFFERENT:g} % at least"
    for place in np.flatnonzero(lit):
        found = contrast(piece.volts[:, :, place], level(dark.volts[:, place]))
        advice = "" if found.value >= DIFFERENT else "images hardly differ: check the picture on the DMD and its focus"
        findings.append(Finding("contrast", "contrast between images", channels[place], found, "1", advice, different))
    figure = figures.contrast_figure(piece.volts, channels, interval_s=INTERVAL_S)
    return Result("contrast", tuple(findings), figure)


def of_delay(piece: Answered) -> Result:
    """From the trigger to the first light of the sample that begins with it.

    Raises:
        AnalysisError: Every image was clipped, the light does not follow the drive, or the two sequences agree on no
            delay, or on several.
    """
    if not all(len(one.upright) for one in (piece, piece.coarse or piece)):
        raise AnalysisError("every image clips: attenuate the light into this detector")
    fine, coarse = (
        light_delay(
            responses(one.upright, one.inverted, one.sequence),
            interval_s=one.interval_s,
            hold_s=one.hold_s,
            scope_hz=one.scope_hz,
        )
        for one in (piece, piece.coarse or piece)
    )
    periods = [one.sequence.size * one.hold_s for one in (piece, piece.coarse or piece)]
    candidates = fine.delay.value + periods[0] * np.arange(-1, round(LONGEST_DELAY_S / periods[0]))
    off = np.abs((candidates - coarse.delay.value + periods[1] / 2) % periods[1] - periods[1] / 2)
    alike = candidates[off <= COVERAGE * math.hypot(fine.delay.uncertainty, coarse.delay.uncertainty)]
    if not alike.size:
        raise AnalysisError(
            f"not measured: two sequences disagree by {off.min() * 1e12:.0f} ps: check that the bench does not drift, "
            f"and that light comes {-periods[0] * 1e9:.0f} to {LONGEST_DELAY_S * 1e9:.0f} ns behind the trigger"
        )
    if alike.size > 1:
        times = ", ".join(f"{delay * 1e9:.2f}" for delay in alike)
        raise AnalysisError(f"not measured: two sequences agree on {times} ns alike: more light, or a deeper drive")
    whole = Estimate(float(alike[0]), fine.delay.uncertainty)
    advice = ""
    if whole.uncertainty > PART_OF_A_SAMPLE * HOLD_S:
        advice = (
            f"uncertain by more than {PART_OF_A_SAMPLE:g} sample: more light, or check the trigger's level and slope"
        )
    certain = f"within {PART_OF_A_SAMPLE * HOLD_S * 1e12:g} ps, one standard deviation"
    finding = Finding("delay", "trigger to light", None, whole, "s", advice, certain)
    return Result("delay", (finding,), figures.delay_figure(fine, whole, hold_s=HOLD_S))


def of_depth(piece: Hopped) -> Result:
    """Phase between the lowest and the highest level of the drive.

    Raises:
        AnalysisError: The mean signals do not tell it, or only so that it may as well be shallow.
    """
    found = drive_depth(
        piece.idle,
        piece.hopping,
        pairs=piece.pairs,
        levels=piece.levels,
        hold_s=piece.hold_s,
        sequence=piece.sequence,
    )
    depth, reach = found.depth.value, COVERAGE * found.depth.uncertainty
    if depth + reach > SHALLOW and reach > UNCERTAIN * depth:
        raise AnalysisError(UNTOLD)
    advice = ""
    if depth < SHALLOW:
        advice = "less than pi: part of the speckle does not move; raise awg.amplitude or the RF gain"
    elif depth - reach > DEEP:
        advice = "more than 3 pi: lower awg.amplitude or the RF gain"
    wanted = f"{SHALLOW:.2f} to {DEEP:.2f} rad"
    finding = Finding("depth", "drive depth", None, found.depth, "rad", advice, wanted)
    return Result("depth", (finding,), figures.depth_figure(found))


def of_decorrelation(scan: Scan) -> Result:
    """Detuning at which the speckle has half forgotten.

    Such widths scatter evenly in their logarithm: the uncertainty is that of the end that is farther away.
    """
    found = decorrelation(scan)
    if found.half_width_nm is None:
        finding = Finding(
            "decorrelation",
            "half width of the speckle's correlation with wavelength",
            None,
            None,
            "m",
            f"the scan is {found.verdict}: measure it with 'labctl run wavelength-scan' and other steps",
        )
    else:
        spread = found.uncertainty_nm if found.uncertainty_nm is not None else found.half_width_nm
        reach = math.expm1(COVERAGE * spread / found.half_width_nm) / COVERAGE
        half = Estimate(1e-9 * found.half_width_nm, 1e-9 * found.half_width_nm * reach)
        what, enough = "half width of the speckle's correlation with wavelength", "within the scan, beyond its step"
        finding = Finding("decorrelation", what, None, half, "m", criterion=enough)
    return Result("decorrelation", (finding,), figures.scan_figure(found))


def unmeasured(step: str, what: str, error: AnalysisError) -> Result:
    """A step whose frames do not determine its quantity."""
    return Result(step, (Finding(step, what, None, None, "1", str(error)),))
