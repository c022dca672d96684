"""From the generator's samples to the optical field behind the phase modulator.

Everything is periodic with the drive. Fine grid: `oversampling` points a sample, the first one on the sample's edge.
"""

import math

import numpy as np
from numpy.typing import NDArray


def oversampling(sample_rate: float, largest_step: float) -> int:
    """Grid points per sample so that the step is at most `largest_step` (s) at `sample_rate` (S/s)."""
    return max(1, math.ceil(1.0 / (sample_rate * largest_step) - 1e-9))


def held_and_filtered(
    samples: NDArray[np.float32], *, points_per_sample: int, sample_rate: float, bandwidth_hz: float
) -> NDArray[np.float64]:
    """Zero-order hold and a one-pole output stage, exact at the grid points.

    Within a sample: y(t) = q_n + (s_n - q_n) exp(-t / tau), tau = 1 / (2 pi bandwidth), s_n the value at the sample's
    edge: s_{n+1} = q_n + (s_n - q_n) exp(-T / tau), solved for the periodic sequence with one FFT. No grid point
    carries a held value, so nothing is shifted by half a step.

    Args:
        samples: (n,) volts, one period.
        points_per_sample: grid points a sample.
        sample_rate: S/s.
        bandwidth_hz: -3 dB frequency of the pole.

    Returns:
        (n * points_per_sample,) volts.
    """
    n = samples.size
    q = samples.astype(np.float64)
    tau = 1.0 / (2 * np.pi * bandwidth_hz)
    a = math.exp(-1.0 / (sample_rate * tau))
    turn = np.exp(-2j * np.pi * np.fft.rfftfreq(n))
    edge = np.fft.irfft(np.fft.rfft(q) * (1 - a) * turn / (1 - a * turn), n)
    decay = np.exp(-np.arange(points_per_sample) / (points_per_sample * sample_rate * tau))
    return (q[:, None] + (edge - q)[:, None] * decay).ravel()


def amplified(volts: NDArray[np.float64], *, gain: float, saturation_v: float) -> NDArray[np.float64]:
    """RF driver: V_out = V_sat tanh(gain V_in / V_sat), volts in and out, any shape."""
    return saturation_v * np.tanh(gain / saturation_v * volts)


def one_pole_lowpass(volts: NDArray[np.float64], *, cutoff_hz: float, step: float) -> NDArray[np.float64]:
    """Periodic one-pole low-pass H(f) = 1 / (1 + i f / cutoff) on a grid of `step` (s); shape (n,) in and out."""
    frequency = np.fft.rfftfreq(volts.size, step)
    return np.fft.irfft(np.fft.rfft(volts) / (1 + 1j * frequency / cutoff_hz), volts.size)


def phase_modulated_field(
    volts: NDArray[np.float64], *, v_pi: float, bandwidth_hz: float, step: float
) -> NDArray[np.complex64]:
    """Field behind a LiNbO3 phase modulator, relative to the field in front of it.

    u(t) = exp(i pi (h * V)(t) / V_pi), h one pole at `bandwidth_hz`. Saleh & Teich, ch. 20 (electro-optics).

    Args:
        volts: (n,) at the electrode, one period on a grid of `step` s.
        v_pi: half-wave voltage (V).
        bandwidth_hz: -3 dB frequency.
        step: grid step (s).

    Returns:
        (n,) complex64 of modulus 1.
    """
    phase = np.pi / v_pi * one_pole_lowpass(volts, cutoff_hz=bandwidth_hz, step=step)
    field: NDArray[np.complex64] = np.exp(1j * phase).astype(np.complex64)
    return field
