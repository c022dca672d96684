"""What wanders slowly: Ornstein-Uhlenbeck processes, Gaussian with the correlation exp(-|t| / tau), at any time.

A value is a function of the draw and of the time alone: no step from one time to the next has to be carried out. Times
`_SPAN` tau apart have values of their own. Between two of them the one in the middle is drawn, given both; then the one
in the middle of the half in which the time lies, and so on. Given x_0 and x_1, 2 h apart, the value in the middle has
the mean (x_0 + x_1) / (2 cosh(h / tau)) and tanh(h / tau) of the variance, since the process is Markov's.

Sources: Uhlenbeck & Ornstein, Phys. Rev. 36, 823 (1930); Karatzas & Shreve, Brownian Motion and Stochastic Calculus,
2.3, for Levy's construction by midpoints, here of the stationary process.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

_SPAN = 32.0  # tau: what is so far apart is as good as independent
_HALVINGS = 20  # down to 3e-5 tau; values between are on a straight line


@dataclass(frozen=True, eq=False)
class OrnsteinUhlenbeck:
    """Independent complex processes, n of them.

    Attributes:
        first: (n,) values at the time 0, and for ever without drift.
        rms: (n,) of each.
        correlation_s: tau; infinite: they are constants.
        key: of their random numbers, (2,).
    """

    first: NDArray[np.complex128]
    rms: NDArray[np.float64]
    correlation_s: float
    key: NDArray[np.uint64]

    @classmethod
    def draw(cls, generator: np.random.Generator, rms: NDArray[np.float64], correlation_s: float) -> Self:
        """Circular Gaussian processes of these `rms` values, (n,), with a correlation time; infinite: constants."""
        first = _circular(generator, rms)
        if not math.isfinite(correlation_s):
            return cls.constant(first)
        return cls(first, rms, correlation_s, generator.integers(2**64, size=2, dtype=np.uint64))

    @classmethod
    def constant(cls, values: NDArray[np.inexact]) -> Self:
        """What does not wander."""
        return cls(values.astype(np.complex128), np.zeros(values.size), math.inf, np.zeros(2, np.uint64))

    def at(self, time_s: float) -> NDArray[np.complex128]:
        """The values at a time (s), from 0 on, (n,)."""
        if not math.isfinite(self.correlation_s):
            return self.first
        number, place = divmod(time_s / self.correlation_s / _SPAN, 1.0)
        index = int(number)
        left = self._drawn(0, index) if index else self.first
        right, half = self._drawn(0, index + 1), _SPAN / 2
        for level in range(1, _HALVINGS + 1):
            middle = (left + right) / (2 * math.cosh(half)) + math.sqrt(math.tanh(half)) * self._drawn(level, index)
            later, place = divmod(2 * place, 1.0)
            left, right = (middle, right) if later else (left, middle)
            index, half = 2 * index + int(later), half / 2
        return left + place * (right - left)

    def _drawn(self, level: int, index: int) -> NDArray[np.complex128]:
        """Of each process a number of its rms, which belongs to one middle after so many halvings."""
        return _circular(np.random.Generator(np.random.Philox(counter=[0, 0, index, level], key=self.key)), self.rms)


def _circular(generator: np.random.Generator, rms: NDArray[np.float64]) -> NDArray[np.complex128]:
    real, imaginary = generator.standard_normal((2, rms.size))
    drawn: NDArray[np.complex128] = rms / math.sqrt(2) * (real + 1j * imaginary)
    return drawn
