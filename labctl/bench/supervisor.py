"""The supervisor: a small process that makes a bench safe when the process that works with it is gone.

It is started before any light and holds no connection. It hears of the end of its parent by the end of its standard
input, whose other end only the parent holds: whatever ends a process closes it. Only then are connections opened, so
that instruments that take one client are free. A parent that ends well ends its supervisor first; one that is stopped
with light on is killed. A laser that goes on emitting is tried again and again, and people are told again and again:
a cable that is plugged in later finds it lit. A copy of this process stands in for it if it is killed.

Standard input: a `Task` in JSON, one line; later, lines in JSON: the path of the run's log; true before light is
switched on, false when the bench is dark; null when nothing is left to do. Until then there may be light.
Standard output: `READY`, once everything that the safe state needs is loaded; `ALONE`, when something else has ended
its copy; `TRYING`, if the laser goes on emitting.
Standard error: what was done; let go of as soon as that was said once, unless it is a terminal.
"""

import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import closing, suppress
from functools import partial
from io import FileIO
from pathlib import Path
from typing import BinaryIO, NoReturn, cast

from pydantic import BaseModel

from instruments.driver import Opening
from instruments.errors import InstrumentError, LinkError
from instruments.interfaces import INTERFACES, Instrument
from instruments.safe_state import LIGHT, MAY_EMIT, ORDER, UnsafeBench, in_order, safe_state
from instruments.sections import SIMULATED
from labctl.bench.stand_in import Followed, alone, kill_when_stopped, with_a_copy
from labctl.bench.standard_error import STANDARD_ERROR, tell_past_the_buffer
from labctl.bench.station import Station
from labctl.printable import printable
from labctl.runs.live.control_file import Word, word_in
from labctl.runs.live.logs import CommandLog, EventLog

READY, ALONE, TRYING = b"ready\n", b"alone\n", b"trying\n"
AGAIN_S, ATTEMPTS = 1.0, 600
"""How long to wait before a laser that goes on emitting is tried again, and how often."""
TELL_EVERY = 10
"""After so many attempts people are told again."""
AT_ONCE_S = (0.02, 0.05, 0.1)
"""The waits before an instrument that answers, but did not obey, is told again."""
UNSAFE = "ended without making the bench safe"
STOPPED = f"{UNSAFE} (it was stopped with light on, so the supervisor killed it)"
AT_LAST = "the supervisor did at last"
SEEN = "somebody has seen that the laser is dark"
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
STANDARD_INPUT, STANDARD_OUTPUT = 0, 1


class Task(BaseModel):
    """What a supervisor is for: a bench, as its station says, and when the run's log began by its clock.

    `process` is the parent; without it nobody looks whether it is stopped.
    """

    station: Station
    log_started: float
    process: int | None = None


def within_reach(station: Station) -> tuple[str, ...]:
    """The instruments that another process can make safe: those at an address, in the order of the safe state.

    A bench simulated in this process ends with it; what is set by hand, only a person can switch off.
    """
    by_hand = station.by_hand
    return tuple(
        name
        for name, address in in_order(station.addresses).items()
        if (name in ORDER or name not in INTERFACES) and address != SIMULATED and name not in by_hand
    )


class _Parent:
    """What the process that is supervised has said of itself."""

    def __init__(self) -> None:
        """It is there and may have light."""
        self.log: Path | None = None
        self.has_light = True
        self.saw_to_it = False

    def hear(self, lines: Iterable[bytes]) -> None:
        """Return when it has ended."""
        for line in lines:
            with suppress(ValueError):  # the rest of a line that the process this one stands in for began to read
                match json.loads(line):
                    case None:
                        self.saw_to_it = True
                    case bool(has_light):
                        self.has_light = has_light
                    case str(log):
                        self.log = Path(log)
        self.has_light = False


def supervise(
    orders: BinaryIO,
    say: Callable[[bytes], None],
    pause: Callable[[float], None] = time.sleep,
    follow: Callable[[BinaryIO], Followed] = alone,
) -> None:
    """Wait for the end of the parent, make the bench safe, and report it in the run's log and on standard error."""
    first = orders.readline()
    if not first.endswith(b"\n"):
        return  # the parent ended before there was anything to do
    task = Task.model_validate_json(first)
    log = CommandLog(started=task.log_started)
    instruments = {name: _at_hand(task.station, name, log) for name in within_reach(task.station)}
    followed = follow(orders)
    if followed.acts.is_set():
        say(READY)
    parent, stopped = _Parent(), threading.Event()
    if task.process is not None:
        stopped = kill_when_stopped(task.process, lambda: parent.has_light and followed.acts.is_set())
    parent.hear(followed.lines)
    if parent.saw_to_it:
        followed.dismiss()
    else:
        end = STOPPED if stopped.is_set() else UNSAFE
        _see_to_it(task.station, instruments, log, parent.log, end, say, pause, followed.dismiss)


def _at_hand(station: Station, name: str, log: CommandLog) -> Callable[[], Instrument]:
    """What gives an instrument when it is needed. Whatever files its driver needs are read now: later they may be gone.

    Raises:
        InstrumentError: it gives light, and cannot be had. Any other one may be had by then, and is not needed as much.
    """
    try:
        instrument = _instrument(station, name, log)
    except InstrumentError:
        if name in LIGHT:
            raise
        return partial(_instrument, station, name, log)
    return lambda: instrument


def _instrument(station: Station, name: str, log: CommandLog) -> Instrument:
    """One that is not spoken to yet."""
    section = station.section_of(name)
    return station.driver_of(name).open(section, Opening(section.address, log, _nobody, attended=True))


def main() -> None:
    """Supervise the process that started this one."""
    for name in SIGNALS:  # what ends the parent must not end this process as well
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)

    def say(word: bytes) -> None:
        if word == TRYING:
            _let_go()
        with suppress(OSError):  # the parent is gone already; Windows has no error of its own for that
            os.write(STANDARD_OUTPUT, word)

    def follow(orders: BinaryIO) -> Followed:
        followed = with_a_copy(orders, lambda: say(ALONE))
        if not followed.acts.is_set():
            _let_go()
        return followed

    with FileIO(STANDARD_INPUT, closefd=False) as orders:
        supervise(cast(BinaryIO, orders), say, follow=follow)
    os._exit(0)  # the parent waits, and the interpreter would take a while to tidy up


def _let_go() -> None:
    """Whoever captures what a run prints must not wait for this process; a terminal does not wait."""
    if not os.isatty(STANDARD_ERROR):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, STANDARD_ERROR)
        os.close(nowhere)


def _see_to_it(
    station: Station,
    instruments: dict[str, Callable[[], Instrument]],
    log: CommandLog,
    path: Path | None,
    end: str,
    say: Callable[[bytes], None],
    pause: Callable[[float], None],
    dismiss: Callable[[], None],
) -> None:
    """Make the bench safe, and tell; how the parent came to its `end`, and its log, which `log` goes on, is at `path`.

    Whoever kills this process when it has done what can be done, `dismiss` says, is not to meet another one.
    """
    began = time.monotonic()
    by_hand = "laser" in station.by_hand

    def report(what: str, disobeyed: Iterable[str] = (), *, reached: bool = False) -> None:
        log.warning(f"{what} ({time.monotonic() - began:.2f} s)")
        text = f"the run {what}"
        events.event("safe state", reached=reached, disobeyed=sorted(disobeyed), by="supervisor", text=text)
        _tell(text, alarming=by_hand or not MAY_EMIT.keys().isdisjoint(disobeyed))

    with log, EventLog() as events:
        unsafe = _make_safe(instruments)
        left = unsafe.disobeyed if unsafe is not None else frozenset()
        outcome = _done(instruments, by_hand=by_hand) if unsafe is None else f", and the supervisor could not: {unsafe}"
        lit = {name: found for name, found in instruments.items() if name in MAY_EMIT and name in left}
        may_emit = "; ".join(MAY_EMIT[name] for name in lit)
        outcome += "".join(f"; the {name} is tried again for {AGAIN_S * ATTEMPTS / 60:.0f} min" for name in lit)
        report(end + outcome, left, reached=not (left or by_hand))
        if path is not None:
            events.stored_in(path.parent)
            with suppress(OSError):
                log.keep_in(path)
        dismiss()
        if lit:
            say(TRYING)
            for attempt in range(1, ATTEMPTS + 1):
                pause(AGAIN_S)
                if _make_safe(lit) is None:
                    done = ", ".join(ORDER[name] for name in lit)
                    report(f"{end}, {AT_LAST}: {done}", left - lit.keys(), reached=left == lit.keys())
                    return
                if path is not None and word_in(path.parent) is Word.DARK:
                    log.warning(SEEN)
                    return
                if attempt % TELL_EVERY == 0:
                    report(f"{end}: {may_emit}; tried again {attempt} times", left)
            report(f"{end}: {may_emit.replace('may still emit', 'could not be reached')}", left)


def _make_safe(instruments: dict[str, Callable[[], Instrument]]) -> UnsafeBench | None:
    """Take every instrument into the safe state, over a link of its own; what went wrong, if anything did."""

    def step(instrument: Callable[[], Instrument]) -> Callable[[], None]:
        def make_safe() -> None:
            with closing(instrument()) as found:
                _patiently(found.make_safe)

        return make_safe

    try:
        safe_state({name: step(instrument) for name, instrument in instruments.items()})
    except UnsafeBench as error:
        return error
    return None


def _patiently(make_safe: Callable[[], None]) -> None:
    """What the parent had sent last may come to an instrument after what makes it safe: then once more."""
    for pause_s in AT_ONCE_S:
        try:
            make_safe()
        except LinkError:
            raise
        except InstrumentError:
            time.sleep(pause_s)
        else:
            return
    make_safe()


def _done(instruments: Iterable[str], *, by_hand: bool) -> str:
    reached = ", ".join(ORDER.get(name, f"{name} made safe") for name in instruments)
    laser = "; the laser is set by hand: switch it off by its key switch" if by_hand else ""
    return f", the supervisor did: {reached}{laser}"


def _tell(text: str, *, alarming: bool) -> None:
    """One line on standard error; in red, and audible, where that is a terminal and a laser may emit."""
    line = printable(f"labctl: {text}")
    if alarming and os.isatty(STANDARD_ERROR):
        line = f"\a\x1b[1;31m{line}\x1b[0m"
    tell_past_the_buffer(f"{line}\n".encode())


def _nobody(request: str) -> NoReturn:
    raise InstrumentError(f"nobody is asked {request!r} here")


if __name__ == "__main__":
    main()
