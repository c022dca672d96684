"""Effective and group index of the chip's slab, against the parameters that the twin has."""

import sys
from functools import partial

import pytest

from sim_backends.parameters import Parameters
from tests.solvers.slab import effective_index, group_index, silica, silicon

WAVELENGTH = 1550e-9
SLAB = partial(effective_index, thickness=220e-9, core=silicon, cladding=silica)


def test_materials_have_the_indices_of_their_sources() -> None:
    assert silicon(WAVELENGTH) == pytest.approx(3.4777, abs=1e-4)
    assert silica(WAVELENGTH) == pytest.approx(1.4440, abs=1e-4)
    assert group_index(silicon, WAVELENGTH) == pytest.approx(3.605, abs=2e-3)
    assert group_index(silica, WAVELENGTH) == pytest.approx(1.4626, abs=5e-4)


def test_effective_index() -> None:
    twin, solved = Parameters().chip_index, SLAB(WAVELENGTH)
    sys.stdout.write(f"effective index of TE0: {twin}, solved {solved:.3f}: {100 * (twin / solved - 1):+.2f} %\n")
    assert twin == pytest.approx(solved, rel=2e-3)


def test_group_index() -> None:
    twin, solved = Parameters().chip_group_index, group_index(SLAB, WAVELENGTH)
    sys.stdout.write(f"group index of TE0: {twin}, solved {solved:.3f}: {100 * (twin / solved - 1):+.2f} %\n")
    assert twin == pytest.approx(solved, rel=5e-3)


def test_finer_cells_change_nothing() -> None:
    assert SLAB(WAVELENGTH, cells=220) == pytest.approx(SLAB(WAVELENGTH, cells=440), abs=1e-4)
