"""The chip: a stadium-shaped, ray-chaotic microcavity with 14 single-mode waveguides, as a random scattering matrix.

Heidelberg model: S(f) = 1 - 2 pi i V^T (f - H + i pi V V^T + i gamma / 2)^-1 V, H from the Gaussian orthogonal ensemble
at the cavity's Weyl density, V Gaussian couplings of the waveguides. With H = Q diag(lambda) Q^T it is the same as

    S = (1 - i K) (1 + i K)^-1,   K(f) = pi W^T (f + i gamma / 2 - lambda)^-1 W,   W = Q^T V,

which needs one real eigendecomposition and is unitary to rounding when gamma = 0. The papers' time dependence is
exp(-i w t), numpy's FFT has exp(+i w t): functions here return the conjugate, whose impulse response is causal.
A real stadium deviates from the ensemble by bouncing-ball modes and scars, and needs reflecting walls to hold light
this long.

Sources: Mahaux & Weidenmueller, Shell-Model Approach to Nuclear Reactions (1969); Fyodorov & Sommers, J. Math. Phys.
38, 1918 (1997); Beenakker, Rev. Mod. Phys. 69, 731 (1997); Schomerus, Wiersig & Main, Phys. Rev. A 79, 053806 (2009).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backends.parameters import SPEED_OF_LIGHT


def weyl_density(*, radius: float, straight: float, index: float, group_index: float, wavelength: float) -> float:
    """Mean density of a stadium's resonances (1/Hz).

    N(k) = A k^2 / (4 pi) - P k / (4 pi), k = 2 pi n nu / c, so dN/dnu = 2 pi A n n_g nu / c^2 - P n_g / (2 c);
    A = pi R^2 + 2 R s, P = 2 pi R + 2 s. Lengths and wavelength in m.
    """
    area = np.pi * radius**2 + 2 * radius * straight
    perimeter = 2 * np.pi * radius + 2 * straight
    nu = SPEED_OF_LIGHT / wavelength
    return float(
        2 * np.pi * area * index * group_index * nu / SPEED_OF_LIGHT**2 - perimeter * group_index / (2 * SPEED_OF_LIGHT)
    )


def coupling_strength(transmission: float) -> float:
    """Coupling strength of a port with transmission T = 4 kappa / (1 + kappa)^2: (2 - T - 2 sqrt(1 - T)) / T."""
    return float((2 - transmission - 2 * np.sqrt(1 - transmission)) / transmission)


@dataclass(frozen=True, eq=False)
class Cavity:
    """One closed cavity and its couplings: resonances (Hz from the carrier), shape (N,), and W, shape (N, ports)."""

    resonances_hz: NDArray[np.float64]
    couplings: NDArray[np.float64]


def draw_cavity(
    generator: np.random.Generator, *, modes: int, density: float, ports: int, transmission: float
) -> Cavity:
    """Draw a cavity from the Gaussian orthogonal ensemble.

    The semicircle of `modes` levels has the wanted `density` (1/Hz) at its centre. Couplings are Gaussian with
    <w^2> = kappa / (pi^2 density), which makes the mean transmission of a port `transmission`; the ensemble is
    invariant under rotation, so they are drawn in the eigenbasis.
    """
    normal = generator.standard_normal((modes, modes))
    scale = np.sqrt(modes) / (np.pi * density)
    resonances = np.linalg.eigvalsh((normal + normal.T) / np.sqrt(2)) * scale
    width = np.sqrt(coupling_strength(transmission) / (np.pi**2 * density))
    return Cavity(resonances, width * generator.standard_normal((modes, ports)))


def scattering_matrix(cavity: Cavity, frequency_hz: NDArray[np.float64], *, loss_hz: float) -> NDArray[np.complex128]:
    """S(f) of all ports, in numpy's exp(+i w t) convention.

    Args:
        cavity: the draw.
        frequency_hz: (F,) from the carrier the cavity was drawn for.
        loss_hz: gamma = 1 / (2 pi tau) for a photon lifetime tau (s) by loss; 0 = lossless.

    Returns:
        (F, ports, ports) complex128, [f, out, in]; symmetric (reciprocal), unitary without loss.
    """
    ports = cavity.couplings.shape[1]
    green = 1.0 / (frequency_hz[:, None] + 0.5j * loss_hz - cavity.resonances_hz)
    pairs = (cavity.couplings[:, :, None] * cavity.couplings[:, None, :]).reshape(-1, ports * ports)
    k = np.pi * (green.real @ pairs + 1j * (green.imag @ pairs)).reshape(-1, ports, ports)
    one = np.eye(ports)
    outward = np.linalg.solve(one + 1j * k, one - 1j * k)  # functions of K: they commute
    return np.asarray(outward.conj(), np.complex128)


def transfer(
    cavity: Cavity, *, points: int, step: float, detuning_hz: float, loss_hz: float, input_port: int
) -> NDArray[np.complex128]:
    """Column of S for light entering `input_port`, on the FFT frequencies of a grid of `points` x `step` s.

    `detuning_hz` is the light's carrier minus the cavity's. Returns (ports, points): out port by frequency; its
    inverse FFT is the impulse response.
    """
    frequency = np.asarray(np.fft.fftfreq(points, step), np.float64) + detuning_hz
    return scattering_matrix(cavity, frequency, loss_hz=loss_hz)[:, :, input_port - 1].T
