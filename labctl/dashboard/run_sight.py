"""What the channels of a run look like: for the panels of the live view.

The last shots are seen as the run itself shows them while it measures; how things went since its start, from the shots
that it has on disk. Of these only what a page has time for is read: a few of the latest stretches at a time, and at
first some from the start on, so that drift reaches back to there.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from labctl.analysis.course import Course, begun
from labctl.errors import LabctlError
from labctl.runs.live.sight import RECENT, Sight
from labctl.runs.read.follower import Follower, Stretch

MOST_AT_FIRST, MOST_AT_ONCE = 16, 1
"""Stretches that are read from the disk at a look: the first one, and each thereafter."""
STORED_EVERY = 4
"""Looks after which the disk is read again while the run itself shows its last shots."""


class RunSight:
    """The run in `directory`, in the pass that it measures; `sight` is None before there is light to be seen."""

    def __init__(self, directory: Path) -> None:
        """Nothing is read yet."""
        self.sight: Sight | None = None
        self._directory = directory
        self._following: Follower | None = None
        self._read = -1
        self._turn = 0
        self._glimpse: Stretch | None = None
        self._pass = -1

    def look(self) -> None:
        """Read what came since the last look; what cannot be read is not seen."""
        try:
            if self._following is None:
                self._following = Follower(self._directory)
            following, before = self._following, self._glimpse
            self._glimpse = following.glimpse()
            if self._glimpse is not None and self._glimpse is not before:
                self._take(following, self._glimpse)
            if self._glimpse is None or self._turn % STORED_EVERY == 0:
                self._read_stored(following)
            self._turn += 1
        except (LabctlError, KeyError):
            return

    def _read_stored(self, following: Follower) -> None:
        while following.look():
            pass
        new = [number for number in following.stretches() if number > self._read]
        for number in spread(new, MOST_AT_FIRST if self._read < 0 else MOST_AT_ONCE):
            stretch = following.stretch(number)
            self._read = number
            if self._glimpse is None or stretch.pass_index == self._pass:  # or else it is of the pass before
                self._take(following, stretch)

    def _take(self, following: Follower, stretch: Stretch) -> None:
        lit, repeats = stretch.codes[stretch.kinds != b"dark"], stretch.kinds == b"reference"
        if stretch.pass_index != self._pass:
            self._pass = stretch.pass_index
            self._course: Course | None = None
            self._stored = self._repeats = stretch.codes[:0]
            self._peak_v = np.full(len(stretch.ports), -np.inf)
        if not len(lit):
            return
        level_v = stretch.scale * lit.mean(axis=2) + stretch.offset
        self._peak_v = np.maximum(self._peak_v, level_v.max(axis=0))
        if stretch is not self._glimpse:
            self._stored = np.concatenate([self._stored, lit])[-RECENT:]
            self._repeats = np.concatenate([self._repeats, stretch.codes[repeats]])[-RECENT:]
            for time_s, codes in zip(stretch.time_s[repeats], stretch.codes[repeats], strict=True):
                volts = stretch.scale[:, np.newaxis] * codes + stretch.offset[:, np.newaxis]
                self._course = (self._course or begun(volts)).with_more(float(time_s), volts)
        latest = self._glimpse or stretch
        shown = latest.codes[latest.kinds != b"dark"]
        none = np.empty((0, len(stretch.ports)))
        course = self._course
        self.sight = Sight(
            stretch.ports,
            following.shape.sample_interval_s,
            stretch.scale,
            stretch.offset,
            shown if self._glimpse is not None and len(shown) else self._stored,
            np.empty(0) if course is None else course.elapsed_s - course.elapsed_s[0],
            none if course is None else course.level_v,
            none if course is None else course.likeness,
            self._peak_v,
            int(latest.shots[-1]) + 1,
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
