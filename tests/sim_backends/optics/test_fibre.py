import numpy as np
import pytest

from sim_backends.optics import fibre

NU = 299_792_458.0 / 1550e-9


def test_textbook_mode_counts() -> None:
    assert fibre.v_number(100e-6, 0.39, 1550e-9) == pytest.approx(158, abs=0.2)
    assert fibre.mode_count(100e-6, 0.39, 1550e-9) == pytest.approx(6250, abs=10)
    assert fibre.mode_count(100e-6, 0.13, 1550e-9) == 694
    assert fibre.mode_count(25e-6, 0.22, 1550e-9) == 124


def test_delay_spread_at_both_apertures() -> None:
    assert fibre.delay_spread(20, 0.39, 1.444) == pytest.approx(3.48e-9, rel=0.01)
    assert fibre.delay_spread(20, 0.13, 1.444) == pytest.approx(0.39e-9, rel=0.01)


def test_grain_follows_from_the_aperture() -> None:
    assert fibre.speckle_grain(0.13, 1550e-9) == pytest.approx(0.514 * 1.55e-6 / 0.13, rel=2e-3)
    assert fibre.speckle_grain(0.13, 1550e-9, "gaussian") == pytest.approx(0.530 * 1.55e-6 / 0.13, rel=2e-3)


@pytest.mark.parametrize("profile", ["filled", "gaussian"])
def test_basis_holds_the_covariance_it_is_made_for(profile: fibre.LaunchProfile) -> None:
    basis = fibre.speckle_basis(2.4, 1e-4, profile).astype(float)
    covariance = basis @ basis.T
    assert np.trace(covariance) == pytest.approx(784, rel=2e-4)
    row = covariance[14 * 28 + 4, 14 * 28 + 4 : 14 * 28 + 28] ** 2
    half = np.interp(0.5, row[:4][::-1], np.arange(4.0)[::-1])
    assert 2 * half == pytest.approx(2.4, abs=0.25)


def test_basis_is_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        fibre.speckle_basis(2.4, 1e-3)[0, 0] = 1.0


def test_speckle_contrast_is_one() -> None:
    basis = fibre.speckle_basis(2.4, 1e-3)
    contrasts = []
    for seed in range(20):
        modes = fibre.draw_modes(np.random.default_rng(seed), modes=200, spread=0.39e-9, basis=basis)
        field = basis @ fibre.delay_taps(modes, frequency_hz=NU, step=5e-12)[0].sum(axis=1)
        contrasts.append(np.std(np.abs(field) ** 2) / np.mean(np.abs(field) ** 2))
    assert np.mean(contrasts) == pytest.approx(1.0, abs=0.06)  # about 108 grains a pattern


def test_taps_span_the_delay_spread_and_carry_unit_power() -> None:
    modes = fibre.draw_modes(
        np.random.default_rng(3), modes=694, spread=0.39e-9, basis=np.eye(784, 150, dtype=np.float32)
    )
    taps = fibre.delay_taps(modes, frequency_hz=NU, step=5e-12)
    assert taps.shape == (1, 150, 79)
    assert np.sum(np.abs(taps) ** 2) / 150 == pytest.approx(1.0, abs=0.05)


def test_gaussian_launch_has_late_modes_up_to_the_full_aperture() -> None:
    modes = fibre.draw_modes(
        np.random.default_rng(4),
        modes=5000,
        spread=0.39e-9,
        basis=np.eye(784, 1, dtype=np.float32),
        profile="gaussian",
        longest=3.48e-9,
    )
    assert modes.delays_s.mean() == pytest.approx(0.195e-9, rel=0.05)
    assert 1e-9 < modes.delays_s.max() < 3.48e-9


@pytest.mark.parametrize(("spread", "detuned_nm", "high"), [(0.39e-9, 0.02, 0.35), (3.48e-9, 0.0024, 0.35)])
def test_a_small_change_of_wavelength_decorrelates_the_speckle(spread: float, detuned_nm: float, high: float) -> None:
    modes = fibre.draw_modes(
        np.random.default_rng(5), modes=694, spread=spread, basis=np.eye(784, 158, dtype=np.float32)
    )
    here, there = (
        fibre.delay_taps(modes, frequency_hz=299_792_458.0 / (nm * 1e-9), step=5e-12)[0].sum(axis=1)
        for nm in (1550.0, 1550.0 + detuned_nm)
    )
    overlap = abs(np.vdot(here, there)) / np.linalg.norm(here) / np.linalg.norm(there)
    assert overlap < high


def test_carrier_phases_are_exact_though_envelopes_are_on_a_grid() -> None:
    modes = fibre.FibreModes(np.array([7.3e-12]), np.ones((1, 1, 1), np.complex64))
    taps = fibre.delay_taps(modes, frequency_hz=NU, step=5e-12)
    assert taps.shape == (1, 1, 2)
    assert taps[0, 0, 1] == pytest.approx(np.exp(-2j * np.pi * NU * 7.3e-12), abs=1e-4)


def test_the_fields_do_not_depend_on_how_the_eigenvectors_came_out() -> None:
    basis = fibre.speckle_basis(2.4, 1e-3)
    signs = np.where(np.arange(basis.shape[1]) % 2, -1, 1).astype(np.float32)
    fields = [
        shown @ fibre.draw_modes(np.random.default_rng(6), modes=20, spread=0.39e-9, basis=shown).amplitudes[0]
        for shown in (basis, basis * signs)
    ]
    assert np.allclose(fields[0], fields[1], atol=1e-4)
