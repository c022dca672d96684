"""How deep the drive modulates: the static part of the speckle under drives that hop between two phases.

A drive of mean phasor <exp(i phi)> leaves the part f = |<exp(i phi)>|^2 of the speckle's power static: the rest changes
with every symbol and adds up as power. For phases spread evenly over a width w, f = sinc^2(w / 2), sinc x = sin x / x;
for a drive that is at one of two phases d apart half of the time each, f = cos^2(d / 2), steep where it is to be read.
Neighbouring levels of the drive are compared, and every other one: the phases add up, so that

    mean signal at rest - mean signal of the drive = (1 - f) B = sin^2(d / 2) B

tells the phases of all steps and B alike, whatever the amplifier makes of volts. Their sum is the depth, from the
lowest to the highest voltage.

B differs from image to image and is 0 on average: a difference of interferences. A hop takes time: while the fibre
mixes light of before and after, the phase runs along the arc between. With R_k(l) the autocorrelation of exp(i d_k
q(t)), q the pseudorandom sequence held for a time and smoothed by two equal poles (generator, modulator), and delays
spread exponentially with decay T, the differences of one image under drives k, k' have the covariance

    C(k, k') = Re sum_l exp(-|l| / T) (1 - R_k(l)) (1 - R_k'(l))* + noise.

Phases, T, poles and noise are those of largest likelihood, from holds of two lengths; the brightness of each image is
free. The uncertainty has two parts, added in squares: the curvature of the likelihood (Cramer-Rao), and what one pole
fewer or more would change, evenly between the two.

Sources: Goodman, Speckle Phenomena in Optics, ch. 3 (sums with a constant phasor), ch. 5 (temporal smoothing);
GUM (JCGM 100:2008), 4.3.7, for what lies evenly between bounds.
"""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from labctl.analysis.errors import AnalysisError
from labctl.analysis.estimates import Estimate
from labctl.analysis.likelihood import largest_likelihood

STEP_S = 5e-12
RISE_S = 10e-12
"""Time constant of each pole at which the search begins."""
DECAY_S = 0.2e-9
POLES, FEWER, MORE = 2, 1, 3
STARTS = (0.4, 0.8, 1.2, 1.6, 2.0)
"""Phases of a step from which the search begins, rad."""
NOISE = 1e-3
WEAK = 0.5
"""Part of the differences that the strongest pattern of them makes up, at least; of noise it would be a tenth."""


@dataclass(frozen=True)
class DriveDepth:
    """What the mean signals say.

    Attributes:
        depth: From the lowest to the highest level, rad.
        levels: (n,) of the drive's full scale.
        phase: (n,) rad, 0 at the lowest level.
        pairs: (k, 2) places in `levels`.
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
        idle: (traces,) V, the drive at rest; a trace is an image on a channel.
        hopping: (holds, pairs, traces) V.
        pairs: Places in `levels` of each drive's two levels: neighbours, and every other one.
        levels: (n,) of the drive's full scale, ascending.
        hold_s: (holds,) s.
        sequence: (N,) 0 and 1, which of the two levels.

    Raises:
        AnalysisError: The drive does not change the mean signal, or not by what tells its depth.
    """
    differences = np.asarray(idle - np.asarray(hopping, np.float64))
    holds, count, traces = differences.shape
    rows = differences.reshape(-1, traces).T
    strengths = np.linalg.svd(rows, compute_uv=False) ** 2
    if strengths[0] < WEAK * strengths.sum():
        raise AnalysisError("the mean signal does not follow the drive: check modulator and RF amplifier")
    rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    model = _Model(pairs, len(levels), hold_s, np.asarray(sequence, np.float64))
    steps = np.array([*[0.1] * (len(levels) - 1), 0.2, 0.2, 0.5])
    rest = np.log([RISE_S, DECAY_S, NOISE])
    coarse = [np.array([*[start] * (len(levels) - 1), *rest]) for start in STARTS]
    begin = max(coarse, key=lambda parameters: model.alike(parameters, rows))
    found, covariance, _ = largest_likelihood(rows, model.covariance, begin, steps)

    count_of_steps = len(levels) - 1
    fewer, more = (
        largest_likelihood(rows, partial(model.covariance, poles=poles), found, steps)[0][:count_of_steps].sum()
        for poles in (FEWER, MORE)
    )
    chance = math.sqrt(float(covariance[:count_of_steps, :count_of_steps].sum()))
    form = abs(float(fewer - more)) / math.sqrt(12)
    moved, expected = (
        np.sqrt(power / power.max(axis=1, keepdims=True))
        for power in (np.mean(rows**2, axis=0).reshape(holds, count), model.power(found))
    )
    return DriveDepth(
        Estimate(float(found[:count_of_steps].sum()), math.hypot(chance, form)),
        np.asarray(levels, np.float64),
        _phases(found, len(levels)),
        pairs,
        moved,
        expected,
    )


def _phases(parameters: NDArray[np.float64], levels: int) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(parameters[: levels - 1])])


class _Model:
    """Covariance of the differences against steps of phase (rad) and logarithms of poles (s), decay (s), noise (1)."""

    def __init__(
        self,
        pairs: tuple[tuple[int, int], ...],
        levels: int,
        hold_s: tuple[float, ...],
        sequence: NDArray[np.float64],
    ) -> None:
        self._sums = np.array([[low <= step < high for step in range(levels - 1)] for low, high in pairs], np.float64)
        self._held = [np.repeat(sequence, round(hold / STEP_S)) for hold in hold_s]
        self._longest = min(held.size for held in self._held) // 2

    def covariance(self, parameters: NDArray[np.float64], *, poles: int = POLES) -> NDArray[np.float64]:
        """Covariance (holds * pairs, holds * pairs) of traces of unit brightness."""
        light = self._light(parameters, poles)
        noise = np.exp(np.clip(parameters[-1], -40, 5)) / len(light)
        whole: NDArray[np.float64] = light / np.trace(light) + noise * (np.eye(len(light)) + 1)
        return whole

    def alike(self, parameters: NDArray[np.float64], rows: NDArray[np.float64]) -> float:
        """How much of the differences the strongest pattern of the model makes up."""
        strongest = np.linalg.eigh(self._light(parameters, POLES))[1][:, -1]
        return float(np.sum((rows @ strongest) ** 2))

    def power(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean squares of the differences, (holds, pairs)."""
        return np.diagonal(self.covariance(parameters)).reshape(len(self._held), -1)

    def _light(self, parameters: NDArray[np.float64], poles: int) -> NDArray[np.float64]:
        pole, decay, _ = np.exp(np.clip(parameters[-3:], -60, 5))
        steps = self._sums @ parameters[:-3]
        changes = []
        for held in self._held:
            frequency = 2 * np.pi * np.fft.rfftfreq(held.size, STEP_S)
            q = np.fft.irfft(np.fft.rfft(held) / (1 + 1j * frequency * pole) ** poles, held.size)
            spectrum = np.abs(np.fft.fft(np.exp(1j * steps[:, np.newaxis] * q), axis=1) / held.size) ** 2
            changes.append(1 - np.fft.ifft(spectrum, axis=1)[:, : self._longest] * held.size)
        change = np.concatenate(changes)
        weight = np.exp(-STEP_S * np.arange(self._longest) / decay)
        light: NDArray[np.float64] = ((change * weight) @ change.conj().T).real
        return light
