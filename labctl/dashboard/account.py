"""The account that a run or live view gives of itself, and whether a process still gives it."""

from collections import deque
from pathlib import Path

from labctl.dashboard.state import RunState, advanced
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.store import is_elsewhere
from labctl.runs.live.events import EventReader
from labctl.runs.live.owner import of_another_machine, writer_named

MOST_REPORTED = 8
"""Shots that were reported and may not be on disk yet: two a second, each there after a second by default."""


class Account:
    """What it is doing (`state`), by its events; `reported`: what it was doing at the last shots with light."""

    def __init__(self, directory: Path) -> None:
        """Of the run or live view in `directory`; nothing is read yet."""
        self.state = RunState()
        self.reported: deque[RunState] = deque(maxlen=MOST_REPORTED)
        self._paths = RunPaths(directory)
        self._events = EventReader(self._paths.events)
        self._told = RunState()

    def look(self) -> None:
        """Read what came since the last look."""
        while events := self._events.read():
            for event in events:
                self._told = advanced(self._told, event)
                if self._told.has_shot and event.name == "progress":
                    self.reported.append(self._told)
        started = self._told.started
        unknown = started is None or of_another_machine(started) or is_elsewhere(self._paths.directory)
        gone = started is not None and not unknown and writer_named(started, self._paths) is None
        self.state = self._told.without_writer() if gone else self._told
