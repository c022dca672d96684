"""When the light of a drive arrives: from responses to a two-level pseudorandom drive, to a few picoseconds.

A drive hops between two phases, +d/2 and -d/2 about a mean, by a maximum-length sequence s. The field at the detector
is a sum over the light's paths, E(t) = sum_j h_j exp(i d s(t - tau_j) / 2), and half of what changes in the intensity
when the drive is turned upside down is linear in s, whatever d is:

    (I_s - I_-s) / 2 = sin(d) Re[i H* sum_j h_j s(t - tau_j)],   H = sum_j h_j

Its circular correlation with s is the response k(t) of one image: rest until the first light, then a random walk's
steps (the speckle of each delay), smoothed by the electronics. Nothing is assumed of any image.

Over independent images the steps are Gaussian, with a power that falls as exp(-u / T) behind the first light. A sample
is held for its time; generator, modulator and detector answer with a pole each, taken as equal; the oscilloscope has a
Gaussian response of its bandwidth, which begins before its centre and counts as no delay. The first arrival D, decay,
poles and a white remainder are those of largest likelihood: covariance of k at times t, t'

    C(t, t') = sum_u p(u) g(t - D - u) g(t' - D - u) - m(t) m(t') + remainder + noise,   m(t) = sum_u p(u) g(t - D - u)

(m: the responses of one image add up to nothing, Im[H* H] = 0). The noise of each response is seen where no light is,
its brightness is free. The uncertainty has two parts, added in squares. Chance: the curvature of the likelihood, all
parameters free together, times the Birge ratio by which the mean power of the responses strays further from the model
than independent images would; the modes of one fibre are the same for all images. Form: with one pole fewer or more the
delay is another; even between the two.

Sources: Golomb, Shift Register Sequences (1967) for the correlation; Goodman, Speckle Phenomena in Optics, ch. 3;
Rasmussen & Williams, Gaussian Processes for Machine Learning (2006), ch. 5, for the likelihood; Birge, Phys. Rev. 40,
207 (1932); GUM (JCGM 100:2008), 4.3.7, for what lies evenly between bounds.
"""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc

from labctl.analysis.estimates import Estimate
from labctl.analysis.likelihood import largest_likelihood
from labctl.errors import AnalysisError

GRID = 8
"""Steps of the light's grid in a sample of the responses."""
BEFORE_S, BEHIND_S = 0.12e-9, 0.8e-9
"""What is looked at of a response, about its edge."""
SEARCHED_S, QUIET_S = 1.5e-9, 1.5e-9
"""So long before its highest point the edge is looked for; for so long before that there is noise alone."""
STEEP = 0.05
"""Part of the highest power that certainly is light."""
POLES, FEWER, MORE = 3.0, 2.0, 4.0
STEPS = np.array([3e-12, 0.1, 0.1, 0.5])
"""How far each parameter may be off at first: delay, and the logarithms of decay, poles' time constant, remainder."""
REST = 6.0
"""How far the highest power of the responses exceeds that before it, at least."""
UNEXPLAINED = 1e-3
"""Part of a response's energy that the model may leave out, at first."""


@dataclass(frozen=True)
class LightDelay:
    """What the responses say.

    Attributes:
        delay: First light after the trigger, s.
        decay: Time in which the power of the response falls to 1/e, s.
        rise: Mean delay of the electronics behind the first light, s.
        time_s: (k,) of the shown responses, s.
        power: (k,) mean power of the responses, each of unit energy.
        expected: (k,) the same at the largest likelihood.
    """

    delay: Estimate
    decay: Estimate
    rise: Estimate
    time_s: NDArray[np.float64]
    power: NDArray[np.float64]
    expected: NDArray[np.float64]


def responses(
    upright: NDArray[np.floating], inverted: NDArray[np.floating], sequence: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Response of each image to one sample of the drive.

    With a maximum-length sequence of N samples and circular correlations C_ss = N at 0 and -1 elsewhere, the response
    is (1 / (N + 1)) times the correlation, up to a constant that is 0 where the response adds up to nothing.

    Args:
        upright: (images, samples) V, one period of the drive, a whole number of samples for each of its own.
        inverted: (images, samples) V, the same with the drive upside down.
        sequence: (N,) the drive, 1 and -1.

    Returns:
        (images, samples) V, of one period from the trigger on.
    """
    half = (np.asarray(upright, np.float64) - inverted) / 2
    folded = half.reshape(len(half), sequence.size, -1)
    spectrum = np.fft.fft(folded, axis=1) * np.conj(np.fft.fft(sequence))[:, np.newaxis]
    found: NDArray[np.float64] = np.fft.ifft(spectrum, axis=1).real / (sequence.size + 1)
    return found.reshape(half.shape)


def light_delay(responses_v: NDArray[np.floating], *, interval_s: float, hold_s: float, scope_hz: float) -> LightDelay:
    """First light, modulo the period, from the responses of many images.

    Args:
        responses_v: (images, samples), one period from the trigger on.
        interval_s: From sample to sample, s.
        hold_s: How long the drive holds a sample, s.
        scope_hz: Bandwidth of the oscilloscope, -3 dB, Hz.

    Raises:
        AnalysisError: the responses hold no light that follows the drive.
    """
    energy = np.sum(np.asarray(responses_v, np.float64) ** 2, axis=1, keepdims=True)
    if not np.all(energy > 0):
        raise AnalysisError("the light does not follow the drive: check modulator and RF amplifier")
    whole = responses_v / np.sqrt(energy)
    power = np.mean(whole**2, axis=0)
    highest = int(np.argmax(power))
    back, away = round(SEARCHED_S / interval_s), round(QUIET_S / interval_s)
    quiet = (highest - back - away + np.arange(away)) % power.size
    before = np.arange(highest - back, highest + 1)
    edge = int(before[np.argmax(power[before % power.size] > STEEP * power[highest])])
    if power[highest] < REST * power[quiet].max():
        raise AnalysisError("the light does not follow the drive: check modulator and RF amplifier")
    places = np.arange(-round(BEFORE_S / interval_s), round(BEHIND_S / interval_s) + 1)
    shown = whole[:, (edge + places) % power.size]
    energy = np.sum(shown**2, axis=1, keepdims=True)
    shown /= np.sqrt(energy)
    noise = np.mean(whole[:, quiet] ** 2, axis=1) / energy[:, 0]
    time_s = np.asarray(places * interval_s, np.float64)
    start = np.array([-hold_s, *np.log([4 * hold_s, hold_s / 4, UNEXPLAINED])])
    models = {
        poles: partial(_covariance, time_s=time_s, hold_s=hold_s, scope_hz=scope_hz, poles=poles)
        for poles in (POLES, FEWER, MORE)
    }
    found, covariance, _ = largest_likelihood(shown, models[POLES], start, STEPS, noise=noise)
    fewer, more = (largest_likelihood(shown, models[poles], found, STEPS, noise=noise)[0][0] for poles in (FEWER, MORE))
    expected = models[POLES](found)
    deviation = np.sqrt(np.diagonal(covariance)) * _birge_ratio(shown, expected, found.size)
    form = abs(float(fewer - more)) / math.sqrt(12)
    decay, width = np.exp(found[1:3])
    return LightDelay(
        Estimate(float(edge * interval_s + found[0]), math.hypot(deviation[0], form)),
        Estimate(float(decay), float(decay * deviation[1])),
        Estimate(float(POLES * width), float(POLES * width * deviation[2])),
        edge * interval_s + time_s,
        np.mean(shown**2, axis=0),
        np.asarray(np.diagonal(expected)),
    )


def _birge_ratio(shown: NDArray[np.float64], expected: NDArray[np.float64], parameters: int) -> float:
    """How much further than by chance the mean power strays from what is expected of it, at least 1."""
    power = np.diagonal(expected)
    lit = power > STEEP * power.max()
    strays = (np.mean(shown**2, axis=0) / power - 1)[lit]
    alike = (expected / np.sqrt(np.outer(power, power)))[np.ix_(lit, lit)] ** 2
    square = strays @ np.linalg.solve(2 * alike / len(shown), strays)
    return math.sqrt(max(1.0, float(square) / max(1, strays.size - parameters)))


def _covariance(
    parameters: NDArray[np.float64], *, time_s: NDArray[np.float64], hold_s: float, scope_hz: float, poles: float
) -> NDArray[np.float64]:
    """Covariance (k, k) of responses of unit energy."""
    delay = parameters[0]
    decay, width, noise = np.exp(np.clip(parameters[1:], -60, 10))
    step = float(time_s[1] - time_s[0]) / GRID
    grid = np.arange(time_s.size * GRID)
    smear = math.sqrt(math.log(2)) / (2 * math.pi * scope_hz)
    reach = math.ceil(4 * smear / step)
    weights = np.exp(-0.5 * (step * np.arange(-reach, reach + 1) / smear) ** 2)
    behind = time_s[0] - delay + step * np.arange(-grid.size - reach, grid.size + reach)
    reached = gammainc(poles, np.clip(behind, 0, None) / width)
    answer = reached - gammainc(poles, np.clip(behind - hold_s, 0, None) / width)
    smooth = np.convolve(answer, weights / weights.sum(), "valid")
    g = smooth[GRID * np.arange(time_s.size)[:, np.newaxis] - grid + grid.size]
    p = np.exp(-step * grid / decay)
    p /= p.sum()
    mean = g @ p
    light = (g * p) @ g.T - np.outer(mean, mean)
    light /= max(float(np.trace(light)), np.finfo(np.float64).tiny)
    covariance: NDArray[np.float64] = light + (noise / time_s.size) * np.eye(time_s.size)
    return covariance
