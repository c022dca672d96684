import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim_backends.optics import drive

RATE, STEP, POINTS = 25e9, 5e-12, 8


def held(samples: NDArray[np.float32], points: int = POINTS, bandwidth: float = 14e9) -> NDArray[np.float64]:
    return drive.held_and_filtered(samples, points_per_sample=points, sample_rate=RATE, bandwidth_hz=bandwidth)


@pytest.mark.parametrize(("rate", "points"), [(25e9, 8), (12.5e9, 16), (24e9, 9), (1.49e3, 134228188), (1e12, 1)])
def test_grid_step_is_at_most_five_picoseconds(rate: float, points: int) -> None:
    assert drive.oversampling(rate, STEP) == points


def test_step_response_starts_on_the_sample_edge_and_is_exact() -> None:
    samples = np.zeros(200, np.float32)
    samples[100:] = 1.0
    tau = 1 / (2 * np.pi * 14e9)
    time = np.arange(50) * STEP
    np.testing.assert_allclose(held(samples)[800:850], 1 - np.exp(-time / tau), atol=1e-7)


def test_a_symbol_settles_to_98_percent_at_16_ghz() -> None:
    samples = np.zeros(64, np.float32)
    samples[10] = 1.0
    assert held(samples, bandwidth=16e9)[11 * POINTS] == pytest.approx(0.982, abs=1e-3)


def test_a_finer_grid_gives_the_same_values_unshifted() -> None:
    samples = np.random.default_rng(0).uniform(-1, 1, 250).astype(np.float32)
    np.testing.assert_allclose(held(samples, 16)[::2], held(samples, 8), atol=1e-12)


@given(st.floats(-0.25, 0.25, width=32))
def test_a_constant_passes(value: float) -> None:
    np.testing.assert_allclose(held(np.full(16, value, np.float32)), value, atol=1e-9)


def test_half_a_volt_makes_two_half_wave_voltages() -> None:
    swing = np.ptp(drive.amplified(np.array([-0.25, 0.25]), gain=17.8, saturation_v=8.0))
    assert swing == pytest.approx(8.1, abs=0.05)


def test_one_pole_is_3_db_down_and_45_degrees_late_at_its_cutoff() -> None:
    time = np.arange(4000) * STEP
    volts = np.cos(2 * np.pi * 16e9 * time)
    out = drive.one_pole_lowpass(volts, cutoff_hz=16e9, step=STEP)
    np.testing.assert_allclose(out, np.cos(2 * np.pi * 16e9 * time - np.pi / 4) / np.sqrt(2), atol=1e-9)


def test_phase_modulation_conserves_power() -> None:
    volts = np.random.default_rng(1).uniform(-4, 4, 512)
    field = drive.phase_modulated_field(volts, v_pi=4.0, bandwidth_hz=16e9, step=STEP)
    np.testing.assert_allclose(np.abs(field), 1.0, atol=1e-6)


@pytest.mark.parametrize("depth", [np.pi / 2, np.pi, 3.0, 2 * np.pi])
def test_static_power_fraction_is_sinc_squared_of_half_the_depth(depth: float) -> None:
    phase = np.random.default_rng(2).uniform(-depth / 2, depth / 2, 200_000)
    field = drive.phase_modulated_field(phase, v_pi=np.pi, bandwidth_hz=1e15, step=STEP)
    expected = (np.sin(depth / 2) / (depth / 2)) ** 2
    assert abs(field.mean()) ** 2 == pytest.approx(expected, abs=0.01)
