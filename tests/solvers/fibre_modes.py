"""Scalar modes of a step-index fibre by finite differences: no Bessel function, no characteristic equation.

    -(1/r) (r R')' + (l / r)^2 R + k0^2 (n1^2 - n(r)^2) R = kappa^2 R,   beta^2 = (k0 n1)^2 - kappa^2

On cells of a radial grid with the edge of the core between two of them, sqrt(r) R obeys a symmetric tridiagonal
eigenproblem for every azimuthal order l. Sources of the equation: Snyder & Love, Optical Waveguide Theory, ch. 14.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh_tridiagonal

from sim_backends.parameters import SPEED_OF_LIGHT

_RELATIVE_STEP = 1e-3  # of the optical frequency, for the group delay


@dataclass(frozen=True, eq=False)
class Fibre:
    """A step-index fibre: radius (m), numerical aperture, index of the core; cells of the grid over the core's radius.

    The grid reaches `outer` radii, which is where modes have to be dark.
    """

    radius: float
    aperture: float
    index: float
    cells: int = 2000
    outer: float = 1.2

    @property
    def step(self) -> float:
        """Width of a cell (m)."""
        return self.radius / self.cells

    @property
    def radii(self) -> NDArray[np.float64]:
        """Centres of the cells (m)."""
        return np.asarray(self.step * (np.arange(round(self.cells * self.outer)) + 0.5), np.float64)

    def transverse(self, order: int, wavelength: float, highest: float) -> NDArray[np.float64]:
        """Transverse wave numbers kappa (1/m) up to `highest` of the modes of azimuthal `order`, ascending."""
        diagonal, beside = self._equation(order, wavelength)
        return np.sqrt(
            eigh_tridiagonal(diagonal, beside, eigvals_only=True, select="v", select_range=(0.0, highest**2))
        )

    def radial(self, order: int, wavelength: float, highest: float) -> NDArray[np.float64]:
        """Radial fields R of these modes at `radii`, (modes, cells) in 1/m, positive near the axis.

        The square of R cos l phi, integrated over the whole plane, is 1.
        """
        diagonal, beside = self._equation(order, wavelength)
        _, vectors = eigh_tridiagonal(diagonal, beside, select="v", select_range=(0.0, highest**2))
        fields = vectors.T / np.sqrt(self.radii * self.step * np.pi * (1 if order else 2))
        begins = np.argmax(np.abs(fields) > 0.01 * np.abs(fields).max(axis=1, keepdims=True), axis=1)
        return np.asarray(fields * np.sign(fields[np.arange(len(fields)), begins])[:, np.newaxis], np.float64)

    def _equation(self, order: int, wavelength: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        radii, faces = self.radii, self.step * np.arange(self.radii.size + 1)
        outside = np.where(radii < self.radius, 0.0, (2 * np.pi / wavelength * self.aperture) ** 2)
        diagonal = (faces[:-1] + faces[1:]) / (radii * self.step**2) + (order / radii) ** 2 + outside
        return diagonal, -faces[1:-1] / (self.step**2 * np.sqrt(radii[:-1] * radii[1:]))


@dataclass(frozen=True, eq=False)
class Modes:
    """LP modes: azimuthal order, transverse wave number (1/m) and group index of each; orders above 0 count twice."""

    order: NDArray[np.intp]
    kappa: NDArray[np.float64]
    group_index: NDArray[np.float64]

    @property
    def weight(self) -> NDArray[np.intp]:
        """How many fields of one polarisation each stands for: cosine and sine."""
        return np.where(self.order > 0, 2, 1)

    def delays(self, length: float) -> NDArray[np.float64]:
        """Arrival (s) behind `length` m of fibre after the fastest one."""
        return np.asarray(length / SPEED_OF_LIGHT * (self.group_index - self.group_index.min()), np.float64)


def modes(fibre: Fibre, wavelength: float, aperture: float) -> Modes:
    """All modes with kappa up to k0 * `aperture`.

    The group index is d(beta)/d(k0) by central differences, the indices of core and cladding held constant.
    """
    k0 = 2 * np.pi / wavelength
    orders, kappas, group = [], [], []
    for order in range(round(k0 * fibre.radius * fibre.aperture) + 1):
        kappa = fibre.transverse(order, wavelength, k0 * aperture)
        if kappa.size == 0:
            break
        betas = []
        for factor in (1 - _RELATIVE_STEP, 1 + _RELATIVE_STEP):
            beside = fibre.transverse(order, wavelength / factor, 1.1 * k0 * aperture)[: kappa.size]
            betas.append(np.sqrt((factor * k0 * fibre.index) ** 2 - beside**2))
        orders.append(np.full(kappa.size, order))
        kappas.append(kappa)
        group.append((betas[1] - betas[0]) / (2 * _RELATIVE_STEP * k0))
    return Modes(np.concatenate(orders), np.concatenate(kappas), np.concatenate(group))
