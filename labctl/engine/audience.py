"""Whether anybody still looks at a live view: light that nobody watches is a hazard."""

import time
from collections.abc import Callable
from pathlib import Path

from labctl.runs.live.sight import last_look


class Audience:
    """Those who look at the live view in `directory` on a page of a dashboard.

    They have left when nobody has looked for `patience_s`; None: the view is somebody's at a terminal, and never left.
    """

    def __init__(self, directory: Path, patience_s: float | None, clock: Callable[[], float] = time.monotonic) -> None:
        """Somebody has looked just now, by `clock`, in s."""
        self._patience_s = patience_s
        self._directory = directory
        self._clock = clock
        self._last = last_look(directory)
        self._since = clock()

    @property
    def has_left(self) -> bool:
        """Whether nobody has looked for so long."""
        if self._patience_s is None:
            return False
        look, now = last_look(self._directory), self._clock()
        if look != self._last:  # whoever looks may have another clock
            self._last, self._since = look, now
        return now - self._since >= self._patience_s
