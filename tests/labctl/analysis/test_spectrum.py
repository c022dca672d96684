"""Power spectral density of records, beside scipy's."""

import numpy as np
import pytest
from scipy.signal import periodogram

from labctl.analysis.spectrum import LEAST_SAMPLES, spectrum


def test_the_power_of_noise_is_found_in_its_spectrum() -> None:
    noise = np.random.default_rng(1).normal(scale=2e-3, size=(200, 2, 500))
    found = spectrum(noise, 40e-12)
    assert found.frequency_hz[-1] == pytest.approx(12.5e9)
    assert found.density.shape == (2, 250)
    assert found.density.sum(axis=1) * found.frequency_hz[0] == pytest.approx([4e-6, 4e-6], rel=0.02)


@pytest.mark.parametrize("samples", [1, 2, 3, LEAST_SAMPLES, 49, 50, 501])
def test_it_is_the_mean_periodogram_that_others_find(samples: int) -> None:
    records = np.random.default_rng(samples).normal(0.1, 1e-3, (7, 3, samples))
    found = spectrum(records, 40e-12)
    frequency_hz, density = periodogram(records, 1 / 40e-12, window="hann", detrend="constant")
    assert found.frequency_hz == pytest.approx(frequency_hz[1:])
    assert found.density == pytest.approx(density.mean(axis=0)[:, 1:], rel=1e-9, abs=1e-30)
