"""Inputs with a bandwidth limit: light and noise behind a Gaussian low pass, which acts before samples are taken."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.parameters import Parameters
from sim_backends.world.card import CardReceivers
from sim_backends.world.signals import Acquisition
from sim_backends.world.world import World
from tests.sim_backends.world.light import RATE, bench, quiet, shoot

PERIOD = 500
FINE = 16
FULL_HZ = 25e9
TRIGGERS = 3000

pytestmark = pytest.mark.parametrize("receivers", ["processor", "card"])


def world_of(parameters: Parameters, receivers: str) -> World:
    world = bench(parameters=parameters)
    if receivers == "card":
        world.receivers = CardReceivers(world._light_path, world.parameters, "cpu")
    return world


def narrowed(volts: NDArray[np.float32], bandwidth_hz: float) -> NDArray[np.float64]:
    """One period, fine and behind the full bandwidth, as it is behind a narrower one, at the places of samples."""
    frequencies = np.fft.rfftfreq(volts.shape[-1], 1 / (FINE * RATE))
    more = np.exp(-np.log(2) / 2 * frequencies**2 * (bandwidth_hz**-2.0 - FULL_HZ**-2.0))
    return np.asarray(np.fft.irfft(np.fft.rfft(volts.astype(np.float64)) * more)[..., ::FINE], np.float64)


@pytest.mark.parametrize("bandwidth_hz", [16e9, 12.5e9, 10e9, 4e9, 1e9, 200e6])
def test_light_goes_through_the_low_pass_and_is_sampled_then(bandwidth_hz: float, receivers: str) -> None:
    world = world_of(quiet(record_step_s=2.5e-12), receivers)
    fine = shoot(world, acquisition=Acquisition((1, 2), FINE * RATE, FINE * PERIOD, 0.0)).volts[0]
    expected, wide = narrowed(fine, bandwidth_hz), fine[:, ::FINE]
    for begin, samples in ((0, PERIOD), (100, 50)):
        limited = Acquisition((1, 2), RATE, samples, begin / RATE, bandwidth_hz)
        part = slice(begin, begin + samples)
        away = np.abs(shoot(world, acquisition=limited).volts[0] - expected[:, part]).max(axis=1)
        assert np.all(away < 2e-3 * expected.max(axis=1))
        assert np.all(away < 0.05 * np.abs(wide - expected)[:, part].max(axis=1))


def receiver_spectrum(bandwidth_hz: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies (Hz) and power response of a one-pole detector of 12 GHz and a Gaussian oscilloscope."""
    frequencies = np.linspace(0, 5 * bandwidth_hz, 100_001)
    gaussian = np.exp(-np.log(2) * (frequencies / bandwidth_hz) ** 2)
    return frequencies, gaussian / (1 + (frequencies / 12e9) ** 2)


@pytest.mark.parametrize("bandwidth_hz", [16e9, 12.5e9, 10e9, 4e9, 1e9])
def test_noise_is_as_much_and_as_slow_as_the_bandwidth_lets_through(bandwidth_hz: float, receivers: str) -> None:
    parameters = Parameters(light_path="direct")
    world = world_of(parameters, receivers)
    world.emit(None)
    limited = Acquisition((1, 2), RATE, 100, 0.0, bandwidth_hz)
    noise = shoot(world, count=TRIGGERS, acquisition=limited).volts.astype(np.float64)
    frequencies, power = receiver_spectrum(bandwidth_hz)
    rms = (
        parameters.detector_gain_v_per_w
        * parameters.detector_nep_w_per_rthz
        * np.sqrt(np.trapezoid(power, frequencies))
    )
    assert noise.std() == pytest.approx(rms, rel=0.01)
    for lag in (1, 3, 10):
        between = np.mean(noise[..., lag:] * noise[..., :-lag]) / np.mean(noise**2)
        expected = np.trapezoid(power * np.cos(2 * np.pi * frequencies * lag / RATE), frequencies)
        assert between == pytest.approx(expected / np.trapezoid(power, frequencies), abs=0.01)


def test_an_input_is_no_wider_than_the_oscilloscope(receivers: str) -> None:
    narrow = quiet(scope_bandwidth_hz=6e9)
    full, limited = (
        shoot(world_of(narrow, receivers), acquisition=Acquisition((1,), RATE, 64, 0.0, bandwidth_hz)).volts
        for bandwidth_hz in (np.inf, 10e9)
    )
    np.testing.assert_allclose(limited, full, rtol=2e-3)
