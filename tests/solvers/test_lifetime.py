"""The chip's photon lifetime by rays, against the random-matrix escape that the twin's couplings stand for."""

import sys
from typing import NamedTuple

import numpy as np
import pytest

from sim_backends.optics.derived import mode_density_per_hz
from sim_backends.parameters import Parameters
from tests.solvers.rays import Reflectance, Stadium, fresnel, lifetime, openings, power_left

TWIN = Parameters()
STADIUM = Stadium(TWIN.stadium_radius_m, TWIN.stadium_straight_m)
WAVEGUIDE_M = 500e-9


class Decay(NamedTuple):
    """Time until 1/e is left, and that of the exponential after the first bounces, s."""

    to_1_over_e: float
    late: float


def decay(walls: list[Reflectance], *, until: float, rays: int) -> Decay:
    times = np.linspace(0, until, 401)
    power = power_left(STADIUM, walls, group_index=TWIN.chip_group_index, times=times, rays=rays, seed=1)
    first = float(times[np.argmax(power < np.exp(-1))])
    return Decay(first, lifetime(times, power, between=(0.02, 0.5)))


@pytest.mark.parametrize(("around", "outside", "expected"), [("silica", 1.444, 2.9e-12), ("air", 1.0, 5.2e-12)])
def test_a_bare_stadium_loses_its_light_within_picoseconds(around: str, outside: float, expected: float) -> None:
    found = decay([fresnel(TWIN.chip_index, outside)], until=30e-12, rays=40_000)
    sys.stdout.write(
        f"lifetime of the bare stadium in {around}: {found.late * 1e12:.1f} ps (1/e after "
        f"{found.to_1_over_e * 1e12:.1f} ps)\n"
    )
    assert found.late == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("transmission", [1.0, TWIN.chip_coupling])
def test_between_mirrors_light_leaves_through_openings_nearly_as_from_a_random_matrix(transmission: float) -> None:
    """A waveguide of one mode takes one cell of phase space: width x 2 sin = lambda / n. The rest of it reflects.

    Rays take longer: those that bounce between the straight walls beside an opening do not find it.
    """
    accepted = TWIN.design_wavelength_nm * 1e-9 / (2 * TWIN.chip_index * WAVEGUIDE_M)
    wall = openings(STADIUM, TWIN.chip_ports, width=WAVEGUIDE_M, accepted=accepted, transmission=transmission)
    rays = decay([wall], until=250e-12, rays=10_000)
    escape = mode_density_per_hz(TWIN) / (TWIN.chip_ports * transmission)
    sys.stdout.write(
        f"lifetime through {TWIN.chip_ports} openings of transmission {transmission}: rays "
        f"{rays.to_1_over_e * 1e12:.1f} ps, later {rays.late * 1e12:.1f} ps, random matrix {escape * 1e12:.1f} ps: "
        f"{100 * (rays.to_1_over_e / escape - 1):+.1f} %, {100 * (rays.late / escape - 1):+.1f} %\n"
    )
    assert escape < rays.to_1_over_e < 1.12 * escape
    assert escape < rays.late < 1.16 * escape


def test_rays_stay_inside_and_fill_the_stadium_evenly() -> None:
    """Ergodic: the mean path between bounces is pi A / P, whatever way the light came in."""
    generator = np.random.default_rng(2)
    place = np.zeros((2, 2000))
    angle = generator.uniform(0, 2 * np.pi, 2000)
    direction = np.stack([np.cos(angle), np.sin(angle)])
    paths = []
    for _ in range(400):
        path, _, place, direction = STADIUM.bounced(place, direction)
        paths.append(path)
    beside = np.maximum(np.abs(place[0]) - STADIUM.straight / 2, 0)
    assert np.hypot(beside, place[1]) == pytest.approx(STADIUM.radius, rel=1e-6)
    assert np.mean(paths[100:]) == pytest.approx(np.pi * STADIUM.area / STADIUM.perimeter, rel=0.02)
