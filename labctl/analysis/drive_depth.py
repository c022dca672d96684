"""How deep the drive modulates: the static part of the speckle under drives that hop between two phases.

A drive of mean phasor <exp(i phi)> leaves the part f = |<exp(i phi)>|^2 of the speckle's power static: the rest changes
with every symbol and adds up as power. For phases spread evenly over a width w, f = sinc^2(w / 2), sinc x = sin x / x;
for a drive that is at one of two phases d apart half of the time each, f = cos^2(d / 2), steep where it is to be read.
Hops of several widths are compared, between neighbouring levels, every other one, and the ends: the phases add up, so
that

    mean signal at rest - mean signal of the drive = (1 - f) B = sin^2(d / 2) B

tells the phases of all steps and B alike, whatever the RF amplifier makes of volts. Their sum is the depth, from the
lowest to the highest voltage.

B differs from image to image and is 0 on average: a difference of interferences. A hop takes time: while the fibre
mixes light of before and after, the phase runs along the arc between. With R_k(l) the autocorrelation of exp(i d_k
q(t)), q the pseudorandom sequence held for a time and smoothed by two equal poles (generator, modulator), and delays
spread exponentially with decay T, the differences of one image of brightness b under drives k, k' have the covariance

    b Re sum_l exp(-|l| / T) (1 - R_k(l)) (1 - R_k'(l))* + s^2 (1 + delta_kk' / n_k),

s^2 the noise of the mean at rest, which all share, n_k how many times longer than that the drive's record is. Phases,
T, poles and s are those of largest likelihood, from holds of two lengths; b is free for each image, any order of
magnitude as likely as another (Jeffreys).

An amplifier behind the fibre that saturates gives a signal V of light P = V (1 + v V), homogeneous saturation by the
mean power, which slow amplifiers go by: bright images move less, and deep hops otherwise than shallow ones. The
likelihood is that of P, in units of V; v is found with the rest.

The depth of a shallow drive hides: sin^2 of a small angle is nearly its square, and hops of twice the width move the
signal four times as far, however wide they are. What tells is the small rest, which goes with the square of the depth.
Its likelihood is no Gaussian there, so that the uncertainty is read where it is to hold: the end of the likelihood
interval of `REACH` standard deviations that is farther away, over `REACH`. To this comes what one pole fewer or more
would change, evenly between the two, in squares. The hop between the ends says most of a shallow drive and nothing of
a deep one, which comes round to where it began; it is left out where it moves the signal less than those half as wide.

Phases come round as well where levels are more than pi apart: x and 8 pi - x are told apart by the arcs alone, which a
longer way along the circle makes last longer. Both are searched, and neither is stated where they fit alike.

Sources: Goodman, Speckle Phenomena in Optics, ch. 3 (sums with a constant phasor), ch. 5 (temporal smoothing);
Jeffreys, Theory of Probability (1961), 3.1; Saleh & Teich, Photonics, ch. 15 (saturation); GUM (JCGM 100:2008), 4.3.7,
for what lies evenly between bounds.
"""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from labctl.analysis.estimates import Estimate
from labctl.analysis.likelihood import interval, lowest
from labctl.errors import AnalysisError

STEP_S = 5e-12
RISE_S = 10e-12
"""Time constant of each pole at which the search begins."""
DECAY_S = 0.2e-9
POLES, FEWER, MORE = 2, 1, 3
STARTS = (0.4, 1.6, 3.2, 4.8, 6.4, 8.0), (14.0, 15.6, 17.2, 18.8, 20.4, 22.0)
"""Depths from which the searches begin, rad: hops of a quarter of less than 4 pi, and of those that go on beyond pi."""
SHALLOWEST = 1e-3
"""Depth (rad) below which all are alike: the rest that tells is a part 1e-7 of the signal."""
NOISE = 1e-3
UNEVEN, POLE, DECAY, SATURATED = 0.02, 0.5, 0.3, 0.1
"""What the parameters behind the depth count in: logarithms of the parts of it, of poles and decay; 1 for noise. The
search for saturation begins where it takes this part of the mean light."""
LEAST_SIGNAL = 1e-3
"""Mean of the signals at rest, in what hops move them by, that light cannot be less than."""
KNOWN, POLE_KNOWN = 30.0, 1.0
"""How well these are known beforehand, one standard deviation. Of the poles more than the signals of a shallow drive
say: what plays and modulates 25 GS/s has 6 to 43 GHz (two standard deviations)."""
REACH = 4.0
WEAK = 0.5
"""Part of the differences that the strongest pattern of them makes up, at least; of noise it would be a quarter."""
BRIGHTNESS = np.geomspace(1e-6, 1e3, 64)
"""Of an image, 1 = the mean of all."""

UNTOLD = "not measured: the mean signals do not tell how deep the drive is: more light, or check the RF amplifier"


@dataclass(frozen=True)
class DriveDepth:
    """What the mean signals say.

    Attributes:
        depth: From the lowest to the highest level, rad.
        levels: (n,) of the drive's full scale.
        phase: (n,) rad, 0 at the lowest level.
        pairs: (k, 2) places in `levels`, of the drives that tell.
        moved: (holds, k) strength of the differences under each drive, the strongest of a hold 1, as measured.
        expected: (holds, k) the same by the phases found.
    """

    depth: Estimate
    levels: NDArray[np.float64]
    phase: NDArray[np.float64]
    pairs: tuple[tuple[int, int], ...]
    moved: NDArray[np.float64]
    expected: NDArray[np.float64]


def drive_depth(
    idle: NDArray[np.floating],
    hopping: NDArray[np.floating],
    *,
    pairs: tuple[tuple[int, int], ...],
    levels: tuple[float, ...],
    hold_s: tuple[float, ...],
    sequence: NDArray[np.floating],
) -> DriveDepth:
    """The depth of a drive from mean signals.

    Args:
        idle: (traces,) V, the drive at rest, as long as a record of the first hold; a trace is an image on a channel.
        hopping: (holds, pairs, traces) V, records as long as their holds.
        pairs: Places in `levels` of each drive's two levels: neighbours, every other one, the ends.
        levels: (n,) of the drive's full scale, ascending.
        hold_s: (holds,) s.
        sequence: (N,) 0 and 1, which of the two levels.

    Raises:
        AnalysisError: The drive does not change the mean signal, or not by what tells its depth.
    """
    differences = np.asarray(idle - np.asarray(hopping, np.float64))
    telling = _telling(differences, pairs)
    pairs = tuple(pair for pair, tells in zip(pairs, telling, strict=True) if tells)
    hopped = np.asarray(hopping, np.float64)[:, telling]
    model = _Model(pairs, len(levels), hold_s, np.asarray(sequence, np.float64), np.asarray(idle, np.float64), hopped)
    strengths = model.strengths()
    if strengths[0] < WEAK * strengths.sum():
        raise AnalysisError(
            "the mean signal does not follow the drive: check modulator and RF amplifier, and that the detector "
            "passes DC"
        )
    rest = np.zeros(len(levels) + 2)
    begun = [min((np.array([start, *rest]) for start in starts), key=model.cost) for starts in STARTS]
    found, other = sorted((_upward(lowest(model.cost, start)) for start in begun), key=model.cost)
    fewer, more = (abs(lowest(partial(model.cost, poles=poles), found)[0]) for poles in (FEWER, MORE))
    low, high = interval(model.cost, found, REACH, least=0.0)
    alike = not low <= other[0] <= high and model.cost(other) < model.cost(found) + REACH**2 / 2
    if alike or not math.isfinite(high):
        raise AnalysisError(UNTOLD)
    depth = float(found[0])
    moved, expected = (np.sqrt(power / power.max(axis=1, keepdims=True)) for power in model.power(found))
    return DriveDepth(
        Estimate(depth, math.hypot(max(depth - low, high - depth) / REACH, float(fewer - more) / math.sqrt(12))),
        np.asarray(levels, np.float64),
        np.concatenate([[0.0], np.cumsum(model.steps(found))]),
        pairs,
        moved,
        expected,
    )


def _upward(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same with a depth above 0, which is as likely."""
    return np.append(abs(parameters[0]), parameters[1:])


def _telling(differences: NDArray[np.float64], pairs: tuple[tuple[int, int], ...]) -> NDArray[np.bool_]:
    """Which drives tell, (pairs,): the widest hop not where it moves the signal less than those half as wide."""
    widths = np.array([high - low for low, high in pairs])
    moved = np.mean(differences**2, axis=(0, 2))
    widest = widths == widths.max()
    half = 2 * widths == widths.max()
    return np.asarray(~widest | (not half.any() or moved[widest].max() > moved[half].max()))


class _Model:
    """Likelihood of the signals at rest (traces,) and hopping (holds, pairs, traces).

    Parameters: depth (rad), logarithms of its first parts against the last, of pole, decay and noise, and saturation,
    each about where the search begins and in the units above; saturation as a logarithm.
    """

    def __init__(
        self,
        pairs: tuple[tuple[int, int], ...],
        levels: int,
        hold_s: tuple[float, ...],
        sequence: NDArray[np.float64],
        idle: NDArray[np.float64],
        hopping: NDArray[np.float64],
    ) -> None:
        self._sums = np.array([[low <= step < high for step in range(levels - 1)] for low, high in pairs], np.float64)
        self._held = [np.repeat(sequence, round(hold / STEP_S)) for hold in hold_s]
        self._longest = min(held.size for held in self._held) // 2
        self._noise = 1 + np.diag(np.repeat([self._held[0].size / held.size for held in self._held], len(pairs)))
        variances, directions = np.linalg.eigh(self._noise)
        self._whitening = (directions / np.sqrt(variances)) @ directions.T
        self._known = np.array([*[KNOWN] * (levels - 2), POLE_KNOWN, KNOWN, KNOWN, KNOWN])
        unit = math.sqrt(np.mean((idle - hopping) ** 2))
        self._idle, self._hopping = idle / unit, hopping.reshape(-1, idle.size) / unit
        self._mean = float(np.mean(self._idle))

    def cost(self, parameters: NDArray[np.float64], *, poles: int = POLES) -> float:
        """Minus the logarithm of the likelihood."""
        light = self._whitening @ self._light(parameters, poles) @ self._whitening
        variances, directions = np.linalg.eigh(light)
        spread = np.multiply.outer(BRIGHTNESS, np.clip(variances, 0, None)) + _noise(parameters)
        moved = self._moved(parameters) @ self._whitening @ directions
        costs = (np.log(spread).sum(axis=1)[:, np.newaxis] + (1 / spread) @ (moved**2).T) / 2
        stretched = np.log1p(2 * self._saturation(parameters) * np.maximum(self._hopping, 0)).sum()
        return float(-logsumexp(-costs, axis=0).sum() - stretched + np.sum((parameters[1:] / self._known) ** 2) / 2)

    def strengths(self) -> NDArray[np.float64]:
        """Of the patterns in the differences, the strongest first, each as if all had noise of their own alone."""
        differences = self._whitening @ (self._idle - self._hopping)
        strengths: NDArray[np.float64] = np.linalg.svd(differences, compute_uv=False) ** 2
        return strengths

    def steps(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """Phase from each level to the next, rad."""
        parts = np.exp(UNEVEN * np.append(parameters[1:-4], -parameters[1:-4].sum()))
        steps: NDArray[np.float64] = max(abs(float(parameters[0])), SHALLOWEST) * parts / parts.sum()
        return steps

    def power(self, parameters: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean squares of the differences, as measured and as expected, (holds, pairs) each."""
        noise = _noise(parameters) * np.diagonal(self._noise)
        moved = np.mean(self._moved(parameters) ** 2, axis=0)
        light = np.diagonal(self._light(parameters, POLES)) / moved.size
        expected = noise + max(0.0, float((moved - noise).sum())) * light
        shape = len(self._held), -1
        return moved.reshape(shape), expected.reshape(shape)

    def _saturation(self, parameters: NDArray[np.float64]) -> float:
        """The v of P = V (1 + v V), where the mean square of the differences of V is 1."""
        return SATURATED * math.exp(np.clip(parameters[-1], -10, 2)) / max(self._mean, LEAST_SIGNAL)

    def _moved(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """By how much the light at rest is more than the hopping one, (traces, holds * pairs)."""
        saturation = self._saturation(parameters)
        rest, hopping = (signal * (1 + saturation * signal) for signal in (self._idle, self._hopping))
        return np.asarray((rest - hopping).T)

    def _light(self, parameters: NDArray[np.float64], poles: int) -> NDArray[np.float64]:
        """Covariance of the differences of an image of brightness 1 without noise; its trace is its size."""
        pole, decay = np.exp(np.clip(np.array([POLE, DECAY]) * parameters[-4:-2], -7, 4)) * (RISE_S, DECAY_S)
        hops = self._sums @ self.steps(parameters)
        changes = []
        for held in self._held:
            frequency = 2 * np.pi * np.fft.rfftfreq(held.size, STEP_S)
            q = np.fft.irfft(np.fft.rfft(held) / (1 + 1j * frequency * pole) ** poles, held.size)
            spectrum = np.abs(np.fft.fft(np.exp(1j * hops[:, np.newaxis] * q), axis=1) / held.size) ** 2
            changes.append(1 - np.fft.ifft(spectrum, axis=1)[:, : self._longest] * held.size)
        change = np.concatenate(changes)
        weight = np.exp(-STEP_S * np.arange(self._longest) / decay)
        light: NDArray[np.float64] = ((change * weight) @ change.conj().T).real
        light *= len(light) / np.trace(light)
        return light


def _noise(parameters: NDArray[np.float64]) -> float:
    """Variance of the noise of the mean at rest, 1 = mean square of the differences."""
    return float(NOISE * np.exp(np.clip(parameters[-2], -18, 10)))
