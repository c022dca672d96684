"""Reading events.jsonl, which `labctl.runs.live.logs` writes, while it grows."""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from labctl.runs.format.own_files import own_file

EVENTS = "events.jsonl"
"""Name of the file in a run directory."""
LONGEST_LINE = 1 << 16
READ_AT_ONCE = 1 << 20
LARGEST = 1 << 28
"""Bytes that are read: four times what a week's run writes."""
IN_1_1 = {"leg started": "pass started", "leg": "pass", "legs": "passes"}
"""What the events of runs of format 1.1 call a pass."""


@dataclass(frozen=True)
class Event:
    """One line: when (UTC, ISO 8601), what, and what belongs to it."""

    time: str
    name: str
    fields: Mapping[str, Any] = field(default_factory=dict)


class EventReader:
    """Reads a file of events as it grows; memory is that of what one call reads."""

    def __init__(self, path: Path, *, last_bytes: int | None = None) -> None:
        """Begin at the start of `path`, which need not be there yet; or so many bytes before its end."""
        self._path = path
        self._offset = 0
        self._torn = b""
        if last_bytes is not None:
            with suppress(OSError):
                self._offset = max(path.stat().st_size - last_bytes, 0)

    def read(self) -> list[Event]:
        """The events that came since the last call, at most 1 MB of them; call again until there are none.

        A line that is no event is left out, and so is one that is still being written: it comes with the next call. A
        file that became shorter is read from its start.
        """
        try:
            with own_file(self._path) as file:
                if file.seek(0, os.SEEK_END) < self._offset:
                    self._offset, self._torn = 0, b""
                file.seek(self._offset)
                found = file.read(min(READ_AT_ONCE, max(0, LARGEST - self._offset)))
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
