from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.signal import welch

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
    parts = np.arange(48, dtype=np.float32).reshape(2, 2, 3, 1, 4)
    volts = receiver.fast_volts(parts[0] + 1j * parts[1])
    np.testing.assert_allclose(volts, (parts**2).sum(axis=(0, 2)))


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


@pytest.mark.parametrize("sample_rate", [12.5e9, 25e9, 50e9, 100e9])
def test_coloured_noise_has_the_receiver_s_spectrum_at_any_rate(sample_rate: float) -> None:
    colour = receiver.noise_colour(sample_rate, detector_hz=12e9, scope_hz=25e9)
    white = np.random.default_rng(1).standard_normal((400, 512 + colour.size - 1), dtype=np.float32)
    noise = receiver.coloured(white, colour)
    assert noise.shape == (400, 512)
    assert noise.std() == pytest.approx(1.0, abs=0.01)
    frequency, power = welch(noise, fs=sample_rate, nperseg=64, detrend=False)
    folded = np.zeros_like(frequency)
    for fold in range(-8, 9):
        seen = frequency + fold * sample_rate
        folded += np.exp(-np.log(2) * (seen / 25e9) ** 2) / (1 + (seen / 12e9) ** 2)
    ratio = power.mean(axis=0)[1:-1] / (2 * folded[1:-1] / folded.mean() / sample_rate)
    assert ratio == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("detector_hz", [0.3e9, 1e9, 3e9, 12e9])
def test_noise_behind_a_narrow_detector_is_correlated_for_as_long_as_its_spectrum_says(detector_hz: float) -> None:
    colour = receiver.noise_colour(25e9, detector_hz=detector_hz, scope_hz=25e9).astype(np.float64)
    correlation = np.correlate(colour, colour, "full")[colour.size - 1 :]
    frequency = np.linspace(-200e9, 200e9, 40_001)
    power = np.exp(-np.log(2) * (frequency / 25e9) ** 2) / (1 + (frequency / detector_hz) ** 2)
    expected = [
        np.sum(power * np.cos(2 * np.pi * frequency * lag / 25e9)) / power.sum() for lag in range(correlation.size)
    ]
    assert correlation == pytest.approx(expected, abs=0.01)
    assert colour.sum() ** 2 == pytest.approx(2 * np.sum(expected) - 1, rel=0.02)


def test_samples_far_apart_share_no_noise() -> None:
    """As far as the spectrum is folded for that, and beyond, where it need not be."""
    for sample_rate in (110e6, 90e6, 1e3):
        colour = receiver.noise_colour(sample_rate, detector_hz=12e9, scope_hz=25e9)
        assert colour == pytest.approx([0, 1, 0], abs=1e-6), sample_rate


def test_neighbours_are_correlated_by_little_at_25_gs_and_by_much_at_100() -> None:
    def neighbours(sample_rate: float) -> float:
        colour = receiver.noise_colour(sample_rate, detector_hz=12e9, scope_hz=25e9)
        return float(np.sum(colour[1:] * colour[:-1]))

    assert 0.02 < neighbours(25e9) < 0.15
    assert 0.5 < neighbours(100e9) < 0.8


def law(*, nep: float = 0.0, ase_density: float = 0.0) -> receiver.NoiseLaw:
    return receiver.noise_law(
        ase_density=ase_density,
        ase_bandwidth_hz=100e9,
        bandwidth_hz=12.5e9,
        gain_v_per_w=1e6,
        responsivity=0.9,
        nep=nep,
        rin_per_hz=0.0,
    )


@pytest.mark.parametrize("photons", [0.3, 3.0, 30.0])
def test_a_receiver_that_can_count_gives_poisson_s_numbers(photons: float) -> None:
    counting = law()
    laws = receiver.NoiseLaws.of([counting])
    signal = np.full((20_000, 1, 1), photons * counting.count_v, np.float32)
    unit = np.random.default_rng(2).standard_normal(signal.shape, dtype=np.float32)
    counts = (signal + laws.own_noise(signal, unit)) / counting.count_v
    assert counts == pytest.approx(np.rint(counts), abs=1e-3)
    assert counts.min() >= -1e-3
    assert counts.mean() == pytest.approx(photons, rel=0.05)
    assert counts.var() == pytest.approx(photons, rel=0.05)
    assert np.mean(counts < 0.5) == pytest.approx(np.exp(-photons), abs=0.01)


def test_the_law_of_many_photons_goes_on_where_counting_ends() -> None:
    counting = law()
    laws = receiver.NoiseLaws.of([counting])
    for photons in (99.0, 101.0):
        signal = np.full((20_000, 1, 1), photons * counting.count_v, np.float32)
        unit = np.random.default_rng(3).standard_normal(signal.shape, dtype=np.float32)
        assert laws.own_noise(signal, unit).std() / counting.count_v == pytest.approx(photons**0.5, rel=0.03)


@pytest.mark.parametrize("photons", [0.3, 4.0, 30.0])
def test_a_receiver_that_can_count_has_its_own_noise_beside(photons: float) -> None:
    counting = law(nep=1e-14)
    laws = receiver.NoiseLaws.of([counting])
    own = np.sqrt(counting.floor) / counting.count_v
    assert own > 0.1
    signal = np.full((20_000, 1, 1), photons * counting.count_v, np.float32)
    unit = np.random.default_rng(4).standard_normal(signal.shape, dtype=np.float32)
    noise = laws.own_noise(signal, unit) / counting.count_v
    assert noise.mean() == pytest.approx(0, abs=4 * np.sqrt((photons + own**2) / noise.size))
    assert noise.var() == pytest.approx(photons + own**2, rel=0.05)
    beside = noise - (np.rint(noise + photons) - photons)
    assert own > 0.25 or beside.std() == pytest.approx(own, rel=0.05), "which single photons do not hide"


def test_noise_of_a_real_receiver_hides_the_grains_of_light() -> None:
    assert law(nep=24e-12).count_v == 0
    assert law(ase_density=1e-18).count_v == 0
    assert law().count_v > 0


def test_a_detector_is_one_decibel_short_at_its_limit_and_flat_beyond() -> None:
    found = receiver.limited(np.array([0.0, 0.1, 1.0, 3.0, 100.0, -3.0], np.float32), 1.0)
    assert found[:2] == pytest.approx([0.0, 0.1], rel=1e-3)
    assert 20 * np.log10(found[2]) == pytest.approx(-1.0, abs=0.01)
    assert found[3:] == pytest.approx([1.0, 1.0, -1.0], rel=1e-3)


def test_an_amplifier_that_would_give_twice_its_saturation_power_gives_half_of_it() -> None:
    gain = receiver.saturated_gain(np.array([0, 20e-6, 40e-3], np.float32), 20e-3)
    assert gain == pytest.approx([1, 0.999, 0.5], abs=1e-3)
