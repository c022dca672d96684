"""What a run lets those see who look at it while it measures, long before its shots are on disk."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.values import Frames, Scaling
from labctl.engine.audience import Audience
from labctl.runs.live.glimpse import GLIMPSE, Glimpse, write_glimpse
from labctl.runs.live.sight import LOOKED, RECENT

EVERY_S = 0.12
"""Eight times a second, which is more often than a page draws."""
PATIENCE_S = 3.0
"""For so long after the last look somebody may still be there: a page says once a second that it is open."""
MOST_BYTES = 1 << 20
"""Of samples at a time: of long records fewer are shown, and of the longest none before they are on disk."""


class Glimpses:
    """The last shots of the run in `directory`, for whoever looks, until nobody has looked for a while."""

    def __init__(self, directory: Path, clock: Callable[[], float] = time.monotonic) -> None:
        """Nothing is shown before the first record."""
        self._directory = directory
        self._clock = clock
        self._due = clock()
        self._audience = Audience(directory, PATIENCE_S, clock)
        self._pass = -1
        self._last: deque[tuple[int, float, NDArray[Any]]] = deque(maxlen=RECENT)

    def take(self, pass_index: int, first: int, frames: Frames, scalings: Sequence[Scaling]) -> None:
        """Show the shots from `first` on, `time_s` since the run began, after those before them, if it is time again.

        To be called while there is a file `LOOKED`. Where a glimpse cannot be written nothing is shown.
        """
        if pass_index != self._pass:
            self._pass = pass_index
            self._last.clear()
        count = len(frames)
        rows = frames.codes[-RECENT:].copy() if count > RECENT else frames.codes  # the rest of a burst is not kept
        shots = range(first + count - len(rows), first + count)
        self._last.extend(zip(shots, frames.time_s[-RECENT:].tolist(), rows, strict=True))
        now = self._clock()
        if now < self._due:
            return
        self._due = now + EVERY_S
        if self._audience.has_left:
            self.close()
        elif most := MOST_BYTES // rows[0].nbytes:
            with suppress(OSError):
                write_glimpse(self._directory, self._seen(most, scalings))

    def close(self) -> None:
        """Show nothing any more, until somebody looks again."""
        self._last.clear()
        for name in (LOOKED, GLIMPSE):
            with suppress(OSError):
                (self._directory / name).unlink(missing_ok=True)

    def _seen(self, most: int, scalings: Sequence[Scaling]) -> Glimpse:
        shots, time_s, codes = zip(*list(self._last)[-most:], strict=True)
        scale_v, offset_v = np.array([(one.scale_v, one.offset_v) for one in scalings]).T
        return Glimpse(self._pass, np.array(shots, np.int64), np.array(time_s), np.stack(codes), scale_v, offset_v)
