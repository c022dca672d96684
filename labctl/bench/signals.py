"""Stopping a run from outside: Ctrl-C once finishes the shot; twice, SIGTERM or a closed terminal stop at once."""

import os
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import FrameType

from labctl.bench.standard_error import STANDARD_ERROR, tell_past_the_buffer
from labctl.errors import notes
from labctl.printable import printable

STOPS: tuple[signal.Signals, ...] = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
)
"""Ctrl-C, a request to end, terminal closed; on Windows Ctrl-Break.

A console that is closed there is a SIGBREAK too, but the process is killed before Python handles it
(python/cpython#96289): the supervisor makes the bench safe.
"""
SUSPEND: tuple[signal.Signals, ...] = (signal.SIGTSTP,) if hasattr(signal, "SIGTSTP") else ()
"""Ctrl-Z: a stopped process leaves the laser as it is."""
STANDARD_OUTPUT = 1
UNDER_WAY = "what is under way"
"""Of several things side by side: shots, and examinations of runs, which take longer."""


@dataclass
class Interruption:
    """Whether somebody has asked the run to stop; `wait` passes seconds while it is paused."""

    requested: bool = False
    wait: Callable[[float], None] = time.sleep


class StoppedBySignal(KeyboardInterrupt):
    """The operator stopped the run at once."""


@contextmanager
def stops_heard() -> Iterator[Callable[[float], bool]]:
    """Inside the block, whatever asks the process to end does nothing else than end a wait.

    What is yielded waits for so many seconds at most, and says whether the process was asked to end. A signal can come
    at any line, so that what handles it takes no lock: the wait of a `threading.Event` would hold it up for ever.
    """
    waiting, telling = socket.socketpair()
    telling.settimeout(0)

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        with suppress(BlockingIOError):  # it was told often enough
            telling.send(b"\0")

    with waiting, telling, _handling(on_signal, _taken_over()):
        yield lambda seconds: bool(select.select([waiting], [], [], seconds)[0])


@contextmanager
def interruptible(finished_first: str = "this shot") -> Iterator[Interruption]:
    """Take over SIGINT, SIGTERM and SIGHUP inside the block; Ctrl-Z does not suspend it.

    Whoever presses Ctrl-C is told what is `finished_first`.

    Whatever raises on the way out is not interrupted again: the safe state comes first. What fails there is printed
    here, since a stop that was asked for is no error that anybody else would report. Outside the main thread signals
    cannot be received, and the block runs without them.
    """
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    terminals = [stream for stream in (STANDARD_OUTPUT, STANDARD_ERROR) if os.isatty(stream)]
    turned_off: set[signal.Signals] = set()

    def on_signal(number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGINT and not interruption.requested:
            interruption.requested = True
            _tell(f"\nstopping after {finished_first}; Ctrl-C again stops at once\n")
            return
        interruption.requested = True
        turned_off.update(_heeded())
        for stop in turned_off:
            signal.signal(stop, signal.SIG_IGN)
        _leave_closed(terminals)
        raise StoppedBySignal

    def on_suspend(_number: int, _frame: FrameType | None) -> None:
        _tell("\na run is not suspended, since its light would stay on; Ctrl-C ends it\n")

    def on_unheard() -> None:
        for stop in turned_off:
            signal.signal(stop, on_signal)

    with _handling(on_signal, _taken_over()), _handling(on_suspend, SUSPEND), _told_of_unheard(on_unheard):
        try:
            yield interruption
        except KeyboardInterrupt as stopped:
            with suppress(OSError):
                for note in notes(stopped):
                    sys.stderr.write(f"labctl: {printable(note)}\n")
            raise


@contextmanager
def _told_of_unheard(tell: Callable[[], None]) -> Iterator[None]:
    """Call `tell` where Python drops a stop: it lets no error out of what ends an object, or of what watches that."""
    before = sys.unraisablehook

    def on_dropped(dropped: "sys.UnraisableHookArgs") -> None:
        if isinstance(dropped.exc_value, StoppedBySignal):
            tell()
        else:
            before(dropped)

    sys.unraisablehook = on_dropped
    try:
        yield
    finally:
        sys.unraisablehook = before


@contextmanager
def stops_deferred() -> Iterator[None]:
    """Whatever asks the process to end inside the block is heard at its end: nothing cuts the safe state short.

    What the block fails at is then a note to the stop.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pending: list[int] = []

    def defer(number: int, _frame: FrameType | None) -> None:
        pending.append(number)
        _tell("\nthe bench is made safe first\n")

    try:
        with _handling(defer, _heeded()):
            yield
    except Exception as failure:
        with _noting(failure):
            _raise_again(pending)
        raise
    _raise_again(pending)


def heeds_signals() -> bool:
    """Whether SIGTERM ends this process in good order."""
    return callable(signal.getsignal(signal.SIGTERM))


def _raise_again(pending: list[int]) -> None:
    for number in pending:
        signal.raise_signal(number)


@contextmanager
def _noting(failure: Exception) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt as stopped:
        stopped.add_note(str(failure))
        raise


@contextmanager
def _handling(handler: Callable[[int, FrameType | None], None], numbers: Sequence[signal.Signals]) -> Iterator[None]:
    """Call `handler` inside the block; what handled the signals before does so again afterwards."""
    previous = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, before in previous.items():
            signal.signal(number, before)


def _taken_over() -> list[signal.Signals]:
    """All but what `nohup` has turned off. Shells turn off Ctrl-C for what they start behind; a run must hear it."""
    return [number for number in STOPS if number.name != "SIGHUP" or number in _heeded()]


def _heeded() -> list[signal.Signals]:
    """Those that are not ignored: what an earlier stop has turned off stays off."""
    return [number for number in STOPS if signal.getsignal(number) is not signal.SIG_IGN]


def _tell(text: str) -> None:
    tell_past_the_buffer(text.encode(sys.stderr.encoding or "utf-8", "replace"))


def _leave_closed(terminals: list[int]) -> None:
    """Send to nowhere what would go to a terminal that is gone: its errors would come in the midst of the clean-up."""
    for stream in terminals:
        if not os.isatty(stream):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream)
            os.close(nowhere)
