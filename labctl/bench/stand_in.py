"""Who stands in for the supervisor: a copy of it, so that to kill it together with the run is not enough.

The copy is forked when everything is loaded, lives in a session of its own, and hears of the end of the supervisor as
that hears of the end of the run: by the end of a pipe. It then reads on where the supervisor has ended.

A process that is stopped (SIGSTOP) holds its pipe and does nothing. Whoever waits for its end kills it. Linux tells who
is stopped; elsewhere nobody looks. Windows has no fork, and so no copy.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

LOOK_EVERY_S = 0.1
LOOKS = 2
"""So often in a row a process is seen to be stopped that is not just passing through."""


class Followed(NamedTuple):
    """The lines that are still to come; whether it is for this process to act; what ends the copy when all is done."""

    lines: Iterator[bytes]
    acts: threading.Event
    dismiss: Callable[[], None]


def alone(orders: BinaryIO) -> Followed:
    """Nobody stands in."""
    return Followed(iter(orders), _now(), dismiss=lambda: None)


def with_a_copy(orders: BinaryIO, left_alone: Callable[[], None]) -> Followed:
    """Fork the copy; this returns in both processes. Each has all lines: those of the copy go on when the other ended.

    `orders` must not be buffered: the copy would have twice what waits there. The supervisor goes on without its copy,
    since it may be all that is left; `left_alone` is called in it when the copy has ended undismissed, so that the run
    goes dark.
    """
    if sys.platform == "win32":
        return alone(orders)
    heard, told = os.pipe()
    supervisor = os.getpid()
    copy = os.fork()
    if copy:
        os.close(heard)
        return Followed(_passed_on(orders, told), _now(), _dismissing(copy, left_alone))
    os.close(told)
    os.setsid()
    kill_when_stopped(supervisor, lambda: True)
    acts = threading.Event()
    return Followed(_after_the_supervisor(FileIO(heard), orders, acts), acts, dismiss=lambda: None)


def kill_when_stopped(process: int, when: Callable[[], bool]) -> threading.Event:
    """From now on kill `process`, and look no further, once it is stopped and `when` says so; what is set then."""
    killed = threading.Event()

    def look() -> None:
        seen = 0
        while (seen := seen + 1 if _is_stopped(process) and when() else 0) < LOOKS:
            time.sleep(LOOK_EVERY_S)
        killed.set()
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)

    if sys.platform == "linux":
        threading.Thread(target=look, daemon=True).start()
    return killed


def _is_stopped(process: int) -> bool:
    try:
        state = Path("/proc", str(process), "stat").read_bytes().rpartition(b")")[2].split()[0]
    except OSError:  # it has ended
        return False
    return state == b"T"


def _dismissing(copy: int, left_alone: Callable[[], None]) -> Callable[[], None]:
    """What ends the copy; `left_alone` is called when anything else has ended it."""
    ended, dismissed = threading.Event(), threading.Event()

    def hear_its_end() -> None:
        os.waitpid(copy, 0)
        ended.set()
        if not dismissed.is_set():
            left_alone()

    def dismiss() -> None:
        dismissed.set()
        if not ended.is_set():  # another process may have its number by then
            with suppress(ProcessLookupError):
                os.kill(copy, signal.SIGKILL)

    threading.Thread(target=hear_its_end, daemon=True).start()
    return dismiss


def _passed_on(orders: BinaryIO, told: int) -> Iterator[bytes]:
    for line in orders:
        with suppress(BrokenPipeError):  # the copy has ended
            os.write(told, line)
        yield line


def _after_the_supervisor(supervisor: FileIO, orders: BinaryIO, acts: threading.Event) -> Iterator[bytes]:
    with supervisor:
        yield from supervisor
    acts.set()
    yield from orders


def _now() -> threading.Event:
    acts = threading.Event()
    acts.set()
    return acts
