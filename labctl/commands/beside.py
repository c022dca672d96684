"""Writing beside the work, in a thread of its own: whoever measures does not wait for a terminal.

A terminal that is held (Ctrl-S), or that nobody reads, takes nothing more, and the laser would stay on for as long.
"""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from queue import Empty, SimpleQueue
from typing import IO, NamedTuple, TextIO, cast

from rich.console import Console
from rich.text import Text

from labctl.bench.operator import asked_on
from labctl.printable import printable

EVERY_S = 0.1
"""After so long a picture is drawn again."""
PATIENCE_S = 1.0
"""So long the end waits for the last of it."""


NO_PICTURE = nullcontext()


class _PastTheBuffer:
    """A standard stream without its buffer, whose lock a thread would keep from others while a terminal is held."""

    def __init__(self, name: str) -> None:
        self._name = name

    @property
    def encoding(self) -> str:
        return self._stream.encoding

    def isatty(self) -> bool:
        return self._stream.isatty()

    def fileno(self) -> int:
        return self._stream.fileno()

    def flush(self) -> None:
        """Nothing waits here."""

    def write(self, text: str) -> int:
        with self._opened() as stream:
            return stream.write(text)

    def _opened(self) -> AbstractContextManager[IO[str]]:
        try:
            return open(self.fileno(), "w", encoding=self.encoding, errors="backslashreplace", closefd=False)
        except (OSError, ValueError):  # it is none of the system's
            return nullcontext(self._stream)

    @property
    def _stream(self) -> TextIO:
        return cast(TextIO, getattr(sys, self._name))


def past_the_buffer(name: str) -> IO[str]:
    """What a console for "stdout" or "stderr" writes to."""
    return cast(IO[str], _PastTheBuffer(name))


class _Question(NamedTuple):
    """The operator is asked: the picture is away from the one moment to the other."""

    cleared: threading.Event
    answered: threading.Event


class Beside:
    """What a thread of its own writes to a console while something is done."""

    def __init__(self, console: Console) -> None:
        """Nothing is written yet."""
        self._console = console
        self._lines: SimpleQueue[Text | _Question | None] = SimpleQueue()

    def tell(self, line: str, style: str = "") -> None:
        """Have a line for people printed, above what is drawn."""
        self._lines.put(Text(printable(line), style))

    @contextmanager
    def writing(
        self, picture: AbstractContextManager[object] = NO_PICTURE, draw: Callable[[], object] = lambda: None
    ) -> Iterator[None]:
        """Write until the block ends, `draw` again and again in `picture`; then wait a moment for the rest.

        While the operator is asked for something, nothing is written and the picture is away.

        A terminal that still takes nothing gets the rest later, if this process is there then.
        """
        thread = threading.Thread(target=self._write, args=(picture, draw), daemon=True)
        thread.start()

        @contextmanager
        def cleared() -> Iterator[None]:
            question = _Question(threading.Event(), threading.Event())
            try:
                self._lines.put(question)
                while thread.is_alive() and not question.cleared.wait(EVERY_S):
                    pass
                yield
            finally:
                question.answered.set()

        try:
            with asked_on(cleared):
                yield
        finally:
            self._lines.put(None)
            thread.join(PATIENCE_S)

    def _write(self, picture: AbstractContextManager[object], draw: Callable[[], object]) -> None:
        with suppress(OSError), picture:  # where the console takes nothing, what goes on is worth more
            while True:
                with suppress(Empty):
                    match self._lines.get(timeout=EVERY_S):
                        case None:
                            return
                        case _Question(cleared, answered):
                            picture.__exit__(None, None, None)
                            cleared.set()
                            answered.wait()
                            picture.__enter__()
                        case line:
                            self._console.print(line, soft_wrap=True)
                draw()
