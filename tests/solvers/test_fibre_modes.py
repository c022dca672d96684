"""The fibre's modes from finite differences, against what the simulated fibre has of them."""

import sys
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.optics.lp_modes import LpModes, lp_modes
from sim_backends.parameters import SPEED_OF_LIGHT
from tests.solvers.fibre_modes import Fibre, modes

WAVELENGTH, LENGTH = 1550e-9, 20.0
PROJECTOR = Fibre(radius=100e-6, aperture=0.39, index=1.444)
COLLECTION = Fibre(radius=25e-6, aperture=0.22, index=1.444, outer=3.0)
LAUNCHED = 0.13

solved = lru_cache(modes)


def told(what: str, ratio: NDArray[np.float64]) -> None:
    sys.stdout.write(f"{what}: {100 * np.sqrt(np.mean((ratio - 1) ** 2)):.3f} % rms, ")
    sys.stdout.write(f"{100 * np.max(np.abs(ratio - 1)):.3f} % at most\n")


def product(fibre: Fibre, aperture: float) -> LpModes:
    return lp_modes(fibre.radius, fibre.aperture, WAVELENGTH, up_to_aperture=aperture)


def sorted_by_kappa(found: LpModes) -> NDArray[np.intp]:
    return np.lexsort((found.u, found.order))


@pytest.mark.parametrize(
    ("fibre", "aperture", "count"), [(PROJECTOR, LAUNCHED, 675), (COLLECTION, LAUNCHED, 42), (COLLECTION, 0.2199, 129)]
)
def test_count_and_wave_numbers_of_the_modes(fibre: Fibre, aperture: float, count: int) -> None:
    exact = solved(fibre, WAVELENGTH, aperture)
    found = product(fibre, aperture)
    sys.stdout.write(f"modes within {aperture}: {found.count}, finite differences {exact.weight.sum()}\n")
    assert found.count == exact.weight.sum() == count
    order = sorted_by_kappa(found)
    assert (found.order[order] == exact.order).all()
    ratio = found.u[order] / found.radius / exact.kappa
    told("transverse wave numbers", ratio)
    assert ratio == pytest.approx(1.0, abs=5e-4)


def test_modes_of_twice_the_launch_aperture_are_counted() -> None:
    coarse = Fibre(PROJECTOR.radius, PROJECTOR.aperture, PROJECTOR.index, cells=1000)
    highest = 2 * np.pi / WAVELENGTH * 0.25
    exact = sum(coarse.transverse(order, WAVELENGTH, highest).size * (2 if order else 1) for order in range(105))
    found = product(PROJECTOR, 0.25).count
    sys.stdout.write(f"modes within 0.25: {found}, finite differences {exact}: {100 * (found / exact - 1):+.2f} %\n")
    assert found == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("order", [0, 1, 12, 33])
def test_fields_of_the_modes(order: int) -> None:
    exact = PROJECTOR.radial(order, WAVELENGTH, 2 * np.pi / WAVELENGTH * LAUNCHED)
    found = product(PROJECTOR, LAUNCHED)
    these = found.chosen(found.order == order)
    fields = these.fields(PROJECTOR.radii, np.zeros_like(PROJECTOR.radii))[: these.order.size]
    away = np.sqrt(np.sum((fields - exact) ** 2, axis=1) / np.sum(exact**2, axis=1))
    sys.stdout.write(f"fields of the modes of order {order}: {100 * away.max():.3f} % rms at most\n")
    assert away == pytest.approx(0.0, abs=5e-3)


def test_delay_of_every_mode() -> None:
    exact = solved(PROJECTOR, WAVELENGTH, LAUNCHED)
    found = product(PROJECTOR, LAUNCHED)
    delays = found.delays(LENGTH, PROJECTOR.index, PROJECTOR.index, PROJECTOR.aperture)
    order = sorted_by_kappa(found)
    late = exact.delays(LENGTH) > 0
    ratio = (delays - delays.min())[order][late] / exact.delays(LENGTH)[late]
    told("delay of LP modes", np.repeat(ratio, exact.weight[late]))
    assert ratio == pytest.approx(1.0, abs=5e-3)


def test_what_the_textbook_formula_leaves_out_of_delays() -> None:
    """L kappa^2 / (2 n c k0^2) is 1 % too long: the cladding's share is faster; late modes are not paraxial."""
    exact = solved(PROJECTOR, WAVELENGTH, LAUNCHED)
    after_the_axis = LENGTH / SPEED_OF_LIGHT * (exact.group_index - PROJECTOR.index)
    sine = exact.kappa * WAVELENGTH / (2 * np.pi)
    ratio = after_the_axis / (LENGTH * sine**2 / (2 * PROJECTOR.index * SPEED_OF_LIGHT))
    told("delay of LP modes over the textbook's", np.repeat(ratio, exact.weight))
    edge = 2 * np.pi / WAVELENGTH * PROJECTOR.radius * PROJECTOR.aperture
    cladding = 1 - 2 / np.sqrt(edge**2 - (exact.kappa * PROJECTOR.radius) ** 2)
    exact_angle = 2 * (1 / np.sqrt(1 - (sine / PROJECTOR.index) ** 2) - 1) / (sine / PROJECTOR.index) ** 2
    assert ratio == pytest.approx(cladding * exact_angle, abs=1e-3)
    assert np.mean(ratio) == pytest.approx(0.990, abs=1e-3)


def test_finer_cells_change_nothing() -> None:
    coarse = modes(Fibre(PROJECTOR.radius, PROJECTOR.aperture, PROJECTOR.index, cells=1000), WAVELENGTH, LAUNCHED)
    ratio = coarse.kappa / solved(PROJECTOR, WAVELENGTH, LAUNCHED).kappa
    told("half as many cells", ratio)
    assert ratio == pytest.approx(1.0, abs=2e-4)
