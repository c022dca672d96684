"""The supervisor: a small process that makes a bench safe when the process that works with it is gone.

It is started before any light and holds no connection. It hears of the end of its parent by the end of its standard
input, whose other end only the parent holds: whatever ends a process closes it, and no polling is needed. Only then
are connections opened, so that instruments that take one client are free. A parent that ends well ends its supervisor
first. A laser that cannot be reached is tried again and again: a cable that is plugged in later finds it lit.

Standard input: a `Task` in JSON, one line; later, a line with the path of the run's log in JSON.
Standard output: `READY`, once everything that the safe state needs is loaded; `TRYING`, if the laser is out of reach.
"""

import json
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from pydantic import BaseModel

from instruments.driver import Driver, Opening
from instruments.errors import InstrumentError
from instruments.safe_state import UnsafeBench, safe_state
from instruments.sections import SIMULATED
from labctl.bench.station import Station
from labctl.runs.live.logs import CommandLog, EventLog

READY, TRYING = b"ready\n", b"trying\n"
AGAIN_S, ATTEMPTS = 1.0, 600
"""How long to wait before a laser that could not be reached is tried again, and how often."""
ORDER = {"laser": "laser off", "awg": "AWG output off", "dmd": "DMD blank", "scope": "oscilloscope stopped"}
"""The safe state in its order: what is reached with each instrument."""
UNSAFE = "ended without making the bench safe"
AT_LAST = f"{UNSAFE}, the supervisor did at last: {ORDER['laser']}"
NEVER = f"{UNSAFE}: the laser could not be reached, switch it off by its key switch"
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
STANDARD_OUTPUT, STANDARD_ERROR = 1, 2


class Task(BaseModel):
    """What a supervisor is for: a bench, as its station says, and when the run's log began by the monotonic clock."""

    station: Station
    log_started: float


def within_reach(station: Station) -> tuple[str, ...]:
    """The instruments that another process can make safe: those at an address, in the order of the safe state.

    A bench simulated in this process ends with it; what is set by hand, only a person can switch off.
    """
    by_hand = station.by_hand
    return tuple(name for name in ORDER if station.addresses[name] != SIMULATED and name not in by_hand)


def supervise(orders: BinaryIO, say: Callable[[bytes], None], pause: Callable[[float], None] = time.sleep) -> None:
    """Wait for the end of the parent, make the bench safe, and report it in the run's log and on standard error."""
    first = orders.readline()
    if not first.endswith(b"\n"):
        return  # the parent ended before there was anything to do
    task = Task.model_validate_json(first)
    names = within_reach(task.station)
    drivers = {name: task.station.driver_of(name) for name in names}
    say(READY)
    path = None
    for order in orders:
        path = Path(json.loads(order))
    log = CommandLog(started=task.log_started)
    began = time.monotonic()

    def report(what: str, *, safe: bool) -> None:
        log("run", "!", f"{what} ({time.monotonic() - began:.2f} s)")
        events.event("safe state", reached=safe, by="supervisor", text=f"the run {what}")
        with suppress(OSError):
            os.write(STANDARD_ERROR, f"labctl: the run {what}\n".encode())

    with log, EventLog() as events:
        unsafe = _make_safe(task, drivers, log)
        by_hand = "laser" in task.station.by_hand
        report(_outcome(drivers, unsafe, by_hand=by_hand), safe=unsafe is None and not by_hand)
        if path is not None:
            events.stored_in(path.parent)
            with suppress(OSError):
                log.keep_in(path)
        if unsafe is not None and "laser" in unsafe.disobeyed:
            say(TRYING)
            dark = _darkened_later(task, drivers["laser"], log, pause)
            report(AT_LAST if dark else NEVER, safe=dark and unsafe.disobeyed == {"laser"})


def main() -> None:
    """Supervise the process that started this one."""
    for name in SIGNALS:  # what ends the parent must not end this process as well
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)

    def say(word: bytes) -> None:
        with suppress(BrokenPipeError):  # the parent is gone already
            os.write(STANDARD_OUTPUT, word)

    supervise(sys.stdin.buffer, say)


def _make_safe(task: Task, drivers: dict[str, Driver[Any]], log: CommandLog) -> UnsafeBench | None:
    """Take every instrument that has a driver into the safe state; what went wrong, if anything did."""

    def step(name: str) -> Callable[[], None]:
        def make_safe() -> None:
            section = getattr(task.station, name)
            with closing(
                drivers[name].open(section, Opening(section.address, log, _nobody, attended=True))
            ) as instrument:
                instrument.make_safe()

        return make_safe

    try:
        safe_state({name: step(name) for name in drivers})
    except UnsafeBench as error:
        return error
    return None


def _outcome(drivers: dict[str, Driver[Any]], unsafe: UnsafeBench | None, *, by_hand: bool) -> str:
    if unsafe is not None:
        outcome = f"{UNSAFE}, and the supervisor could not: {unsafe}"
        again = f"; the laser is tried again for {AGAIN_S * ATTEMPTS / 60:.0f} min"
        return outcome + again if "laser" in unsafe.disobeyed else outcome
    reached = ", ".join(ORDER[name] for name in drivers)
    laser = "; the laser is set by hand: switch it off by its key switch" if by_hand else ""
    return f"{UNSAFE}, the supervisor did: {reached}{laser}"


def _darkened_later(task: Task, driver: Driver[Any], log: CommandLog, pause: Callable[[float], None]) -> bool:
    """Try to reach the laser until it is dark, or for long enough; whether it is."""
    for _ in range(ATTEMPTS):
        pause(AGAIN_S)
        if _make_safe(task, {"laser": driver}, log) is None:
            return True
    return False


def _nobody(request: str) -> NoReturn:
    raise InstrumentError(f"nobody is asked {request!r} here")


if __name__ == "__main__":
    main()
