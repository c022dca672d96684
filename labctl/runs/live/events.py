"""events.jsonl: what a run is doing, for whoever watches it; one JSON object a line, only ever appended to.

    {"time": "2026-11-21T09:15:00.125Z", "event": "progress", "done": 40, "total": 2200, "rate_per_s": 612.4, ...}

`time` is UTC and `event` one of the names in docs/reference/run-format.md; the rest belongs to the event. Lines are
handed to the operating system one by one and not synced: what the run has measured is in its journal, not here.
"""

import json
import logging
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from instruments.bench import Observer
from instruments.safe_state import UnsafeBench

EVENTS = "events.jsonl"
"""Name of the file in a run directory."""
PROGRESS_EVERY_S = 0.5
LARGE = 64_000_000
"""Bytes of the file from which on progress is written seldom: a week's run does not fill the disk with it."""
SELDOM_S = 10.0
INTERRUPTIONS = ("paused", "link lost", "link recovered")
LONGEST_LINE = 1 << 16
READ_AT_ONCE = 1 << 20
IN_1_1 = {"leg started": "pass started", "leg": "pass", "legs": "passes"}
"""What the events of runs of format 1.1 call a pass."""

_logger = logging.getLogger(__name__)


def _now() -> datetime:
    return datetime.now(UTC)


class EventLog(Observer):
    """Writes the events of a run; a context manager that closes its file.

    Events that come before the run has a directory wait in memory. A disk that is full ends the log and nothing else.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, now: Callable[[], datetime] = _now) -> None:
        """`clock` paces what is reported again and again, in s; `now` stamps every line."""
        self._clock = clock
        self._now = now
        self._file: FileIO | None = None
        self._waiting: list[bytes] = []
        self._ended = False
        self._every_s = PROGRESS_EVERY_S
        self._due = {"progress": 0.0, "uploading": 0.0}
        self._measured: tuple[float, int] | None = None
        self._rate: float | None = None

    def event(self, name: str, **fields: Any) -> None:
        """Write one event now."""
        if name in INTERRUPTIONS:  # the next rate is not to be taken over a time in which nothing was to be measured
            self._measured = None
        stamp = self._now().isoformat(timespec="milliseconds").replace("+00:00", "Z")
        line = json.dumps({"time": stamp, "event": name} | fields, default=str).encode() + b"\n"
        if self._file is None:
            self._waiting.append(line)
        else:
            self._write(line)

    def emission(self, *, on: bool) -> None:
        """An event."""
        self.event("emission", on=on)

    def safe_state(self, error: UnsafeBench | None) -> None:
        """An event."""
        self.event("safe state", reached=error is None, **({} if error is None else {"text": str(error)}))

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

    def stored_in(self, directory: Path) -> None:
        """Go on in the file of the run."""
        self.keep_in(directory / EVENTS)

    def keep_in(self, path: Path) -> None:
        """Write what has happened so far, and everything from now on, to the end of `path`."""
        try:
            self._file = FileIO(path, "a+")
            size = self._file.seek(0, os.SEEK_END)
            torn = size and self._file.seek(size - 1) >= 0 and self._file.read(1) != b"\n"
        except OSError as error:
            self._end(error)
            return
        if size >= LARGE:
            self._every_s = SELDOM_S
        self._write(b"".join((b"\n" if torn else b"", *self._waiting)))
        self._waiting.clear()

    def _is_due(self, event: str, at: float) -> bool:
        due = at >= self._due[event]
        if due:
            self._due[event] = at + self._every_s
        return due

    def _write(self, lines: bytes) -> None:
        if self._ended or self._file is None:
            return
        try:
            self._file.write(lines)
            if self._file.tell() >= LARGE:
                self._every_s = SELDOM_S
        except OSError as error:
            self._end(error)

    def _end(self, error: OSError) -> None:
        _logger.warning("%s cannot be written (%s): it ends here", EVENTS, error.strerror or error)
        self._ended = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Tell how the run ended, if an error ends it, and close the file."""
        if isinstance(error, Exception):
            self.event("failed", error=" ".join(str(error).split()), notes=list(getattr(error, "__notes__", ())))
        elif error is not None:
            self.event("stopped", at_once=True, notes=list(getattr(error, "__notes__", ())))
        if self._file is not None:
            self._file.close()


@dataclass(frozen=True)
class Event:
    """One line: when (UTC, ISO 8601), what, and what belongs to it."""

    time: str
    name: str
    fields: Mapping[str, Any] = field(default_factory=dict)


class EventReader:
    """Reads a file of events as it grows; memory is that of what one call reads."""

    def __init__(self, path: Path) -> None:
        """Begin at the start of `path`, which need not be there yet."""
        self._path = path
        self._offset = 0
        self._torn = b""

    def read(self) -> list[Event]:
        """The events that came since the last call, at most 1 MB of them; call again until there are none.

        A line that is no event is left out, and so is one that is still being written: it comes with the next call. A
        file that became shorter is read from its start.
        """
        try:
            with self._path.open("rb") as file:
                if os.fstat(file.fileno()).st_size < self._offset:
                    self._offset, self._torn = 0, b""
                file.seek(self._offset)
                found = file.read(READ_AT_ONCE)
        except OSError:
            return []
        self._offset += len(found)
        *lines, self._torn = (self._torn + found).split(b"\n")
        if len(self._torn) > LONGEST_LINE:
            self._torn = self._torn[:LONGEST_LINE]  # no event: it only has to stay too long to be one
        return [event for line in lines if (event := _event(line)) is not None]


def _event(line: bytes) -> Event | None:
    if not 0 < len(line) < LONGEST_LINE:
        return None
    try:
        values = json.loads(line)
        stamp, name = values.pop("time"), values.pop("event")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    if not isinstance(stamp, str) or not isinstance(name, str):
        return None
    return Event(stamp, IN_1_1.get(name, name), {IN_1_1.get(key, key): value for key, value in values.items()})
