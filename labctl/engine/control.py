"""What a run under way is asked: by signals, and by the file of `labctl.runs.live.control_file`, between records."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from labctl.bench.signals import Interruption, StoppedBySignal
from labctl.runs.live.control_file import CONTROL, Word, word_in

LOOK_EVERY_S = 0.1
"""How soon a paused run hears that it may go on."""


class Control:
    """What the run under way is asked, by signals to it (`interruption`) and by the file at `path`."""

    def __init__(self, path: Path, interruption: Interruption) -> None:
        """Look for words in `path`; those of `interruption` come first."""
        self.path = path
        self.interruption = interruption

    @property
    def holds(self) -> bool:
        """Whether nothing more is to be measured now, be it for a while or for good.

        Raises:
            StoppedBySignal: the run is to end now.
        """
        return self._look() is Word.PAUSE or self.interruption.requested

    @property
    def stopped(self) -> bool:
        """Whether the run is to end after this record, as far as is known."""
        return self.interruption.requested

    @property
    def paused(self) -> bool:
        """Whether the run is to wait, and does not end.

        Raises:
            StoppedBySignal: it is to end now.
        """
        return self._look() is Word.PAUSE and not self.interruption.requested

    def wait(self) -> None:
        """Return when the run may go on, or is to end."""
        while self.paused:
            self.interruption.wait(LOOK_EVERY_S)

    def _look(self) -> Word | None:
        word = word_in(self.path.parent)
        if word is Word.STOP:
            self.interruption.requested = True
        elif word is Word.STOP_NOW:
            self.interruption.requested = True
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
