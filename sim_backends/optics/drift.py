"""What wanders slowly: Ornstein-Uhlenbeck processes, Gaussian with the correlation exp(-|t| / tau), at any time.

A sum of oscillations whose frequencies are spread as the Lorentzian spectrum of the process. Its value is a function of
the draw and of the time alone: no step from one time to the next has to be carried out. Over times much longer than
tau the correlation of this sum is not 0 but random, about 1 / sqrt(`_COMPONENTS`).

Sources: Uhlenbeck & Ornstein, Phys. Rev. 36, 823 (1930); Shinozuka & Deodatis, Appl. Mech. Rev. 44, 191 (1991) for the
sum of oscillations.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

_COMPONENTS = 128


@dataclass(frozen=True, eq=False)
class OrnsteinUhlenbeck:
    """Independent complex processes: amplitudes (n, components) of oscillations at `angular` (rad/s), (components,)."""

    amplitudes: NDArray[np.complex128]
    angular: NDArray[np.float64]

    @classmethod
    def draw(cls, generator: np.random.Generator, rms: NDArray[np.float64], correlation_s: float) -> Self:
        """Circular Gaussian processes of these `rms` values, (n,), with a correlation time; infinite: constants."""
        components = _COMPONENTS if math.isfinite(correlation_s) else 1
        quantiles = (np.arange(components) + 0.5) / components
        angular = np.tan(np.pi * (quantiles - 0.5)) / correlation_s
        normal = generator.standard_normal((2, rms.size, components))
        scale = rms[:, np.newaxis] / math.sqrt(2 * components)
        return cls(scale * (normal[0] + 1j * normal[1]), angular)

    @classmethod
    def constant(cls, values: NDArray[np.float64]) -> Self:
        """What does not wander."""
        return cls(values[:, np.newaxis].astype(np.complex128), np.zeros(1))

    def at(self, time_s: float) -> NDArray[np.complex128]:
        """The values at a time (s), (n,)."""
        values: NDArray[np.complex128] = self.amplitudes @ np.exp(1j * self.angular * time_s)
        return values
