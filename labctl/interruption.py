"""Stopping a run from outside: Ctrl-C once finishes the shot, Ctrl-C twice or SIGTERM stops at once."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from labctl.failures import notes


@dataclass
class Interruption:
    """Whether somebody has asked the run to stop."""

    requested: bool = False


class StoppedBySignal(KeyboardInterrupt):
    """The run was told to stop at once."""


@contextmanager
def on_stop_signal(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` at SIGINT or SIGTERM inside the block, and nothing else."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    previous = [signal.signal(number, lambda _number, _frame: stop()) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, previous, strict=True):
            signal.signal(number, handler)


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Take over SIGINT and SIGTERM inside the block.

    Whatever raises on the way out is not interrupted again: the safe state comes first. What fails there is told here,
    since a stop asked for is no error that anybody else would tell. Outside the main thread signals cannot be received,
    and the block runs without them.
    """
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return

    def stop_now() -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        raise StoppedBySignal

    def on_interrupt(_number: int, _frame: FrameType | None) -> None:
        if interruption.requested:
            stop_now()
        interruption.requested = True
        sys.stderr.write("\nstopping after this shot; Ctrl-C again stops at once\n")

    def on_terminate(_number: int, _frame: FrameType | None) -> None:
        interruption.requested = True
        stop_now()

    previous = signal.signal(signal.SIGINT, on_interrupt), signal.signal(signal.SIGTERM, on_terminate)
    try:
        yield interruption
    except KeyboardInterrupt as stopped:
        for note in notes(stopped):
            sys.stderr.write(f"labctl: {note}\n")
        raise
    finally:
        signal.signal(signal.SIGINT, previous[0])
        signal.signal(signal.SIGTERM, previous[1])
