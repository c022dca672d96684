"""The multimode fibre: a few hundred delayed copies of the light, each with its own speckle field on the mirrors.

A documented reduction of the guided-mode problem. The launch aperture NA_eff, not the fibre's full one, decides how
many modes carry light, how far apart they arrive and how fine their interference is on the mirrors:

    E(p, t) = K^(-1/2) sum_k B_pk exp(-i 2 pi nu tau_k) u(t - tau_k)

B_pk: circular Gaussian fields over the superpixels p with the covariance of the pupil the launch fills, evenly or with
the Gaussian of a single-mode lead; tau_k spread as the pupil's angles are; nu the optical frequency. Weak mode
coupling, one polarisation, no modal loss. The field of the collecting mode is taken as even over the square.

Sources: Gloge, Appl. Opt. 10, 2252 (1971); Saleh & Teich, ch. 9 (fibre optics); Goodman, Speckle Phenomena in Optics,
ch. 4 (coherence of a pupil); Redding et al., Opt. Express 21, 6584 (2013) for the decorrelation with wavelength.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import j1

from sim_backends.optics.mirrors import SIDE
from sim_backends.parameters import SPEED_OF_LIGHT

LaunchProfile = Literal["filled", "gaussian"]
_HALF_WIDTH = 1.616339948  # |2 J1(x) / x|^2 = 1/2


def v_number(radius: float, aperture: float, wavelength: float) -> float:
    """V = 2 pi a NA / lambda; radius and wavelength in m."""
    return 2 * np.pi * radius * aperture / wavelength


def mode_count(radius: float, aperture: float, wavelength: float) -> int:
    """Guided modes of a step-index fibre in one polarisation, V^2 / 4; radius and wavelength in m."""
    return round(v_number(radius, aperture, wavelength) ** 2 / 4)


def delay_spread(length: float, aperture: float, index: float) -> float:
    """Modal delay spread (s) of `length` m: L NA^2 / (2 n c)."""
    return length * aperture**2 / (2 * index * SPEED_OF_LIGHT)


def speckle_grain(aperture: float, wavelength: float, profile: LaunchProfile = "filled") -> float:
    """Intensity FWHM (m) of the speckle at the fibre's end.

    Filled pupil: 1.616 lambda / (pi NA) = 0.514 lambda / NA. Gaussian far field exp(-2 (sin theta / NA)^2): 2 sqrt(ln2)
    lambda / (pi NA) = 0.530 lambda / NA.
    """
    half_width = _HALF_WIDTH if profile == "filled" else 2 * math.sqrt(math.log(2.0))
    return half_width * wavelength / (np.pi * aperture)


@lru_cache(maxsize=4)
def speckle_basis(grain: float, cut: float, profile: LaunchProfile = "filled") -> NDArray[np.float32]:
    """Real Karhunen-Loeve basis of the speckle field on the 28 x 28 superpixel centres.

    Covariance of the field at distance r, by the van Cittert-Zernike theorem: 2 J1(x) / x with x = 2 * 1.616 r / grain
    for a uniformly filled pupil, exp(-2 ln2 (r / grain)^2) for a Gaussian one. C = U L U^T; a field of this covariance
    is Phi z with Phi = U L^(1/2) and z circular Gaussian of unit variance. Depends on no seed.

    Args:
        grain: intensity FWHM in superpixels.
        cut: part of the power (trace) that may be left out.
        profile: how the launch fills the aperture.

    Returns:
        (784, r) float32, read-only.
    """
    row, column = np.divmod(np.arange(SIDE * SIDE), SIDE)
    distance = np.hypot(row[:, None] - row, column[:, None] - column)
    if profile == "filled":
        x = 2 * _HALF_WIDTH / grain * distance
        covariance = np.where(x > 0, 2 * j1(x) / np.where(x > 0, x, 1.0), 1.0)
    else:
        covariance = np.exp2(-2 * (distance / grain) ** 2)
    power, vectors = np.linalg.eigh(covariance)
    power, vectors = power[::-1], vectors[:, ::-1]
    rank = int(np.searchsorted(np.cumsum(power), (1 - cut) * SIDE * SIDE)) + 1
    basis: NDArray[np.float32] = (vectors[:, :rank] * np.sqrt(np.clip(power[:rank], 0, None))).astype(np.float32)
    basis.setflags(write=False)
    return basis


@dataclass(frozen=True, eq=False)
class FibreModes:
    """One fibre: mode delays (s), shape (K,), and speckle amplitudes, shape (collected modes, r, K)."""

    delays_s: NDArray[np.float64]
    amplitudes: NDArray[np.complex64]


def draw_modes(
    generator: np.random.Generator,
    *,
    modes: int,
    spread: float,
    basis: NDArray[np.float32],
    profile: LaunchProfile = "filled",
    longest: float = math.inf,
    collected_modes: int = 1,
) -> FibreModes:
    """Draw a fibre: mode delays and circular Gaussian amplitudes in `basis`, of mean power 1 over all modes.

    The draw is white noise on the superpixels, projected onto the basis: the fields are then C^(1/2) times that noise,
    whichever way round an eigenvector of C, or a pair of equal power, came out of the linear algebra of this machine.

    The delay of a mode goes with the square of its angle, tau = spread (sin theta / NA)^2, and solid angle with the
    same square: uniform delays up to `spread` (s) for a filled pupil, p(tau) = exp(-2 tau / spread) up to `longest`
    (s, the fibre's full aperture) for a Gaussian one.
    """
    delays = generator.random(modes)
    if profile == "gaussian":
        delays = -0.5 * np.log1p(-delays * (1 - math.exp(-2 * longest / spread)))
    white = generator.standard_normal((2, collected_modes, len(basis), modes), dtype=np.float32)
    parts = (basis / np.linalg.norm(basis, axis=0)).T @ white
    return FibreModes(spread * delays, ((parts[0] + 1j * parts[1]) / np.sqrt(2 * modes)).astype(np.complex64))


def delay_taps(fibre: FibreModes, *, frequency_hz: float, step: float) -> NDArray[np.complex64]:
    """The fibre as a tapped delay line at one optical frequency.

    T_d = sum over modes with round(tau_k / step) = d of z_k exp(-i 2 pi nu tau_k): envelopes are delayed on the grid,
    carrier phases are exact (they carry the dependence on wavelength).

    Args:
        fibre: the modes.
        frequency_hz: optical frequency nu.
        step: grid step of the envelope (s).

    Returns:
        (collected modes, r, D) complex64, tap d delays by d * step.
    """
    phase = np.exp(-2j * np.pi * ((frequency_hz * fibre.delays_s) % 1.0))
    tap = np.rint(fibre.delays_s / step).astype(np.intp)
    to_tap = np.zeros((tap.size, int(tap.max()) + 1), np.complex64)
    to_tap[np.arange(tap.size), tap] = phase
    return fibre.amplitudes @ to_tap
