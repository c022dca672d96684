"""A laser that goes on emitting after its run: who is told of it, and how somebody says that it is dark."""

from pathlib import Path

from instruments.safe_state import MAY_EMIT
from labctl.runs.format.store import is_elsewhere
from labctl.runs.live.control_file import Word, ask
from labctl.runs.live.events import EVENTS, Event, EventReader
from labctl.runs.live.logs import EventLog

SEEN_DARK = "seen dark"
"""The event of somebody who has seen that the laser is dark."""
ABOUT_LIGHT = ("emission", "safe state", SEEN_DARK)
TAIL_BYTES = 1 << 16
"""Of the events: the last word about light is among them once a run has ended."""


def disobeys(event: Event) -> bool:
    """Whether an event says that what emits did not go dark when it was told to."""
    disobeyed = event.fields.get("disobeyed")
    return event.name == "safe state" and isinstance(disobeyed, list) and any(name in disobeyed for name in MAY_EMIT)


def may_emit(directory: Path) -> bool:
    """Whether the last word about the laser of the run in `directory` is that it did not go dark.

    Of a run elsewhere it says no: people are warned where that laser is.
    """
    if is_elsewhere(directory):
        return False
    events = EventReader(directory / EVENTS, last_bytes=TAIL_BYTES)
    said = [event for event in events.read() if event.name in ABOUT_LIGHT]
    return bool(said) and disobeys(said[-1])


def say_dark(directory: Path) -> None:
    """Somebody has seen that the laser of the run in `directory` is dark: no command or page warns of it any more.

    Raises:
        OSError: it cannot be written.
    """
    ask(directory, Word.DARK)
    with EventLog() as events:
        events.stored_in(directory)
        events.event(SEEN_DARK)
