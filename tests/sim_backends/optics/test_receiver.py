from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad

from sim_backends.optics import receiver

Signal = Callable[[NDArray[np.float64]], NDArray[np.float64]]
FAST = {"detector_hz": 12e9, "scope_hz": 25e9}


def make(samples: int = 16, decimation: int = 4, step: float = 10e-12, shift: float = 0.0) -> receiver.SamplingFilter:
    return receiver.sampling_filter(samples=samples, decimation=decimation, step=step, shift_s=shift, **FAST)


def test_noise_bandwidth_is_the_integral_of_the_response() -> None:
    def power(f: float) -> float:
        return float(np.exp(-np.log(2) * (f / 25) ** 2) / (1 + (f / 12) ** 2))

    assert receiver.noise_bandwidth(12e9, 25e9) == pytest.approx(quad(power, 0, 200)[0] * 1e9, rel=1e-6)


def test_impulse_response_has_unit_area_and_the_right_spectrum() -> None:
    time = np.arange(-400, 4000, dtype=np.float64) * 0.1e-12
    h, slope = receiver.impulse_response(time, **FAST)
    assert h.sum() * 0.1e-12 == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(np.gradient(h, 0.1e-12)[5:-5], slope[5:-5], atol=1e-4 * np.abs(slope).max())
    at_12 = abs(np.sum(h * np.exp(-2j * np.pi * 12e9 * time)) * 0.1e-12)
    assert at_12 == pytest.approx(np.sqrt(0.5) * np.exp(-np.log(2) / 2 * (12 / 25) ** 2), rel=1e-4)


def sampled(
    signal: Signal, decimation: int, step: float, shift: float = 0.0, samples: int = 16
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    f = make(samples, decimation, step, shift)
    time = (np.arange(f.points, dtype=np.float64) - f.before) * step
    volts, slope = receiver.apply_filter(f, signal(time).astype(np.float32)[np.newaxis], samples)
    return volts[0], slope[0]


def wave(time: NDArray[np.float64]) -> NDArray[np.float64]:
    return 1 + np.cos(2 * np.pi * 6e9 * time)


def test_taps_are_centred_a_finer_grid_changes_nothing() -> None:
    np.testing.assert_allclose(sampled(wave, 4, 10e-12)[0], sampled(wave, 16, 2.5e-12)[0], atol=2e-3)


def test_samples_are_those_of_the_filtered_wave() -> None:
    response = np.exp(-np.log(2) / 2 * (6 / 25) ** 2) / (1 + 0.5j)
    time = np.arange(16) * 40e-12
    expected = 1 + np.real(response * np.exp(2j * np.pi * 6e9 * time))
    np.testing.assert_allclose(sampled(wave, 4, 10e-12)[0], expected, atol=2e-3)


def test_shift_and_slope_agree() -> None:
    now, slope = sampled(wave, 4, 10e-12)
    later, _ = sampled(wave, 4, 10e-12, shift=1e-12)
    np.testing.assert_allclose(now + 1e-12 * slope, later, atol=2e-3)


def test_constants_pass_and_have_no_slope() -> None:
    volts, slope = sampled(np.ones_like, 4, 10e-12)
    np.testing.assert_allclose(volts, 1.0, atol=1e-6)
    np.testing.assert_allclose(slope * 1e-12, 0.0, atol=1e-6)


def test_a_long_record_begins_with_the_bytes_of_a_short_one() -> None:
    f = make(64)
    signal = np.random.default_rng(0).random((2, 3000)).astype(np.float32)
    long, _ = receiver.apply_filter(f, signal, 700)
    short, _ = receiver.apply_filter(f, signal, 200)
    assert long.shape == (2, 700)
    assert np.array_equal(long[:, :200], short)


def test_noise_terms_are_the_textbook_ones() -> None:
    law = receiver.noise_law(
        ase_density=1e-17,
        ase_bandwidth_hz=100e9,
        bandwidth_hz=12e9,
        gain_v_per_w=600,
        responsivity=0.9,
        nep=24e-12,
        rin_per_hz=1e-15,
    )
    assert law.offset_v == pytest.approx(600e-6)
    power = 50e-6
    beat = 4 * power * 1e-17 * 12e9
    shot = 2 * 1.602e-19 * power / 0.9 * 12e9
    assert law.linear * 600 * power == pytest.approx(600**2 * (beat + shot), rel=1e-3)
    assert np.sqrt(law.floor) / 600 == pytest.approx(2.65e-6, rel=0.05)  # thermal leads


def test_eight_effective_bits_are_a_perfect_digitiser() -> None:
    assert receiver.digitiser_noise_codes(8.0) == 0.0


def test_collected_modes_add_as_powers() -> None:
    field = np.arange(24, dtype=np.float32).reshape(2, 3, 1, 4)
    np.testing.assert_allclose(receiver.fast_volts(field)[0], (field**2).sum(axis=(0, 1, 2)))


@pytest.mark.parametrize("enob", [4.5, 5.5, 7.0])
def test_effective_bits(enob: float) -> None:
    generator = np.random.default_rng(1)
    volts = generator.uniform(-0.4, 0.4, 200_000).astype(np.float32)
    noise = generator.standard_normal(volts.size, dtype=np.float32) * np.float32(receiver.digitiser_noise_codes(enob))
    error = receiver.quantised(volts, noise, 0.1, 0.0, 0.0) * (0.1 / 25) - volts
    assert error.std() == pytest.approx(1.024 / 2**enob / np.sqrt(12), rel=0.01)


@pytest.mark.parametrize("enob", [6.8, 9.0])
def test_effective_bits_of_a_finer_digitiser(enob: float) -> None:
    """Levels of 12 bits fill the upper ones of 16."""
    generator = np.random.default_rng(1)
    volts = generator.uniform(-0.4, 0.4, 200_000).astype(np.float32)
    noise = generator.standard_normal(volts.size, dtype=np.float32) * np.float32(
        receiver.digitiser_noise_codes(enob, 12)
    )
    codes = receiver.quantised(volts, noise, 0.1, 0.0, 0.0, 12)
    assert codes.dtype == np.int16
    assert not (codes % 16).any()
    assert (codes * (0.1 / 6400) - volts).std() == pytest.approx(1.024 / 2**enob / np.sqrt(12), rel=0.01)
    ends = receiver.quantised(np.array([9.0, -9.0], np.float32), np.zeros(2, np.float32), 0.1, 0.0, 0.0, 12)
    assert ends.tolist() == [32752, -32768]


def test_scale_offset_position_and_clipping() -> None:
    volts = np.array([[0.1, 0.2], [9.0, -9.0]], np.float32)
    codes = receiver.quantised(volts, np.zeros_like(volts), scale_v=0.1, offset_v=0.1, position_div=-2.0)
    assert codes.dtype == np.int8
    assert codes.tolist() == [[-50, -25], [127, -128]]
    assert volts[1, 0] == 9.0, "what was measured stays as it was"
