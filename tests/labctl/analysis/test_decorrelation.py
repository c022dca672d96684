from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from labctl.analysis.decorrelation import (
    HELD_SYMBOL,
    Decorrelation,
    Launch,
    Scan,
    crossing,
    decorrelation,
    delay_spread_s,
    expected_correlation,
    expected_half_width_hz,
    frequency_hz,
)
from labctl.errors import AnalysisError

SYMBOL_S = 40e-12
SPREAD_S = 0.4e-9
WAVELENGTH_NM = 1550.0
MODES = 200
SAMPLES = 100


def delays_s(launch: Launch) -> NDArray[np.float64]:
    """Evenly many modes in each part of the distribution: no fibre has it any closer."""
    quantiles = (np.arange(MODES) + 0.5) / MODES
    return SPREAD_S * (quantiles if launch == "filled" else -0.5 * np.log1p(-quantiles))


def speckle(
    seed: int,
    images: int,
    *,
    launch: Launch = "gaussian",
    steps: int = 14,
    step_nm: float = 0.002,
    alike: float = 0.0,
    noise: float = 0.0,
) -> Scan:
    """A fibre of circular Gaussian mode amplitudes behind a drive of random phases, straight from its definition.

    `alike` is the part of the fields' power that all images share, `noise` that of a receiver over the mean signal.
    """
    generator = np.random.default_rng(seed)
    parts = generator.normal(size=(2, images + 1, MODES))
    drawn = parts[0] + 1j * parts[1]
    amplitudes = np.sqrt(1 - alike) * drawn[1:] + np.sqrt(alike) * drawn[0]
    delays = delays_s(launch)
    phases = np.exp(2j * np.pi * generator.random(400))
    arrived = np.floor(200 + np.arange(SAMPLES)[np.newaxis] - delays[:, np.newaxis] / SYMBOL_S + 0.5).astype(np.intp)
    detuning_hz = np.array([frequency_hz(step_nm * place, WAVELENGTH_NM) for place in range(steps)])
    turned = amplitudes * np.exp(-2j * np.pi * detuning_hz[:, np.newaxis, np.newaxis] * delays)
    light = np.abs(turned @ phases[arrived]) ** 2 / (2 * MODES)
    received = light + noise * generator.normal(size=light.shape)
    again = light[:, :1] + noise * generator.normal(size=light[:, :1].shape)
    return Scan(
        received[:, :, np.newaxis],
        (again - received[:, :1])[:, :, np.newaxis],
        WAVELENGTH_NM,
        step_nm,
        SYMBOL_S,
        (0,),
    )


def half_width(found: Decorrelation) -> float:
    assert found.verdict == "measured"
    assert found.half_width_nm is not None
    return found.half_width_nm


class TestPhysics:
    @pytest.mark.parametrize("launch", ["gaussian", "filled"])
    def test_many_independent_images_show_the_width_of_the_delays(self, launch: Launch) -> None:
        """120 images: the width of one scatters by sqrt(0.4 tau_d / T) = 16 %, their mean by 1.5 %; three times that.

        Interpolation between points a third of a half width apart adds at most 1.2 % (Lorentzian).
        """
        found = decorrelation(speckle(1, 120, launch=launch))
        expected = expected_half_width_hz(SPREAD_S, launch=launch, symbol_s=SYMBOL_S)
        seen = frequency_hz(half_width(found), WAVELENGTH_NM)
        assert seen == pytest.approx(expected, rel=3 * 0.015 + 0.012)
        spread = delay_spread_s(seen, launch=launch, symbol_s=SYMBOL_S)
        assert spread == pytest.approx(SPREAD_S, rel=0.065)
        shape = expected_correlation(
            frequency_hz(1.0, WAVELENGTH_NM) * found.detuning_nm, SPREAD_S, launch=launch, symbol_s=SYMBOL_S
        )
        np.testing.assert_allclose(found.correlation, shape, atol=0.06)

    def test_the_uncertainty_is_the_scatter_from_fibre_to_fibre(self) -> None:
        """40 fibres: their scatter is known to 11 %, three times that; with images that are alike and with others."""
        for alike in (0.0, 0.8):
            found = [decorrelation(speckle(seed, 6, alike=alike)) for seed in range(40)]
            widths = np.array([one.half_width_nm for one in found if one.half_width_nm is not None])
            stated = np.array([one.uncertainty_nm for one in found if one.uncertainty_nm is not None])
            assert min(len(widths), len(stated)) >= 38
            assert np.sqrt(np.mean(stated**2)) == pytest.approx(widths.std(), rel=0.35)

    def test_fibres_of_few_modes_differ_from_the_distribution_of_their_delays(self) -> None:
        """By sqrt(1.6 / K): 200 fibres know their scatter to 5 %, three times that."""
        modes, detuning = 694, np.linspace(0.5, 1.5, 201)
        turns = np.exp(-2j * np.multiply.outer(detuning, np.random.default_rng(1).exponential(0.5, (200, modes))))
        light = np.abs(turns.mean(axis=2)) ** 2
        half = detuning[np.argmax(light < 0.5, axis=0)]
        assert np.std(np.log(half)) == pytest.approx(np.sqrt(1.6 / modes), rel=0.15)

    def test_like_images_are_known_to_be_alike(self) -> None:
        """Fields that share 0.8 of their power make intensities that correlate by 0.64, on the mean of fibres."""
        likeness = [decorrelation(speckle(seed, 10, alike=0.8, steps=4)).likeness for seed in range(12)]
        assert np.mean(likeness) == pytest.approx(0.64, abs=3 * np.std(likeness) / np.sqrt(12))
        assert decorrelation(speckle(2, 30)).likeness < 0.05

    def test_noise_does_not_narrow_the_correlation(self) -> None:
        """Noise of 0.3 of the signal takes a fifth of the correlation away; taken off, 4 % of it are left at most."""
        clean, noisy = (half_width(decorrelation(speckle(3, 40, noise=noise))) for noise in (0.0, 0.3))
        assert noisy == pytest.approx(clean, rel=0.04)

    @given(st.floats(0.15e-9, 50e-9), st.sampled_from(["gaussian", "filled"]))
    def test_the_delay_spread_is_the_inverse_of_the_half_width(self, spread_s: float, launch: Launch) -> None:
        width = expected_half_width_hz(spread_s, launch=launch, symbol_s=SYMBOL_S)
        assert delay_spread_s(width, launch=launch, symbol_s=SYMBOL_S) == pytest.approx(spread_s, rel=1e-6)
        level = expected_correlation(np.array([width]), spread_s, launch=launch, symbol_s=SYMBOL_S)
        assert level == pytest.approx(0.5)

    def test_textbook_widths_for_light_that_does_not_change(self) -> None:
        assert expected_half_width_hz(SPREAD_S, launch="gaussian", symbol_s=0) == pytest.approx(1 / np.pi / SPREAD_S)
        assert expected_half_width_hz(SPREAD_S, launch="filled", symbol_s=0) == pytest.approx(
            0.443 / SPREAD_S, rel=1e-3
        )

    def test_a_fibre_without_memory_has_no_delay_spread(self) -> None:
        assert delay_spread_s(1 / (3 * HELD_SYMBOL * SYMBOL_S), launch="gaussian", symbol_s=SYMBOL_S) is None


class TestWhatAScanCannotTell:
    def test_too_coarse(self) -> None:
        found = decorrelation(speckle(1, 10, step_nm=0.02))
        assert (found.verdict, found.half_width_nm, found.uncertainty_nm) == ("too coarse", None, None)

    @pytest.mark.parametrize("steps", [2, 3, 5])
    def test_too_short(self, steps: int) -> None:
        found = decorrelation(speckle(1, 10, steps=steps))
        assert (found.verdict, found.half_width_nm) == ("too short", None)

    def test_a_single_image_is_uncertain_by_the_symbols_in_the_fibre(self) -> None:
        found = decorrelation(speckle(4, 1))
        assert found.likeness == 1
        assert found.uncertainty_nm == pytest.approx(0.165 * half_width(found), rel=0.3)

    def test_darkness(self) -> None:
        generator = np.random.default_rng(1)
        dark = generator.normal(size=(4, 3, 1, 50))
        again = dark[:, :1] - generator.normal(size=(4, 1, 1, 50))
        with pytest.raises(AnalysisError, match="nothing but noise"):
            decorrelation(Scan(dark, 2 * again, WAVELENGTH_NM, 0.002, SYMBOL_S, (0,)))

    def test_a_single_wavelength(self) -> None:
        with pytest.raises(AnalysisError, match="more steps"):
            decorrelation(speckle(1, 2, steps=1))


def test_a_crossing_lies_on_the_line_between_two_points() -> None:
    detuning: NDArray[Any] = np.array([0.0, 1.0, 2.0, 3.0])
    assert crossing(detuning, np.array([1.0, 0.7, 0.3, 0.6])) == pytest.approx(1.5)
    assert crossing(detuning, np.array([1.0, 0.9, 0.8, 0.7])) is None
    assert crossing(detuning, np.array([1.0, 0.9, 0.8, 0.7]), 0.85) == pytest.approx(1.5)


def test_two_picometres_at_1550_nm_are_a_quarter_of_a_gigahertz() -> None:
    assert frequency_hz(0.002, 1550.0) == pytest.approx(0.2496e9, rel=1e-3)
