"""The fundamental TE mode of a slab by finite differences, with the dispersion of its materials.

    E'' + k0^2 n(x)^2 E = beta^2 E   (E parallel to the layers, continuous with its slope)

Sources: Salzberg & Villa, J. Opt. Soc. Am. 47, 244 (1957), silicon; Malitson, J. Opt. Soc. Am. 55, 1205 (1965), fused
silica: both Sellmeier forms, wavelength in micrometres.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import eigh_tridiagonal

Index = Callable[[float], float]
"""Refractive index at a wavelength in m."""

_CLADDING_M = 1.5e-6  # the field falls off over 0.1 um


def silicon(wavelength: float) -> float:
    """Refractive index of silicon."""
    return _sellmeier(wavelength, (10.6684293, 0.301516485), (0.0030434748, 1.13475115), (1.54133408, 1104.0))


def silica(wavelength: float) -> float:
    """Refractive index of fused silica."""
    return _sellmeier(wavelength, (0.6961663, 0.0684043), (0.4079426, 0.1162414), (0.8974794, 9.896161))


def effective_index(wavelength: float, *, thickness: float, core: Index, cladding: Index, cells: int = 440) -> float:
    """Of TE0 of a layer of `core`, `thickness` m with `cells` grid cells, in `cladding`."""
    step = thickness / cells
    around = round(_CLADDING_M / step)
    index = np.full(cells + 2 * around, cladding(wavelength))
    index[around : around + cells] = core(wavelength)
    k0 = 2 * np.pi / wavelength
    last = index.size - 1
    squared = eigh_tridiagonal(
        (k0 * index) ** 2 - 2 / step**2,
        np.full(last, 1 / step**2),
        eigvals_only=True,
        select="i",
        select_range=(last, last),
    )
    return float(np.sqrt(squared[0]) / k0)


def group_index(of: Index, wavelength: float, *, relative_step: float = 1e-3) -> float:
    """n - lambda dn/dlambda of an index, a material's or a mode's, by central differences."""
    beside = relative_step * wavelength
    return of(wavelength) - (of(wavelength + beside) - of(wavelength - beside)) / (2 * relative_step)


def _sellmeier(wavelength: float, *terms: tuple[float, float]) -> float:
    squared = (wavelength * 1e6) ** 2
    return float(np.sqrt(1 + sum(strength * squared / (squared - at**2) for strength, at in terms)))
