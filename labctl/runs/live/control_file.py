"""What can be requested of a running run from outside: one word in the file `control` of its directory.

A request needs nothing but the right to write there, so it works on every system and over a shared folder. Only what
must not wait for the end of a record is a signal besides. `labctl.engine.control` is the run's side of it.
"""

from enum import StrEnum
from pathlib import Path

from labctl.runs.format.durable import show_file
from labctl.runs.format.own_files import own_file

CONTROL = "control"
"""Name of the file in a run directory."""
LONGEST_WORD = 32


class Word(StrEnum):
    """What can be requested.

    PAUSE: go dark after this record and wait. GO_ON: the end of a pause. STOP: end after this record. STOP_NOW: end.
    DARK: somebody has seen that the laser is dark; for the supervisor of a run that has ended.
    """

    PAUSE = "pause"
    GO_ON = "go on"
    STOP = "stop"
    STOP_NOW = "stop now"
    DARK = "dark"


def word_in(directory: Path) -> Word | None:
    """What is asked of the run in `directory`; None for nothing, or nothing that a run knows."""
    try:
        with own_file(directory / CONTROL) as file:
            return Word(file.read(LONGEST_WORD).decode().strip())
    except (OSError, ValueError):
        return None


def ask(directory: Path, word: Word) -> None:
    """Ask the run in `directory` for something; the file appears whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    show_file(directory / CONTROL, f"{word}\n".encode())
