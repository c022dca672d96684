"""Guided modes of a step-index fibre in the weakly guiding approximation: LP modes, one polarisation.

    psi(r, phi) = R_l(r) cos or sin (l phi),   R_l = J_l(u r / a) / J_l(u) inside, K_l(w r / a) / K_l(w) outside,
    u J_{l+1}(u) / J_l(u) = w K_{l+1}(w) / K_l(w),   u^2 + w^2 = V^2

The field of a mode and its delay both follow from u: on the end face it is made of waves of transverse wave number
u / a, and beta^2 = (n k)^2 - (u / a)^2. Late modes are the fine ones.

Sources: Gloge, Appl. Opt. 10, 2252 (1971); Snyder & Love, Optical Waveguide Theory, ch. 14; Saleh & Teich, ch. 9.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize.elementwise import find_root
from scipy.special import jn_zeros, jve, kve

from sim_backends.parameters import SPEED_OF_LIGHT

_LATE_ORDER = 3.0
"""Beyond u r / a an order falls off over (u r / a)^(1/3): after so many of these it is some 1e-4 of the field."""


def v_number(radius: float, aperture: float, wavelength: float) -> float:
    """V = 2 pi a NA / lambda; radius and wavelength in m."""
    return 2 * np.pi * radius * aperture / wavelength


@dataclass(frozen=True, eq=False)
class LpModes:
    """Some modes of one fibre; those of an order above 0 stand for two, cosine and sine.

    Attributes:
        order: l, (n,).
        u: Transverse wave number times the core's radius, (n,).
        v_number: V of the fibre.
        radius: Of the core (m), or of its image.
    """

    order: NDArray[np.intp]
    u: NDArray[np.float64]
    v_number: float
    radius: float

    @property
    def twofold(self) -> NDArray[np.intp]:
        """Which mode each field of `fields` belongs to: all cosines, then the sines of those that have one."""
        return np.concatenate([np.arange(self.order.size), np.flatnonzero(self.order)])

    @property
    def count(self) -> int:
        """How many modes these are."""
        return self.twofold.size

    def sine_of_angle(self, wavelength: float) -> NDArray[np.float64]:
        """Sine of the angle at which each mode leaves the fibre, u / (k a), (n,); wavelength in m."""
        return self.u * wavelength / (2 * np.pi * self.radius)

    def imaged(self, radius: float) -> "LpModes":
        """The same modes on an image of the end face whose core has this radius (m)."""
        return LpModes(self.order, self.u, self.v_number, radius)

    def chosen(self, which: NDArray[np.bool_]) -> "LpModes":
        """Some of these modes."""
        return LpModes(self.order[which], self.u[which], self.v_number, self.radius)

    def reaching(self, radius: float) -> "LpModes":
        """Those that have light within `radius` (m) of the axis: an order l keeps out of r < l a / u, its caustic."""
        reached = self.u * min(1.0, radius / self.radius)
        return self.chosen(self.order <= reached + _LATE_ORDER * np.cbrt(reached))

    def fields(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float32]:
        """Field of every mode at the points (x, y), in m from the axis, any shape: (count, *shape) float32, 1/m.

        The square of each, integrated over the whole plane, is 1.
        """
        rho = np.hypot(x, y) / self.radius
        radii, where = np.unique(np.round(rho, 9), return_inverse=True)
        order, u = self.order[:, np.newaxis], self.u[:, np.newaxis]
        w = np.sqrt(self.v_number**2 - u * u)
        inner, outer = radii[radii <= 1], radii[radii > 1]
        cladding = jve(order, u) * kve(order, w * outer) / kve(order, w) * np.exp(w * (1 - outer))
        radial = np.concatenate([jve(order, u * inner), cladding], axis=1)
        radial /= np.sqrt(self._power())[:, np.newaxis]
        angle = np.arctan2(y, x)
        fields = np.empty((self.count, *x.shape), np.float32)
        sine = self.order.size - 1 + np.cumsum(self.order > 0)
        for azimuthal in np.unique(self.order):  # a processor's cache holds those of one order
            some = np.flatnonzero(self.order == azimuthal)
            spread = radial[some][:, where].reshape(-1, *x.shape)
            fields[some] = spread * np.cos(azimuthal * angle)
            if azimuthal:
                fields[sine[some]] = spread * np.sin(azimuthal * angle)
        return fields

    def _power(self) -> NDArray[np.float64]:
        """Integral of (R_l cos l phi)^2 with R_l(a) = J_l(u), (n,) m^2: core and cladding, in closed form."""
        order, u = self.order, self.u
        w = np.sqrt(self.v_number**2 - u * u)
        edge = jve(order, u) ** 2
        core = edge - jve(order - 1, u) * jve(order + 1, u)
        cladding = edge * (kve(order - 1, w) * kve(order + 1, w) / kve(order, w) ** 2 - 1)
        return np.asarray(np.where(order > 0, 0.5, 1.0) * np.pi * self.radius**2 * (core + cladding))

    def delays(self, length: float, index: float, group_index: float, aperture: float) -> NDArray[np.float64]:
        """How much later than light along the axis each mode arrives after `length` m of fibre (s), (n,).

        tau = (L / c) (N n k - (u / a) d(u / a)/dk) / beta - L N / c, du/dV = (u / V) (1 - K_l^2 / (K_{l-1} K_{l+1}))
        (Gloge, eq. 12): N is the group index of the core; that of the cladding is taken to be as much larger than its
        index.
        """
        k = self.v_number / (self.radius * aperture)
        transverse = self.u / self.radius
        w = np.sqrt(self.v_number**2 - self.u**2)
        order = self.order
        confined = 1 - kve(order, w) ** 2 / (kve(order - 1, w) * kve(order + 1, w))
        beta = np.sqrt((index * k) ** 2 - transverse**2)
        late = (index * k - transverse**2 * confined / (index * k)) / beta - 1.0
        return np.asarray(length * group_index / SPEED_OF_LIGHT * late)


def lp_modes(radius: float, aperture: float, wavelength: float, *, up_to_aperture: float | None = None) -> LpModes:
    """All guided modes, or those that leave the fibre within `up_to_aperture`.

    Args:
        radius: Of the core (m).
        aperture: Numerical aperture of the fibre.
        wavelength: m.
        up_to_aperture: Sine of the largest angle wanted; None: the fibre's own.
    """
    v = v_number(radius, aperture, wavelength)
    largest = v if up_to_aperture is None else min(v, v_number(radius, up_to_aperture, wavelength))
    zeros = int(largest / np.pi) + 2
    orders, brackets = [], []
    # A root of order l lies between zeros of J_{l-1} and J_l.
    below = np.concatenate([[0.0], jn_zeros(1, zeros)[:-1]])
    below, order = below[below < largest], 0
    while below.size:
        above = jn_zeros(order, below.size)
        orders.append(np.full(below.size, order))
        brackets.append(np.stack([below, np.minimum(above, v)]))
        below, order = above[above < largest], order + 1
    l_of_each, (low, high) = np.concatenate(orders), np.concatenate(brackets, axis=1)

    def mismatch(u: NDArray[np.float64], order: NDArray[np.intp]) -> NDArray[np.float64]:
        w = np.sqrt(np.maximum(v * v - u * u, 1e-12))
        with np.errstate(over="ignore", invalid="ignore"):
            outside = w * kve(order + 1, w) / kve(order, w)
        outside = np.where(np.isfinite(outside), outside, 2 * order)  # its limit at cut-off, where K_l overflows
        return np.asarray(u * jve(order + 1, u) - outside * jve(order, u))

    guided = mismatch(low + 1e-9, l_of_each) * mismatch(high - 1e-9, l_of_each) < 0
    found = find_root(mismatch, (low[guided] + 1e-9, high[guided] - 1e-9), args=(l_of_each[guided],))
    within = found.x < largest
    return LpModes(l_of_each[guided][within], found.x[within], v, radius)
