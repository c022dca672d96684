"""The two multimode fibres: what the first throws on the mirrors, what the second takes from them.

The light that arrives at the amplifier is one number, the overlap of the light on the mirrors with one mode of the
collecting fibre:

    a(t) = sum_p v_p sum_k z_pk c_k exp(-i 2 pi nu tau_k) u(t - tau_k),   z_pk = integral over superpixel p of h psi_k

psi_k are the LP modes of the first fibre, imaged on the mirrors, each with its own delay tau_k (see `lp_modes`). The
launch decides how much light a mode has: by the angle at which it leaves, as the Gaussian far field of a single-mode
lead or evenly up to the aperture; c_k is circular Gaussian of that mean power, because modes of one angle mix on the
way. h is the collecting mode: a random sum, of unit power, of modes of the second fibre, whose core is imaged around
the square. nu is the optical frequency. One polarisation, no loss that differs from mode to mode.

Sources: Gloge, Appl. Opt. 10, 2252 (1971); Saleh & Teich, ch. 9 (fibre optics); Goodman, Speckle Phenomena in Optics,
ch. 3; Redding et al., Opt. Express 21, 6584 (2013) for the decorrelation with wavelength.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from sim_backends.optics.drift import OrnsteinUhlenbeck
from sim_backends.optics.lp_modes import LpModes, lp_modes
from sim_backends.optics.mirrors import SIDE
from sim_backends.parameters import SPEED_OF_LIGHT

LaunchProfile = Literal["filled", "gaussian"]
_HALF_WIDTH = 1.616339948  # |2 J1(x) / x|^2 = 1/2
_LEFT_OUT = 3e-3  # part of a Gaussian launch in modes that are not followed: the latest ones
_GAUSS_POINTS = np.array([-0.5, 0.5]) / math.sqrt(3)  # of a superpixel's half width: exact for cubic polynomials
_INTERPOLATED = 6  # grid points that a delayed envelope is interpolated from


class NoSuchModes(ValueError):
    """A fibre has not the modes that are asked of it."""


@dataclass(frozen=True)
class Projector:
    """The optics around the mirrors.

    Attributes:
        wavelength: Where the modes are solved (m).
        core_radius, aperture: Of the first fibre (m, 1).
        index, group_index: Of its core.
        length: m.
        launch_aperture, launch_profile: What the launch fills.
        side: Of the square, on the first fibre's end face (m).
        collection_radius, collection_aperture: Of the collecting fibre's core (m, 1).
        collection_image: Diameter of that core's image on the mirrors, in sides of the square.
        collecting_modes: So many of its modes, the lowest ones, make up the one that is collected.
    """

    wavelength: float
    core_radius: float
    aperture: float
    index: float
    group_index: float
    length: float
    launch_aperture: float
    launch_profile: LaunchProfile
    side: float
    collection_radius: float
    collection_aperture: float
    collection_image: float
    collecting_modes: int


def mode_count(radius: float, aperture: float, wavelength: float, *, within: float | None = None) -> int:
    """Guided modes of a step-index fibre in one polarisation, or those that leave it within an aperture."""
    return lp_modes(radius, aperture, wavelength, up_to_aperture=within).count


def delay_spread(length: float, aperture: float, index: float) -> float:
    """Modal delay spread (s) of `length` m: L NA^2 / (2 n c), Gloge's for angles up to the aperture.

    Of a core whose group index N is not n, n stands for n^2 / N.
    """
    return length * aperture**2 / (2 * index * SPEED_OF_LIGHT)


def speckle_grain(aperture: float, wavelength: float, profile: LaunchProfile = "filled") -> float:
    """Intensity FWHM (m) of the speckle at the fibre's end.

    Filled pupil: 1.616 lambda / (pi NA) = 0.514 lambda / NA. Gaussian far field exp(-2 (sin theta / NA)^2): 2 sqrt(ln2)
    lambda / (pi NA) = 0.530 lambda / NA.
    """
    half_width = _HALF_WIDTH if profile == "filled" else 2 * math.sqrt(math.log(2.0))
    return half_width * wavelength / (np.pi * aperture)


@dataclass(frozen=True, eq=False)
class FibreModes:
    """One fibre with its collection.

    Attributes:
        delays_s: Of each mode against light along the axis, (K,).
        overlaps: z, (collected modes, superpixels, K) complex64: root power into the collected mode for unit c.
        excitation: c, which may drift.
    """

    delays_s: NDArray[np.float64]
    overlaps: NDArray[np.complex64]
    excitation: OrnsteinUhlenbeck


def single_mode() -> FibreModes:
    """A fibre of one mode without delay that all light takes, whatever the mirrors do."""
    return FibreModes(np.zeros(1), np.ones((1, 1, 1), np.complex64), OrnsteinUhlenbeck.constant(np.ones(1)))


@dataclass(frozen=True, eq=False)
class _Modes:
    """Fields of K modes at the Gauss points of the superpixels, (28 * 28, 4, K), their delays (s) and mean powers."""

    fields: NDArray[np.float32]
    delays_s: NDArray[np.float64]
    powers: NDArray[np.float64]


@lru_cache(maxsize=4)
def _launched(projector: Projector) -> _Modes:
    """Modes of the first fibre with light on the square; the powers of all that are launched add up to 1."""
    launch, gaussian = projector.launch_aperture, projector.launch_profile == "gaussian"
    largest = launch * math.sqrt(-math.log(_LEFT_OUT) / 2) if gaussian else launch
    modes = lp_modes(projector.core_radius, projector.aperture, projector.wavelength, up_to_aperture=largest)
    if not modes.count:
        raise NoSuchModes(
            f"launch_na {launch:g}: no mode of a fibre with core_diameter_m {2 * projector.core_radius:g} "
            "lies within it: make either larger"
        )

    def brightness(some: LpModes) -> NDArray[np.float64]:
        sine = some.sine_of_angle(projector.wavelength)[some.twofold]
        return np.exp(-2 * (sine / launch) ** 2) if gaussian else np.ones(some.count)

    seen = modes.reaching(projector.side / math.sqrt(2))
    delays = seen.delays(projector.length, projector.index, projector.group_index, projector.aperture)
    return _Modes(
        np.ascontiguousarray(_by_superpixel(seen.fields(*_gauss_points(projector.side))).transpose(1, 2, 0)),
        delays[seen.twofold],
        brightness(seen) / brightness(modes).sum(),
    )


@lru_cache(maxsize=4)
def _collecting(projector: Projector) -> NDArray[np.float32]:
    """Fields of the collecting fibre's n lowest modes at the Gauss points, (n, 28 * 28, 4)."""
    modes = lp_modes(projector.collection_radius, projector.collection_aperture, projector.wavelength)
    fields = modes.imaged(projector.collection_image * projector.side / 2).fields(*_gauss_points(projector.side))
    lowest = np.argsort(modes.u[modes.twofold], kind="stable")[: projector.collecting_modes]
    return _by_superpixel(fields[lowest])


def _by_superpixel(fields: NDArray[np.float32]) -> NDArray[np.float32]:
    """Fields at the points of the square, (n, 56, 56), as those of its superpixels, (n, 28 * 28, 4)."""
    return fields.reshape(-1, SIDE, 2, SIDE, 2).swapaxes(2, 3).reshape(-1, SIDE * SIDE, 4)


def _gauss_points(side: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two by two points in each superpixel of a square of `side` m around the axis: x and y, (56, 56)."""
    along = ((np.arange(SIDE) - (SIDE - 1) / 2)[:, np.newaxis] + _GAUSS_POINTS).ravel() * (side / SIDE)
    x, y = np.meshgrid(along, along)
    return x, y


def draw_modes(
    generator: np.random.Generator, projector: Projector, *, collected_modes: int = 1, coherence_s: float = math.inf
) -> FibreModes:
    """Draw a fibre and the modes that are collected from it.

    Args:
        generator: where the randomness comes from.
        projector: the optics.
        collected_modes: how many orthogonal modes reach the detectors, as powers.
        coherence_s: time over which the field's correlation falls to 1/e; infinite: the fibre does not drift.

    Raises:
        NoSuchModes: nothing is launched, or there are fewer modes to collect.
    """
    launched, collecting = _launched(projector), _collecting(projector)
    if collected_modes > len(collecting):
        raise NoSuchModes(
            f"collected_modes {collected_modes} exceeds the {len(collecting)} that there are of collection_core_m "
            f"{2 * projector.collection_radius:g} and collection_na {projector.collection_aperture:g}: collect fewer"
        )
    excitation = OrnsteinUhlenbeck.draw(generator, np.sqrt(launched.powers), coherence_s)
    normal = generator.standard_normal((2, len(collecting), collected_modes))
    mixture, _ = np.linalg.qr(normal[0] + 1j * normal[1])
    area = (projector.side / (2 * SIDE)) ** 2
    overlaps = np.empty((collected_modes, SIDE * SIDE, launched.delays_s.size), np.complex64)
    for number, weights in enumerate(mixture.T):
        mode = np.tensordot(weights, collecting, axes=1) * area
        for part, target in ((mode.real, overlaps.real), (mode.imag, overlaps.imag)):
            target[number] = np.matmul(part.astype(np.float32)[:, np.newaxis], launched.fields)[:, 0]
    return FibreModes(launched.delays_s, overlaps, excitation)


def delay_taps(
    fibre: FibreModes, *, frequency_hz: float, step: float, time_s: float = 0.0
) -> tuple[NDArray[np.complex64], int]:
    """The fibre as a tapped delay line at one optical frequency.

    T_d = sum_k z_k c_k exp(-i 2 pi nu tau_k) w_d(tau_k): the envelope is interpolated between `_INTERPOLATED` points of
    its grid (Lagrange), so that delays are exact; so are carrier phases, which carry the dependence on wavelength.

    Args:
        fibre: the modes.
        frequency_hz: optical frequency nu.
        step: grid step of the envelope (s).
        time_s: when, for a fibre that drifts.

    Returns:
        (collected modes, superpixels, D) complex64, and how many taps come before the one without delay.
    """
    if not fibre.delays_s.any():
        return (fibre.overlaps * fibre.excitation.at(time_s)).sum(axis=-1, keepdims=True).astype(np.complex64), 0
    phases = fibre.excitation.at(time_s) * np.exp(-2j * np.pi * ((frequency_hz * fibre.delays_s) % 1.0))
    position = fibre.delays_s / step
    base = np.floor(position).astype(np.intp)
    first = _INTERPOLATED // 2 - 1
    offsets = np.arange(_INTERPOLATED) - first
    weights = _lagrange(position - base, offsets)
    taps = (base[:, np.newaxis] + offsets + first).ravel()
    modes = np.repeat(np.arange(base.size), _INTERPOLATED)
    values = (phases[:, np.newaxis] * weights).ravel().astype(np.complex64)
    spread = csr_array((values, (taps, modes)), shape=(int(taps.max()) + 1, base.size))
    rows = fibre.overlaps.reshape(-1, base.size)
    folded = (spread @ rows.T).T
    return np.ascontiguousarray(folded.reshape(*fibre.overlaps.shape[:2], -1)), first


def _lagrange(place: NDArray[np.float64], nodes: NDArray[np.intp]) -> NDArray[np.float64]:
    """Weights (n, nodes) of Lagrange's interpolation at `place` between values at `nodes`."""
    weights = np.ones((place.size, nodes.size))
    for column, node in enumerate(nodes):
        for other in nodes[nodes != node]:
            weights[:, column] *= (place - other) / (node - other)
    return weights
