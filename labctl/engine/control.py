"""What a run under way is asked: by signals, and by the file of `labctl.runs.live.control_file`, between records."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from instruments.bench import Bench, Observer, Observers
from labctl.bench.signals import Interruption, StoppedBySignal
from labctl.runs.live.control_file import CONTROL, Word, word_in

LOOK_EVERY_S = 0.1
"""How soon a paused run hears that it may go on."""


class HeldBack(GeneratorExit):
    """Light is not wanted now: a protocol ends where it is, as if its generator were closed. Nothing has failed."""


class Control(Observer):
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

    @contextmanager
    def followed(self, bench: Bench) -> Iterator[None]:
        """Inside the block what is asked is heard too while `bench` gets ready for light, which may take minutes."""
        observer = bench.observer
        bench.observer = Observers(observer, self)
        try:
            yield
        finally:
            bench.observer = observer

    def before_light(self) -> None:
        """No light comes on, and nobody is asked for anything, where nothing more is to be measured now.

        Raises:
            HeldBack: so it is.
            StoppedBySignal: the run is to end now.
        """
        if self.holds:
            raise HeldBack

    def while_lit(self) -> None:
        """As `before_light`: what the light is for just now is not recorded."""
        self.before_light()

    def uploading(self, _what: str, _done: int, _total: int) -> None:
        """As `before_light`."""
        self.before_light()

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
