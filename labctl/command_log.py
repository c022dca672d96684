"""commands.log: every message to and from every instrument, with time and direction.

Lines are `seconds direction instrument message`, the seconds counted from the opening of the bench. Messages that are
exchanged before the run has a directory wait in memory.
"""

import io
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self, TextIO


class CommandLog:
    """A transcript that a `VisaLink` can write to; a context manager that closes its file."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin to count the seconds now."""
        self._clock = clock
        self._started = clock()
        self._lines: TextIO = io.StringIO()

    def __call__(self, instrument: str, direction: str, message: str) -> None:
        """Log one message; line ends inside it are escaped, so that one message is one line."""
        text = message.replace("\r", "\\r").replace("\n", "\\n")
        self._lines.write(f"{self._clock() - self._started:.6f} {direction} {instrument} {text}\n")

    def keep_in(self, path: Path) -> None:
        """Write what has been logged so far, and everything from now on, to the end of `path`."""
        file = path.open("a", encoding="utf-8")
        if isinstance(self._lines, io.StringIO):
            file.write(self._lines.getvalue())
        self._lines.close()
        self._lines = file

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lines.close()
