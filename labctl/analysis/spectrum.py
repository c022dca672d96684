"""What frequencies signals hold."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEAST_SAMPLES = 4
"""Of a record whose spectrum is worth a look."""


@dataclass(frozen=True)
class Spectrum:
    """Mean spectrum of several records.

    Attributes:
        frequency_hz: (frequencies,) from the first above 0 to half the sample rate.
        density: (ports, frequencies) power spectral density, V^2/Hz.
    """

    frequency_hz: NDArray[np.float64]
    density: NDArray[np.float64]


def spectrum(volts: ArrayLike, sample_interval_s: float) -> Spectrum:
    """Mean periodogram (Hann window, mean taken off) of records (records, ports, samples) in V.

    Records of fewer than two samples have no frequencies. Source: Welch (1967), with one segment a record.
    `scipy.signal.periodogram` gives the same, and takes a second to import where a dashboard starts.

    Example:
        >>> import numpy as np
        >>> from labctl.analysis.spectrum import spectrum
        >>> tone = np.sin(2 * np.pi * 5e9 * np.arange(250) * 40e-12).reshape(1, 1, -1)
        >>> found = spectrum(tone, 40e-12)
        >>> float(found.frequency_hz[found.density[0].argmax()])
        5000000000.0
    """
    records = np.asarray(volts, np.float64)
    samples = records.shape[-1]
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(samples) / samples)
    lines = np.fft.rfft(window * (records - records.mean(axis=-1, keepdims=True)))[..., 1:]
    density = 2 * sample_interval_s * (np.abs(lines) ** 2).mean(axis=0) / (window**2).sum()
    if samples % 2 == 0:
        density[:, -1] /= 2  # half the sample rate stands for itself; every other line for its negative too
    frequency_hz = np.arange(1, density.shape[-1] + 1) / (samples * sample_interval_s)
    return Spectrum(frequency_hz, density)
