"""What the channels of a run look like, from the shots that it has on disk: for the panels of the live view.

Only what a page has time for is read: a few of the latest stretches of shots at a time, and at first some from the
start on, so that drift reaches back to there.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from labctl.analysis.course import Course, begun
from labctl.errors import LabctlError
from labctl.runs.live.sight import RECENT, Sight
from labctl.runs.read.follower import Follower, Stretch

MOST_AT_FIRST, MOST_AT_ONCE = 16, 1
"""Stretches that are read at a look: the first one, and each thereafter."""


class RunSight:
    """The run in `directory`, in the pass that it measures; `sight` is None before there is light on disk."""

    def __init__(self, directory: Path) -> None:
        """Nothing is read yet."""
        self.sight: Sight | None = None
        self._directory = directory
        self._following: Follower | None = None
        self._read = -1
        self._begin(-1)

    def look(self) -> None:
        """Read what came since the last look; what cannot be read is not seen."""
        try:
            if self._following is None:
                self._following = Follower(self._directory)
            while self._following.look():
                pass
            new = [number for number in self._following.stretches() if number > self._read]
            for number in spread(new, MOST_AT_FIRST if self._read < 0 else MOST_AT_ONCE):
                self._take(self._following.stretch(number), self._following.shape.sample_interval_s)
                self._read = number
        except (LabctlError, KeyError):
            return

    def _begin(self, pass_index: int) -> None:
        self._pass = pass_index
        self._course: Course | None = None
        self._shots = 0

    def _take(self, stretch: Stretch, sample_interval_s: float) -> None:
        if stretch.pass_index != self._pass:
            self._begin(stretch.pass_index)
            self._recent = self._repeats = stretch.codes[:0]
            self._peak_v = np.full(len(stretch.ports), -np.inf)
        lit = stretch.codes[stretch.kinds != b"dark"]
        if not len(lit):
            return
        again = stretch.kinds == b"reference"
        self._shots += len(lit)
        self._recent = np.concatenate([self._recent, lit])[-RECENT:]
        self._repeats = np.concatenate([self._repeats, stretch.codes[again]])[-RECENT:]
        level_v = stretch.scale * lit.mean(axis=2) + stretch.offset
        self._peak_v = np.maximum(self._peak_v, level_v.max(axis=0))
        for time_s, codes in zip(stretch.time_s[again], stretch.codes[again], strict=True):
            volts = stretch.scale[:, np.newaxis] * codes + stretch.offset[:, np.newaxis]
            self._course = (self._course or begun(volts)).with_more(float(time_s), volts)
        none = np.empty((0, len(stretch.ports)))
        course = self._course
        self.sight = Sight(
            stretch.ports,
            sample_interval_s,
            stretch.scale,
            stretch.offset,
            self._recent,
            np.empty(0) if course is None else course.elapsed_s - course.elapsed_s[0],
            none if course is None else course.level_v,
            none if course is None else course.likeness,
            self._peak_v,
            self._shots,
            0.0,
            self._repeats,
        )


def spread(numbers: Sequence[int], most: int) -> list[int]:
    """At most so many of some numbers, evenly, the last and, of several, the first among them.

    Example:
        >>> from labctl.dashboard.run_sight import spread
        >>> spread(range(10), 4), spread([7, 8], 4)
        ([0, 3, 6, 9], [7, 8])
    """
    if len(numbers) <= most:
        return list(numbers)
    return [numbers[round(place)] for place in np.linspace(len(numbers) - 1, 0, most)[::-1]]
