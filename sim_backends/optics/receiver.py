"""Preamplifier's saturation and noise, photodetector, oscilloscope front end and digitiser.

Sources: Saleh & Teich, ch. 18 (photodetector noise) and ch. 15 (amplifier noise); Olsson, J. Lightwave Technol. 7, 1071
(1989) for the beat noise of optical amplifiers; IEEE 1241 for the effective number of bits; Rapp, Proc. 2nd European
Conference on Satellite Communications, 179 (1991) for the compression of amplifiers.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx, log_ndtr, ndtr, ndtri

ELEMENTARY_CHARGE = 1.602176634e-19
CODES_PER_DIVISION = 25
DIVISIONS = 10.24
COUNTED_PHOTONS = 100.0
"""Below so many photoelectrons in a receiver's resolution time light comes in grains that a Gaussian does not show."""
_HIDDEN_GRAINS = 10.0  # photoelectrons, rms, of other noise, in which no single one is seen
_UNIFORM = (1e-6, 1 - 1e-6)  # what rounding leaves of a probability
_UNLIMITED = 2**-4  # of a limit: less is what it is, the law's denominator rounds to 1
_NOISE_REACH_S = 0.3e-9  # noise is followed over so long at least, half of it either way
_FOLDED_WHITE = 1024  # times that its spectrum is folded back: samples are so far apart that they share none of it


def gaussian_time_width(bandwidth_hz: float) -> float:
    """Standard deviation (s) of the impulse response of a Gaussian filter with -3 dB at `bandwidth_hz`."""
    return math.sqrt(math.log(2.0)) / (2 * math.pi * bandwidth_hz)


def noise_bandwidth(detector_hz: float, scope_hz: float) -> float:
    """Noise-equivalent bandwidth (Hz) of a one-pole detector and a Gaussian oscilloscope in series.

    B = integral of exp(-ln2 (f/f_s)^2) / (1 + (f/f_d)^2) df = (pi f_d / 2) exp(a^2) erfc(a), a = sqrt(ln2) f_d / f_s.
    """
    a = math.sqrt(math.log(2.0)) * detector_hz / scope_hz
    return math.pi * detector_hz / 2 * float(erfcx(a))


def impulse_response(
    seconds: NDArray[np.float64], *, detector_hz: float, scope_hz: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Impulse response (1/s) of detector and oscilloscope, and its time derivative (1/s^2), at `seconds`.

    One pole (tau = 1 / (2 pi f_d)) convolved with a Gaussian g of width s, Phi being the normal distribution:
    h(t) = exp(s^2 / (2 tau^2) - t / tau) Phi(t / s - s / tau) / tau,  h' = (g - h) / tau.
    """
    tau, s = 1.0 / (2 * np.pi * detector_hz), gaussian_time_width(scope_hz)
    late = np.maximum(seconds, -8 * s)  # earlier, h is 0
    h = np.exp(s * s / (2 * tau * tau) - late / tau + log_ndtr(late / s - s / tau)) / tau
    gauss = np.exp(-0.5 * (seconds / s) ** 2) / (s * math.sqrt(2 * math.pi))
    return h, (gauss - h) / tau


def fast_volts(field: NDArray[np.complex64]) -> NDArray[np.float32]:
    """Volts behind an infinitely fast detector: |E|^2, collected modes added as powers.

    Root volts (..., modes, channels, K) complex -> (..., channels, K).
    """
    volts = np.square(field.real)
    volts += np.square(field.imag)
    return volts[..., 0, :, :] if volts.shape[-3] == 1 else volts.sum(axis=-3)


@dataclass(frozen=True, eq=False)
class SamplingFilter:
    """Filter and decimation as one matrix for a block of samples.

    `matrix` (points, 2 * samples) float32: left half intensities -> volts, right half their time derivative (per s).
    Point `before` of the grid coincides with the first sample, later samples follow every `decimation` points.
    """

    matrix: NDArray[np.float32]
    points: int
    samples: int
    decimation: int
    before: int


def sampling_filter(
    *, samples: int, decimation: int, step: float, shift_s: float, detector_hz: float, scope_hz: float
) -> SamplingFilter:
    """Matrix that takes intensities on a grid of `step` s to `samples` filtered samples every `decimation` points.

    Taps are centred on the grid points, so that a finer grid gives the same samples; their sum is 1 (a constant
    passes unchanged). `shift_s`: samples are taken this much later than their grid point, at most about two samples.
    """
    tau, reach_s = 1.0 / (2 * np.pi * detector_hz), 4.5 * gaussian_time_width(scope_hz)
    before = math.ceil((max(12.0 * tau, reach_s + 6.0 * tau) + max(-shift_s, 0.0)) / step)
    after = math.ceil((reach_s + max(shift_s, 0.0)) / step)
    points = (samples - 1) * decimation + 1 + before + after
    lag = (before + decimation * np.arange(samples)[None, :] - np.arange(points)[:, None]) * step + shift_s
    h, slope = impulse_response(np.asarray(lag, np.float64), detector_hz=detector_hz, scope_hz=scope_hz)
    total = h.sum(axis=0)
    slope = slope - h * (slope.sum(axis=0) / total)  # a constant has no slope
    matrix = np.concatenate([h / total, slope / total], axis=1).astype(np.float32)
    matrix[np.abs(matrix) < np.finfo(np.float32).tiny] = 0  # far from a sample; processors are slow with such numbers
    return SamplingFilter(matrix, points, samples, decimation, before)


def apply_filter(
    sampling: SamplingFilter, intensities: NDArray[np.float32], samples: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Filter and decimate intensities of shape (..., channels, points) to `samples`: values and time derivatives (1/s).

    Long records run through the same matrix block by block, and every image by itself: neither a record's length nor
    the number of images changes a byte of what they share.
    """
    blocks = -(-samples // sampling.samples)
    advance = sampling.samples * sampling.decimation
    wanted = (blocks - 1) * advance + sampling.points
    if wanted > intensities.shape[-1]:
        given, intensities = intensities, np.zeros((*intensities.shape[:-1], wanted), np.float32)
        intensities[..., : given.shape[-1]] = given
    windows = np.lib.stride_tricks.sliding_window_view(intensities, sampling.points, axis=-1)
    windows = np.swapaxes(windows[..., : blocks * advance : advance, :], -3, -2)
    # One product a picture and block: BLAS sums in another order for other numbers of rows.
    filtered = np.matmul(windows, sampling.matrix).reshape(*windows.shape[:-1], 2, sampling.samples)
    both = np.moveaxis(filtered, (-2, -4), (0, -2)).reshape(2, *intensities.shape[:-1], -1)
    volts, slope = both[..., :samples]
    return volts, slope


@dataclass(frozen=True)
class NoiseLaw:
    """Variance of the receiver's noise at signal volts v: floor + linear v + quadratic v^2 (V^2, V, 1).

    The quadratic part is the laser's: one fluctuation for all receivers. `offset_v`: mean volts of the amplified
    spontaneous emission, present without any signal. `count_v`: volts of one photoelectron in the resolution time
    1 / (2 B), for a receiver that can tell; 0 for one whose other noise hides it.
    """

    floor: float
    linear: float
    quadratic: float
    offset_v: float
    count_v: float


@dataclass(frozen=True, eq=False)
class NoiseLaws:
    """The laws of some receivers, each of `NoiseLaw`'s numbers as (receivers, 1) float32."""

    floor: NDArray[np.float32]
    linear: NDArray[np.float32]
    quadratic: NDArray[np.float32]
    offset_v: NDArray[np.float32]
    count_v: NDArray[np.float32]

    @classmethod
    def of(cls, laws: Sequence[NoiseLaw]) -> Self:
        """Several laws side by side."""

        def column(values: list[float]) -> NDArray[np.float32]:
            return np.array(values, np.float32)[:, np.newaxis]

        return cls(
            column([law.floor for law in laws]),
            column([law.linear for law in laws]),
            column([law.quadratic for law in laws]),
            column([law.offset_v for law in laws]),
            column([law.count_v for law in laws]),
        )

    def own_noise(self, signal: NDArray[np.float32], unit: NDArray[np.float32]) -> NDArray[np.float32]:
        """Noise (V) of each receiver by itself at `signal` volts, from Gaussian noise of unit variance; (..., samples).

        Where a receiver can count and less than `COUNTED_PHOTONS` arrive, the light's part is Poisson's: the quantile
        of the count at the probability of the Gaussian one. Where in the count's step this probability lies is uniform
        and independent of the count: it is the probability of the receiver's noise, which is white then.
        """
        if not self.count_v.any():
            return np.asarray(np.sqrt(self.floor + self.linear * signal) * unit)
        from scipy.stats import poisson  # which takes as long to import as all else that a simulated bench needs

        expected = signal / np.where(self.count_v > 0, self.count_v, np.inf)
        counted = (expected > 0) & (expected < COUNTED_PHOTONS)
        noise = np.sqrt(self.floor + self.linear * signal) * unit
        probability, mean = ndtr(unit[counted].astype(np.float64)), expected[counted]
        count = poisson.ppf(probability, mean)
        place = (probability - poisson.cdf(count - 1, mean)) / poisson.pmf(count, mean)
        own = ndtri(np.clip(place, *_UNIFORM)) * np.sqrt(np.broadcast_to(self.floor, signal.shape)[counted])
        noise[counted] = (count - mean) * np.broadcast_to(self.count_v, signal.shape)[counted] + own
        return np.asarray(noise, np.float32)


def noise_law(
    *,
    ase_density: float,
    ase_bandwidth_hz: float,
    bandwidth_hz: float,
    gain_v_per_w: float,
    responsivity: float,
    nep: float,
    rin_per_hz: float,
) -> NoiseLaw:
    """Noise of a direct-detection receiver behind an optical amplifier, as input power variance times gain^2.

    thermal NEP^2 B; shot 2 q P B / R; signal-ASE beat 4 P S B; ASE-ASE beat 2 S^2 (B_o - B/2) B; RIN P^2 B; mean ASE
    power S B_o (one polarisation: waveguides and collected mode are polarised).

    Args:
        ase_density: S at the detector (W/Hz).
        ase_bandwidth_hz: optical bandwidth B_o.
        bandwidth_hz: electrical noise bandwidth B.
        gain_v_per_w: conversion gain.
        responsivity: A/W.
        nep: noise-equivalent power (W/rtHz).
        rin_per_hz: relative intensity noise (1/Hz).
    """
    ase_power = ase_density * ase_bandwidth_hz
    shot = 2 * ELEMENTARY_CHARGE / responsivity * bandwidth_hz
    beat = 2 * ase_density**2 * (ase_bandwidth_hz - bandwidth_hz / 2) * bandwidth_hz
    floor = gain_v_per_w**2 * (nep**2 * bandwidth_hz + beat + shot * ase_power)
    count_v = gain_v_per_w * shot
    return NoiseLaw(
        floor=floor,
        linear=gain_v_per_w * (shot + 4 * ase_density * bandwidth_hz),
        quadratic=rin_per_hz * bandwidth_hz,
        offset_v=gain_v_per_w * ase_power,
        count_v=count_v if ase_density == 0 and math.sqrt(floor) < _HIDDEN_GRAINS * count_v else 0.0,
    )


def noise_colour(sample_rate: float, *, detector_hz: float, scope_hz: float) -> NDArray[np.float32]:
    """Symmetric filter that gives white noise at `sample_rate` the spectrum of the receiver, and variance 1.

    The receiver's noise has the power spectrum exp(-ln2 (f / f_s)^2) / (1 + (f / f_d)^2), folded back at half the
    sample rate. The filter is the Fourier transform of its square root: at 25 GS/s neighbours are correlated by a
    tenth, at 100 GS/s by two thirds.
    """
    reach_s = max(_NOISE_REACH_S, 12 * gaussian_time_width(scope_hz), 12 / (2 * np.pi * detector_hz))
    points = 2 * math.ceil(reach_s * sample_rate / 2) + 1
    if 4 * scope_hz > _FOLDED_WHITE * sample_rate:
        white = np.zeros(points, np.float32)
        white[points // 2] = 1
        return white
    frequency = np.fft.fftfreq(max(4096, 4 * points), 1 / sample_rate)
    folds = math.ceil(4 * scope_hz / sample_rate)
    shifted = frequency[:, np.newaxis] + sample_rate * np.arange(-folds, folds + 1)
    power = (np.exp2(-((shifted / scope_hz) ** 2)) / (1 + (shifted / detector_hz) ** 2)).sum(axis=1)
    taps = np.fft.fftshift(np.fft.ifft(np.sqrt(power)).real)
    middle = taps.size // 2
    taps = taps[middle - points // 2 : middle + points // 2 + 1]
    return np.asarray(taps / np.linalg.norm(taps), np.float32)


def coloured(white: NDArray[np.float32], colour: NDArray[np.float32]) -> NDArray[np.float32]:
    """White noise of unit variance, (..., samples + taps - 1), through a `noise_colour`: (..., samples)."""
    reach = colour.size // 2
    if reach == 0:
        return white
    samples = white.shape[-1] - 2 * reach
    filtered: NDArray[np.float32] = white[..., reach : reach + samples] * colour[reach]
    for away in range(1, reach + 1):
        pair = white[..., reach - away : reach - away + samples] + white[..., reach + away : reach + away + samples]
        pair *= colour[reach + away]
        filtered += pair
    return filtered


def saturated_gain(power_w: NDArray[np.float32], saturation_w: float) -> NDArray[np.float32]:
    """Gain over the small-signal gain of an amplifier that would give `power_w` without saturation, any shape.

    G = G_0 / (1 + P_out / P_sat), P_out = G P_in: homogeneous saturation (Saleh & Teich, ch. 15) by the mean power,
    because erbium answers within a millisecond or so and no faster.
    """
    return np.asarray(2 / (1 + np.sqrt(1 + 4 * power_w / np.float32(saturation_w))))


def limited(volts: NDArray[np.float32], limit_v: float) -> NDArray[np.float32]:
    """What an amplifier makes of `volts` that it would give without limit: v / (1 + (v / limit)^6)^(1/6) (Rapp, p = 3).

    It is 1 dB short of linear at the limit, and flat beyond.
    """
    out = np.array(volts, np.float32)
    strong = np.abs(out) > np.float32(_UNLIMITED * limit_v)
    cubed = out[strong] / np.float32(limit_v)
    cubed *= cubed * cubed
    out[strong] /= np.cbrt(np.sqrt(1 + np.square(cubed)))
    return out


def digitiser_noise_codes(enob: float, bits: int = 8) -> float:
    """Rms noise in front of a quantiser (its levels) that makes its total error the one of `enob` effective bits.

    Total: FS / 2^ENOB / sqrt(12), FS = 10.24 div = 2^bits levels; the quantiser's own 1/12 level^2 is part of it.
    """
    return math.sqrt(max(0.0, (digitiser_levels(bits) * DIVISIONS / 2**enob) ** 2 - 1.0) / 12.0)


def quantised(
    volts: NDArray[np.float32],
    noise: NDArray[np.float32],
    scale_v: float,
    offset_v: float,
    position_div: float,
    bits: int = 8,
) -> NDArray[np.int8] | NDArray[np.int16]:
    """What the digitiser of one channel makes of `volts`, any shape, with as much `noise` in its levels before it.

    code = round((v - offset) 25 / scale + 25 position + noise), clipped to -128..127: 25 codes a division, 10.24
    divisions. Of more than 8 bits levels are as much finer, and fill the upper bits of int16: a code of 8 bits is one
    of 256 such.
    """
    levels = digitiser_levels(bits)
    exact = volts - np.float32(offset_v)
    exact *= np.float32(levels / scale_v)
    exact += np.float32(levels * position_div)
    exact += noise
    np.rint(exact, out=exact)
    half = 2 ** (bits - 1)
    np.clip(exact, -half, half - 1, out=exact)
    return exact.astype(np.int8) if bits == 8 else exact.astype(np.int16) << 16 - bits


def digitiser_levels(bits: int) -> int:
    """Levels a division."""
    return CODES_PER_DIVISION << bits - 8
