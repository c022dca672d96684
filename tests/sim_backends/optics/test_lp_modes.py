import numpy as np
import pytest
from scipy.special import jn_zeros

from sim_backends.optics.lp_modes import LpModes, lp_modes, v_number

WAVELENGTH = 1550e-9


@pytest.fixture(scope="module")
def collecting() -> LpModes:
    return lp_modes(25e-6, 0.22, WAVELENGTH)


def test_a_fibre_below_the_first_zero_of_j0_has_one_mode() -> None:
    radius = 0.99 * jn_zeros(0, 1)[0] * WAVELENGTH / (2 * np.pi * 0.12)
    assert lp_modes(radius, 0.12, WAVELENGTH).count == 1
    assert lp_modes(1.02 * radius, 0.12, WAVELENGTH).count == 3  # LP01, and LP11 twice


def test_mode_counts_are_textbook_s_with_the_edge_of_the_core() -> None:
    assert v_number(100e-6, 0.39, WAVELENGTH) == pytest.approx(158, abs=0.2)
    assert lp_modes(100e-6, 0.39, WAVELENGTH).count == pytest.approx(158.1**2 / 4, rel=0.01)
    within = lp_modes(100e-6, 0.39, WAVELENGTH, up_to_aperture=0.13)
    reached = v_number(100e-6 * (1 + 1 / 149), 0.13, WAVELENGTH)  # the field goes on for 1 / w
    assert within.count == pytest.approx(reached**2 / 4 - reached / 2, rel=0.01)


def test_fields_are_orthogonal_and_of_unit_power(collecting: LpModes) -> None:
    along = np.linspace(-40e-6, 40e-6, 321)
    x, y = np.meshgrid(along, along)
    fields = collecting.fields(x, y).reshape(collecting.count, -1).astype(float)
    powers = fields @ fields.T * (along[1] - along[0]) ** 2
    assert np.abs(powers - np.eye(collecting.count)).max() < 0.01


def test_an_image_has_the_same_modes_spread_out(collecting: LpModes) -> None:
    x = np.linspace(0, 20e-6, 5)
    np.testing.assert_allclose(
        collecting.imaged(50e-6).fields(2 * x, x) * 2, collecting.fields(x, x / 2), rtol=1e-4, atol=1e-2
    )


def test_modes_that_do_not_reach_a_square_are_dark_there() -> None:
    modes = lp_modes(100e-6, 0.39, WAVELENGTH, up_to_aperture=0.13)
    near = modes.reaching(49.5e-6)
    x, y = np.meshgrid(*2 * (np.linspace(-35e-6, 35e-6, 40),))
    power = np.sum(modes.fields(x, y).astype(float) ** 2)
    assert near.count < 0.9 * modes.count
    assert np.sum(near.fields(x, y).astype(float) ** 2) == pytest.approx(power, rel=1e-5)


def test_delays_go_with_the_square_of_the_angle_less_what_is_in_the_cladding() -> None:
    modes = lp_modes(100e-6, 0.39, WAVELENGTH, up_to_aperture=0.13)
    sine = modes.sine_of_angle(WAVELENGTH)
    rays = 20 * sine**2 / (2 * 1.444 * 299_792_458)
    ratio = modes.delays(20, 1.444, 1.444, 0.39) / rays
    assert ratio.mean() == pytest.approx(1 - 2 / 149 + 0.003, abs=2e-3)
