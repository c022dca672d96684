"""The two logs of a run, lines of text that are only ever appended to.

commands.log has every message to and from every instrument: `seconds direction instrument message`, the seconds counted
from the opening of the bench. events.jsonl has what the run is doing, for whoever watches it, one JSON object a line:

    {"time": "2026-11-21T09:15:00.125Z", "event": "progress", "done": 40, "total": 2200, "rate_per_s": 612.4, ...}

`time` is UTC and `event` one of the names in docs/reference/run-format.md; the rest belongs to the event. Lines are
handed to the operating system and not synced: what the run has measured is in its journal, not here.
"""

import io
import json
import logging
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from instruments.bench import Observer
from instruments.safe_state import UnsafeBench
from labctl.runs.format.durable import not_written
from labctl.runs.format.own_files import opened
from labctl.runs.live.events import EVENTS

COMMANDS = "commands.log"
"""Name of the file in a run directory."""
PROGRESS_EVERY_S = 0.5
LARGE = 64_000_000
"""Bytes of events.jsonl from which on progress is written seldom: a week's run does not fill the disk with it."""
SELDOM_S = 10.0
INTERRUPTIONS = ("paused", "link lost", "link recovered")

_logger = logging.getLogger(__name__)


class _Lines:
    """A file that is only ever appended to; lines that come before there is one wait in memory.

    A disk that is full ends it and nothing else: the messages that switch the light off must still go out.
    """

    def __init__(self, name: str, buffering: int) -> None:
        self._name, self._buffering = name, buffering
        self._file: IO[bytes] = io.BytesIO()
        self._ended = False
        self._guard = threading.RLock()  # a warning of the disk may come from the thread that stores a burst

    @property
    def size(self) -> int:
        """Bytes up to its end."""
        return self._file.tell()

    def keep_in(self, path: Path) -> None:
        """Go on at the end of `path`; a last line that a killed process left without its end gets one.

        Raises:
            OSError: it cannot be opened.
        """
        raw = io.FileIO(path, "ab+", opener=opened)
        file: IO[bytes] = io.BufferedRandom(raw, self._buffering) if self._buffering else raw
        torn = file.seek(0, os.SEEK_END) and file.seek(-1, os.SEEK_END) >= 0 and file.read(1) != b"\n"
        so_far = self._file.getvalue() if isinstance(self._file, io.BytesIO) else b""
        self._file.close()
        self._file = file
        self.append((b"\n" if torn else b"") + so_far)

    def append(self, lines: bytes) -> None:
        """Whole lines."""
        if not self._ended:
            with self._guard, self._ending_if_full():
                self._file.write(lines)

    def end(self, error: OSError) -> None:
        """Nothing more is written, because of `error`."""
        if not self._ended:
            _logger.warning("%s cannot be written (%s): it ends here", self._name, error.strerror or error)
        self._ended = True

    def close(self) -> None:
        with self._ending_if_full():  # what it still holds may not fit the disk
            self._file.close()

    @contextmanager
    def _ending_if_full(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.end(error)


class CommandLog(Observer):
    """A transcript that a `VisaLink` can write to; a context manager that closes its file.

    As an observer of a run it also has a line for whatever goes wrong. `started` is when its seconds began, by its
    clock; `path` is its file, once there is one.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, *, started: float | None = None) -> None:
        """Begin to count the seconds now, or go on with those of another log."""
        self.started = clock() if started is None else started
        self.path: Path | None = None
        self._clock = clock
        self._lines = _Lines(COMMANDS, io.DEFAULT_BUFFER_SIZE)

    def __call__(self, instrument: str, direction: str, message: str) -> None:
        """Log one message; line ends inside it are escaped, so that one message is one line."""
        text = message.replace("\r", "\\r").replace("\n", "\\n")
        self._lines.append(f"{self._clock() - self.started:.6f} {direction} {instrument} {text}\n".encode())

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

        Raises:
            OSError: it cannot be opened.
        """
        self._lines.keep_in(path)
        self.path = path

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lines.close()


def _now() -> datetime:
    return datetime.now(UTC)


class EventLog(Observer):
    """Writes the events of a run; a context manager that closes its file."""

    def __init__(self, clock: Callable[[], float] = time.monotonic, now: Callable[[], datetime] = _now) -> None:
        """`clock` paces what is reported again and again, in s; `now` stamps every line."""
        self._clock = clock
        self._now = now
        self._lines = _Lines(EVENTS, 0)
        self._due = {"progress": 0.0, "uploading": 0.0, "powers read": 0.0}
        self._measured: tuple[float, int] | None = None
        self._rate: float | None = None

    def event(self, name: str, **fields: Any) -> None:
        """Write one event now."""
        if name in INTERRUPTIONS:  # the next rate is not to be taken over a time in which nothing was to be measured
            self._measured = None
        stamp = self._now().isoformat(timespec="milliseconds").replace("+00:00", "Z")
        self._lines.append(json.dumps({"time": stamp, "event": name} | fields, default=str).encode() + b"\n")

    def emission(self, *, on: bool) -> None:
        """An event."""
        self.event("emission", on=on)

    def safe_state(self, error: UnsafeBench | None) -> None:
        """An event."""
        failed = {} if error is None else {"disobeyed": sorted(error.disobeyed), "text": str(error)}
        self.event("safe state", reached=error is None, **failed)

    def warning(self, text: str) -> None:
        """An event."""
        self.event("warning", text=text)

    def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
        """An event with rate and remaining time, unless there was one just now."""
        at = self._clock()
        if not self._is_due("progress", at) and done < total:
            return
        if self._measured is not None and at > self._measured[0]:
            self._rate = (done - self._measured[1]) / (at - self._measured[0])
        self._measured = at, done
        remaining = {"rate_per_s": self._rate, "remaining_s": (total - done) / self._rate} if self._rate else {}
        self.event("progress", done=done, total=total, **remaining, **last())

    def uploading(self, what: str, done: int, total: int) -> None:
        """An event, unless there was one just now; at the end always."""
        at = self._clock()
        if self._is_due("uploading", at) or done >= total:
            self.event("uploading", what=what, done=done, total=total)

    def powers(self, found: Mapping[str, float]) -> None:
        """An event, unless there was one just now."""
        if self._is_due("powers read", self._clock()):
            self.event("powers read", **found)

    def stored_in(self, directory: Path) -> None:
        """Go on in the file of the run."""
        self.keep_in(directory / EVENTS)

    def keep_in(self, path: Path) -> None:
        """Write what has happened so far, and everything from now on, to the end of `path`."""
        try:
            self._lines.keep_in(path)
        except OSError as error:
            self._lines.end(error)

    def _is_due(self, event: str, at: float) -> bool:
        due = at >= self._due[event]
        if due:
            self._due[event] = at + (SELDOM_S if self._lines.size >= LARGE else PROGRESS_EVERY_S)
        return due

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Say how the run ended, if an error ends it, and close the file."""
        if isinstance(error, Exception):
            self.event("failed", error=" ".join(str(error).split()), notes=list(getattr(error, "__notes__", ())))
        elif error is not None:
            self.event("stopped", at_once=True, notes=list(getattr(error, "__notes__", ())))
        self._lines.close()
