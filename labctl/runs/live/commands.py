"""commands.log: every message to and from every instrument, with time and direction.

Lines are `seconds direction instrument message`, the seconds counted from the opening of the bench. Messages that are
exchanged before the run has a directory wait in memory.
"""

import contextlib
import io
import logging
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TextIO

from instruments.bench import Observer
from labctl.runs.format.durable import not_written

COMMANDS = "commands.log"
"""Name of the file in a run directory."""

_logger = logging.getLogger(__name__)


class CommandLog(Observer):
    """A transcript that a `VisaLink` can write to; a context manager that closes its file.

    As an observer of a run it also has a line for whatever goes wrong. `started` is when its seconds began, by its
    clock; `path` is its file, once there is one. A disk that is full ends the log and nothing else: the messages that
    switch the light off must still go out.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, *, started: float | None = None) -> None:
        """Begin to count the seconds now, or go on with those of another log."""
        self.started = clock() if started is None else started
        self.path: Path | None = None
        self._clock = clock
        self._lines: TextIO = io.StringIO()
        self._ended = False
        self._guard = threading.RLock()  # a warning of the disk may come from the thread that stores a burst

    def __call__(self, instrument: str, direction: str, message: str) -> None:
        """Log one message; line ends inside it are escaped, so that one message is one line."""
        text = message.replace("\r", "\\r").replace("\n", "\\n")
        self._write(f"{self._clock() - self.started:.6f} {direction} {instrument} {text}\n")

    def event(self, name: str, **fields: Any) -> None:
        """A line for an event that has a text."""
        if "text" in fields:
            self("run", "!", str(fields["text"]))

    def warning(self, text: str) -> None:
        """A line."""
        self("run", "!", text)

    def stored_in(self, directory: Path) -> None:
        """Go on in the file of the run.

        Raises:
            RunError: it cannot be opened.
        """
        path = directory / COMMANDS
        try:
            self.keep_in(path)
        except OSError as error:
            raise not_written(path, error) from error

    def keep_in(self, path: Path) -> None:
        """Write what has been logged so far, and everything from now on, to the end of `path`.

        A last line that a killed process has left without its end gets one.

        Raises:
            OSError: it cannot be opened.
        """
        with path.open("ab+") as before:
            if before.tell():
                before.seek(-1, os.SEEK_END)
                if before.read() != b"\n":
                    before.write(b"\n")
        file = path.open("a", encoding="utf-8")
        so_far = self._lines.getvalue() if isinstance(self._lines, io.StringIO) else ""
        self._lines.close()
        self._lines = file
        self.path = path
        self._write(so_far)

    def _write(self, lines: str) -> None:
        if not self._ended:
            with self._guard, self._ending_if_full():
                self._lines.write(lines)

    @contextlib.contextmanager
    def _ending_if_full(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if not self._ended:
                _logger.warning("commands.log cannot be written (%s): it ends here", error.strerror or error)
            self._ended = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._ending_if_full():  # what it still holds may not fit the disk
            self._lines.close()
