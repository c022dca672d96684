"""How the signals of one picture change since the first record of it, in memory that does not grow."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from labctl.analysis.signal_quality import drift

MOST = 512
"""Records that are kept: when there are so many, every second one is left out, and from then on too; never the last."""


@dataclass(frozen=True)
class Course:
    """Levels of records of one picture, and how like the first of them they are.

    Attributes:
        first: (ports, samples) V, the record that the others are held against.
        elapsed_s: (records,) ascending.
        level_v: (records, ports) mean of each record, V.
        likeness: (records, ports) correlation with the first record, 1 = same shape; NaN where a record is constant.
        peak_v: (ports,) the highest level of any record, kept here or not, V.
        seen: how many records there were.
        every: one in so many is kept, and the last one.
    """

    first: NDArray[np.float64]
    elapsed_s: NDArray[np.float64]
    level_v: NDArray[np.float64]
    likeness: NDArray[np.float64]
    peak_v: NDArray[np.float64]
    seen: int = 0
    every: int = 1

    def with_more(self, elapsed_s: float, volts: NDArray[np.float64]) -> "Course":
        """With a record (ports, samples) in V, so long after the start."""
        found = drift(np.stack([self.first, volts]))
        before = slice(-1 if (self.seen - 1) % self.every else None)  # the last one so far was only kept as the last
        course = replace(
            self,
            elapsed_s=np.append(self.elapsed_s[before], elapsed_s),
            level_v=np.concatenate([self.level_v[before], found.level[1:]]),
            likeness=np.concatenate([self.likeness[before], found.correlation[1:]]),
            peak_v=np.maximum(self.peak_v, found.level[1]),
            seen=self.seen + 1,
        )
        return course if len(course.elapsed_s) < MOST else course.thinned()

    def thinned(self) -> "Course":
        """With every second record, the first of them included, and the last."""
        last = len(self.elapsed_s) - 1
        rows = [*range(0, last, 2), last]
        return replace(
            self,
            elapsed_s=self.elapsed_s[rows],
            level_v=self.level_v[rows],
            likeness=self.likeness[rows],
            every=2 * self.every,
        )


def begun(volts: NDArray[np.float64]) -> Course:
    """The course that begins with a record (ports, samples) in V, which is not yet part of it."""
    none = np.empty((0, len(volts)))
    return Course(volts, np.empty(0), none, none, np.full(len(volts), -np.inf))
