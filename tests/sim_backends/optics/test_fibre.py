from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.optics import chain, fibre
from sim_backends.optics.drift import OrnsteinUhlenbeck
from sim_backends.parameters import Parameters

NU = 299_792_458.0 / 1550e-9
PROJECTOR = chain.projector(Parameters())


def speckle(seed: int, projector: fibre.Projector = PROJECTOR, frequency_hz: float = NU) -> NDArray[np.complex64]:
    modes = fibre.draw_modes(np.random.default_rng(seed), projector)
    taps, _ = fibre.delay_taps(modes, frequency_hz=frequency_hz, step=5e-12)
    field: NDArray[np.complex64] = taps[0].sum(axis=1)
    return field


def test_textbook_mode_counts() -> None:
    assert fibre.mode_count(100e-6, 0.39, 1550e-9, within=0.13) == 675
    assert fibre.mode_count(25e-6, 0.22, 1550e-9) == 129


def test_delay_spread_at_both_apertures() -> None:
    assert fibre.delay_spread(20, 0.39, 1.444) == pytest.approx(3.48e-9, rel=0.01)
    assert fibre.delay_spread(20, 0.13, 1.444) == pytest.approx(0.39e-9, rel=0.01)


def test_grain_follows_from_the_aperture() -> None:
    assert fibre.speckle_grain(0.13, 1550e-9) == pytest.approx(0.514 * 1.55e-6 / 0.13, rel=2e-3)
    assert fibre.speckle_grain(0.13, 1550e-9, "gaussian") == pytest.approx(0.530 * 1.55e-6 / 0.13, rel=2e-3)


def test_through_a_smooth_collecting_mode_the_grain_is_that_of_the_launch() -> None:
    smooth = replace(PROJECTOR, collecting_modes=1, collection_image=6.0)
    lags = np.zeros(8)
    for seed in range(40):
        field = speckle(seed, smooth).reshape(28, 28)
        lags += [np.mean(field[:, : 28 - lag] * field[:, lag:].conj()).real for lag in range(8)]
    intensity = (lags / lags[0]) ** 2
    half = np.interp(0.5, intensity[:5][::-1], np.arange(5.0)[::-1])
    superpixel_m = PROJECTOR.side / 28
    assert 2 * half * superpixel_m == pytest.approx(fibre.speckle_grain(0.13, 1550e-9, "gaussian"), rel=0.12)


def test_the_collected_mode_takes_no_more_than_all_light_on_the_square() -> None:
    modes = fibre.draw_modes(np.random.default_rng(3), replace(PROJECTOR, collecting_modes=129), collected_modes=129)
    on_square = 4 * 0.35**2 / np.pi
    taken = np.sum(np.abs(modes.overlaps.sum(axis=1) * modes.excitation.at(0.0)) ** 2)
    assert 0.3 * on_square < taken < on_square


def test_late_modes_are_the_fine_ones() -> None:
    modes = fibre.draw_modes(np.random.default_rng(4), replace(PROJECTOR, collecting_modes=1))
    order = np.argsort(modes.delays_s)
    early, late = (modes.overlaps[0][:, part].reshape(28, 28, -1) for part in (order[20:100], order[-100:]))

    def roughness(fields: NDArray[np.complex64]) -> float:
        return float(np.sum(np.abs(np.diff(fields, axis=0)) ** 2) / np.sum(np.abs(fields) ** 2))

    assert roughness(late) > 5 * roughness(early)


def test_gaussian_launch_has_late_modes_and_the_filled_one_ends() -> None:
    gaussian = fibre.draw_modes(np.random.default_rng(4), PROJECTOR).delays_s
    filled = fibre.draw_modes(np.random.default_rng(4), replace(PROJECTOR, launch_profile="filled")).delays_s
    spread = fibre.delay_spread(20, 0.13, 1.444)
    assert filled.max() == pytest.approx(spread, rel=0.02)
    assert gaussian.max() > 2.5 * spread


def test_a_small_change_of_wavelength_decorrelates_the_speckle() -> None:
    overlaps = []
    for seed in range(10):
        here, there = speckle(seed), speckle(seed, frequency_hz=299_792_458.0 / 1550.02e-9)
        overlaps.append(abs(np.vdot(here, there)) / np.linalg.norm(here) / np.linalg.norm(there))
    assert np.mean(overlaps) < 0.4


@pytest.mark.parametrize("delay_s", [7.3e-12, 12.5e-12, 20e-12, 31.9e-12])
def test_delays_and_carrier_phases_are_exact(delay_s: float) -> None:
    one = OrnsteinUhlenbeck.constant(np.ones(2))
    modes = fibre.FibreModes(np.array([0.0, delay_s]), np.array([[[0, 1]]], np.complex64), one)
    taps, early = fibre.delay_taps(modes, frequency_hz=NU, step=5e-12)
    place = (np.arange(taps.shape[2]) - early) * 5e-12
    for offset_hz in (0.0, 8e9, 25e9):
        answer = np.sum(taps[0, 0] * np.exp(-2j * np.pi * offset_hz * place))
        assert answer == pytest.approx(np.exp(-2j * np.pi * (NU + offset_hz) * delay_s), abs=2e-3)


def test_a_drifting_fibre_keeps_its_power_and_loses_its_speckle() -> None:
    modes = fibre.draw_modes(np.random.default_rng(7), PROJECTOR, coherence_s=1.0)
    fields = [fibre.delay_taps(modes, frequency_hz=NU, step=5e-12, time_s=t)[0][0].sum(axis=1) for t in (0.0, 0.1, 5.0)]
    overlap = [abs(np.vdot(fields[0], field)) / np.linalg.norm(fields[0]) / np.linalg.norm(field) for field in fields]
    assert overlap[1] == pytest.approx(np.exp(-0.1), abs=0.08)
    assert overlap[2] < 0.4
