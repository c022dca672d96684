"""How long light stays in a stadium, by following rays: straight lines, mirror reflection, Fresnel's coefficients.

A ray carries the power that is left of it. At the wall of a dielectric slab it keeps the part that Fresnel's equations
reflect at the step of the effective index; where a waveguide accepts it, it keeps 1 - T of its power. Nothing is known
here of modes or resonances.

Sources: Bunimovich, Commun. Math. Phys. 65, 295 (1979); Born & Wolf, Principles of Optics, ch. 1.5 (Fresnel).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backends.parameters import SPEED_OF_LIGHT

Reflectance = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""Reflected power where rays meet the wall: arc length (m) and cosine of the angle of incidence, shapes (rays,)."""
_FORGOTTEN = 1e-7  # of a ray's power
_BOUNCES = 2000  # who needs more creeps along the wall, in the dark of every opening


class Bounce(NamedTuple):
    """path (m), (rays,), to the wall; cosine of the angle of incidence; place on the wall; direction behind it."""

    path: NDArray[np.float64]
    cosine: NDArray[np.float64]
    place: NDArray[np.float64]
    direction: NDArray[np.float64]


@dataclass(frozen=True)
class Stadium:
    """Two half circles of `radius` joined by straight walls of length `straight`, m; centred, long axis along x."""

    radius: float
    straight: float

    @property
    def area(self) -> float:
        """m^2."""
        return float(np.pi * self.radius**2 + 2 * self.radius * self.straight)

    @property
    def perimeter(self) -> float:
        """m."""
        return float(2 * np.pi * self.radius + 2 * self.straight)

    def bounced(self, place: NDArray[np.float64], direction: NDArray[np.float64]) -> "Bounce":
        """Rays, (2, rays) each, behind their next mirror reflection."""
        half = self.straight / 2
        rising = np.where(direction[1] != 0, direction[1], 1e-300)
        path = (np.sign(rising) * self.radius - place[1]) / rising
        beside = place[0] + path * direction[0]
        normal = np.stack([np.zeros_like(path), np.sign(rising)])
        round_ = np.abs(beside) > half
        centre = half * np.sign(beside)
        offset = np.stack([place[0] - centre, place[1]])
        along = np.sum(offset * direction, axis=0)
        room = along**2 - np.sum(offset**2, axis=0) + self.radius**2
        to_circle = -along + np.sqrt(np.maximum(room, 0.0))
        path = np.where(round_, to_circle, path)
        there = (offset + path * direction) / self.radius
        normal = np.where(round_, there, normal)
        cosine = np.clip(np.sum(direction * normal, axis=0), 0.0, 1.0)
        turned = direction - 2 * cosine * normal
        return Bounce(path, cosine, place + path * direction, turned / np.hypot(*turned))

    def arc(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Arc length (m) of places on the wall, counter-clockwise from the middle of the right half circle."""
        x, y = place
        half, quarter = self.straight / 2, np.pi / 2 * self.radius
        right = self.radius * np.arctan2(y, x - half)
        left = 2 * quarter + self.straight + self.radius * (np.arctan2(-y, -x - half))
        upper, lower = quarter + half - x, 3 * quarter + self.straight + half + x
        flat = np.where(y > 0, upper, lower)
        found = np.where(x > half, right, np.where(x < -half, left, flat))
        return np.asarray(found % self.perimeter, np.float64)


def fresnel(inside: float, outside: float) -> Reflectance:
    """A wall between two indices for the TE light of a slab.

    Its electric field lies in the plane of the rays, so the wall has a Brewster angle; beyond the critical angle it
    reflects all.
    """

    def reflectance(_arc: NDArray[np.float64], cosine: NDArray[np.float64]) -> NDArray[np.float64]:
        sine = inside / outside * np.sqrt(1 - np.minimum(cosine, 1.0) ** 2)
        refracted = np.sqrt(np.maximum(1 - sine**2, 0.0))
        amplitude = (outside * cosine - inside * refracted) / (outside * cosine + inside * refracted)
        return np.where(sine < 1, amplitude**2, 1.0)

    return reflectance


def openings(stadium: Stadium, count: int, *, width: float, accepted: float, transmission: float) -> Reflectance:
    """Perfect mirrors with `count` openings of `width` (m) along the wall.

    An opening passes the part `transmission` of rays up to the sine `accepted` of the angle of incidence.
    """
    spacing = stadium.perimeter / count

    def reflectance(arc: NDArray[np.float64], cosine: NDArray[np.float64]) -> NDArray[np.float64]:
        met = ((arc + spacing / 2) % spacing < width) & (1 - cosine**2 < accepted**2)
        return np.where(met, 1 - transmission, 1.0)

    return reflectance


def power_left(
    stadium: Stadium, walls: list[Reflectance], *, group_index: float, times: NDArray[np.float64], rays: int, seed: int
) -> NDArray[np.float64]:
    """Power left at `times` (s) of rays that start everywhere and in all directions: (times,), 1 at first."""
    generator = np.random.default_rng(seed)
    place = np.empty((2, 0))
    while place.shape[1] < rays:
        half = stadium.straight / 2
        tried = generator.uniform(-1, 1, (2, rays)) * [[half + stadium.radius], [stadium.radius]]
        inside = np.hypot(np.maximum(np.abs(tried[0]) - half, 0), tried[1]) < stadium.radius
        place = np.concatenate([place, tried[:, inside]], axis=1)[:, :rays]
    angle = generator.uniform(0, 2 * np.pi, rays)
    direction = np.stack([np.cos(angle), np.sin(angle)])
    speed = SPEED_OF_LIGHT / group_index
    power, time = np.ones(rays), np.zeros(rays)
    left = np.zeros(times.size)
    for _ in range(_BOUNCES):
        path, cosine, place, direction = stadium.bounced(place, direction)
        until = time + path / speed
        first, last = np.searchsorted(times, time), np.searchsorted(times, until)
        steps = np.bincount(first, power, times.size + 1) - np.bincount(last, power, times.size + 1)
        left += np.cumsum(steps)[:-1]
        for wall in walls:
            power = power * wall(stadium.arc(place), cosine)
        going = (until < times[-1]) & (power > _FORGOTTEN)
        place, direction, power, time = place[:, going], direction[:, going], power[going], until[going]
    left += np.cumsum(np.bincount(np.searchsorted(times, time), power, times.size + 1))[:-1]
    return left / rays


def lifetime(times: NDArray[np.float64], power: NDArray[np.float64], *, between: tuple[float, float]) -> float:
    """Time constant (s) of the exponential through `power` where it is between two parts of its beginning."""
    low, high = between
    used = (power > low) & (power < high)
    return float(-1 / np.polyfit(times[used], np.log(power[used]), 1)[0])
