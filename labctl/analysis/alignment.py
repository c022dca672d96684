"""What the signals of a bench say before the first run: dark level, noise, range, repeatability, contrast.

Every estimate comes with a standard uncertainty from the same frames: of means the scatter of the frames, of a standard
deviation s / sqrt(2 (n - 1)) (GUM, JCGM 100:2008, E.4.3), unless said otherwise.
"""

import math

import numpy as np
from numpy.typing import NDArray

from labctl.analysis.estimates import Estimate

BRIGHT, FEWEST_BRIGHT = 0.01, 16
"""Part of the samples, and their least number, that the noise of the highest is taken from: it grows with the light."""
LEAST_REPEATS = 4
"""Frames that somebody is told a repeatability of, at least."""
TOP, FLAT = 0.01, 4
"""Part of an image's range and number of times that make a flat top."""


def level(volts: NDArray[np.floating]) -> Estimate:
    """Mean of frames (frames, samples), V."""
    means = volts.mean(axis=1)
    return Estimate(float(means.mean()), float(means.std(ddof=1) / math.sqrt(len(means))))


def noise(volts: NDArray[np.floating]) -> Estimate:
    """Standard deviation of frames (frames, samples) that hold nothing else, V."""
    deviation = float(volts.std(ddof=1))
    return Estimate(deviation, deviation / math.sqrt(2 * (volts.size - 1)))


def used_range(twice: NDArray[np.floating], full_scale_v: float) -> Estimate:
    """Part of the full scale between the lowest and the highest signal of all images.

    Frames are means of many triggers, so that noise hardly widens them. Its part at either end, of standard deviation
    s, is seen in the difference of two frames of the brightest samples: sqrt(2) s, as both ends have it.

    Args:
        twice: (2, images, samples) V, two independent means of each image.
        full_scale_v: V.
    """
    mean = twice.mean(axis=0)
    count = min(mean.size, max(FEWEST_BRIGHT, round(BRIGHT * mean.size)))
    brightest = mean >= np.partition(mean, -count, axis=None)[-count]
    spread = float(np.sqrt(np.mean((twice[0] - twice[1])[brightest] ** 2)) / 2)
    return Estimate(float(np.ptp(mean)) / full_scale_v, math.sqrt(2) * spread / full_scale_v)


def flat_top(twice: NDArray[np.floating]) -> bool:
    """Whether images end at one level, as where a detector's amplifier gives no more, or the oscilloscope.

    So they do where they come within `TOP` of their range to the highest signal at `FLAT` times or more. Speckle is
    distributed exponentially: the highest of n independent signals is range / ln n above the next on average,
    and that three more come as near by chance is seen once in thousands of alignments. The range is each image's own:
    one that hardly varies, since the light does not follow the drive, is as near to itself at all times.

    Args:
        twice: (2, images, samples) V, two independent means of each image.
    """
    mean = twice.mean(axis=0)
    near = mean >= mean.max() - TOP * np.ptp(mean, axis=1, keepdims=True)
    return int(np.sum(near.any(axis=0))) >= FLAT


def repeatability_db(volts: NDArray[np.floating]) -> Estimate:
    """Signal to noise of one image, 10 log10 of the ratio of variances, dB; (frames, samples) V, one trigger each.

    Noise: what differs from frame to frame, at each sample. Signal: how the mean frame varies over time, less what is
    left of the noise in it. The uncertainty is the jackknife's over frames (Efron & Tibshirani, 1993, ch. 11).
    """
    exact = np.asarray(volts, np.float64)
    count = len(exact)
    left_out = np.array([_ratio_db(np.delete(exact, one, axis=0)) for one in range(count)])
    return Estimate(_ratio_db(exact), math.sqrt((count - 1) * float(left_out.var())))


def contrast(twice: NDArray[np.floating], dark: Estimate) -> Estimate:
    """How much the signals of images differ: their standard deviation over the mean light, dark level taken off.

    The variance is the mean over time of the covariance of two independent frames of every image, which noise does not
    enter. With variance V of n samples and noise s^2 of a frame its own variance is (2 V s^2 + s^4) / n.

    Args:
        twice: (2, images, samples) V.
        dark: Dark level, V.
    """
    one, other = twice - twice.mean(axis=1, keepdims=True)
    images, samples = one.shape
    variance = max(float(np.sum(one * other)) / ((images - 1) * samples), 0.0)
    square = float(np.mean((twice[0] - twice[1]) ** 2)) / 2
    light = float(twice.mean()) - dark.value
    spread = math.sqrt((2 * variance * square + square**2) / one.size)
    value = math.sqrt(variance) / light
    mean_part = math.hypot(dark.uncertainty, math.sqrt(square / twice.size)) / light
    return Estimate(value, math.hypot(spread / (2 * max(math.sqrt(variance), 1e-30) * light), value * mean_part))


def _ratio_db(volts: NDArray[np.float64]) -> float:
    square = float(volts.var(axis=0, ddof=1).mean())
    signal = float(volts.mean(axis=0).var(ddof=1)) - square / len(volts)
    return 10 * math.log10(max(signal, 1e-30) / max(square, 1e-30))
