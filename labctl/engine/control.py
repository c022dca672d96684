"""What a run under way is asked: by signals, and by the file of `labctl.runs.live.control_file`, between records."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from labctl.bench.signals import Interruption, StoppedBySignal
from labctl.runs.live.control_file import CONTROL, Word

LOOK_EVERY_S = 0.1
"""How soon a paused run hears that it may go on."""
LONGEST_WORD = 32


class Control:
    """What the run under way is asked, by signals to it (`Interruption`) and by its file."""

    def __init__(self, path: Path, interruption: Interruption) -> None:
        """Look for words in `path`; those of `interruption` come first."""
        self._path = path
        self._interruption = interruption

    @property
    def holds(self) -> bool:
        """Whether nothing more is to be measured now, be it for a while or for good.

        Raises:
            StoppedBySignal: the run is to end now.
        """
        return self._look() is Word.PAUSE or self._interruption.requested

    @property
    def stopped(self) -> bool:
        """Whether the run is to end after this record, as far as it has heard."""
        return self._interruption.requested

    @property
    def paused(self) -> bool:
        """Whether the run is to wait, and does not end.

        Raises:
            StoppedBySignal: it is to end now.
        """
        return self._look() is Word.PAUSE and not self._interruption.requested

    def wait(self) -> None:
        """Return when the run may go on, or is to end."""
        while self.paused:
            self._interruption.wait(LOOK_EVERY_S)

    def _look(self) -> Word | None:
        try:
            with self._path.open("rb") as file:
                word = Word(file.read(LONGEST_WORD).decode().strip())
        except (OSError, ValueError):  # nothing is asked, or nothing that a run knows
            return None
        if word is Word.STOP:
            self._interruption.requested = True
        elif word is Word.STOP_NOW:
            self._interruption.requested = True
            raise StoppedBySignal
        return word


@contextmanager
def controlled(directory: Path, interruption: Interruption) -> Iterator[Control]:
    """Listen inside the block; a word that was left from an earlier time means nothing."""
    path = directory / CONTROL
    with suppress(OSError):
        path.unlink(missing_ok=True)
    try:
        yield Control(path, interruption)
    finally:
        with suppress(OSError):
            path.unlink(missing_ok=True)
