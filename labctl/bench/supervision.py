"""A run under supervision: whatever kills it, another process makes the bench safe."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from itertools import chain
from typing import Any, BinaryIO, cast

from instruments.bench import Observer
from instruments.safe_state import MAY_EMIT, UnsafeBench
from labctl.apart import apart
from labctl.bench.recording.wire import Wire
from labctl.bench.simulation import with_laser_commands
from labctl.bench.station import Station
from labctl.bench.supervisor import READY, TRYING, Task, within_reach
from labctl.runs.live.logs import CommandLog

COMMAND = (sys.executable, "-P", "-m", "labctl.bench.supervisor")
"""`-P`: nothing is imported from the folder that the run is started in."""
START_S = 30.0
"""A supervisor that takes longer to start will not: no light is switched on."""
GONE = (
    "the supervisor or its copy has ended: the bench was made dark, since nothing would switch the light off if the "
    "other one and this process were killed too; finished shots are kept"
)
REFUSED = "no light is switched on, since nothing would switch it off if this process were killed: repeat the command"


@contextmanager
def supervised(
    station: Station, log: CommandLog, wire: Wire = Wire(), held: tuple[int, ...] = ()
) -> Iterator[Observer]:
    """One supervisor for the block; what is yielded must observe the bench that is opened inside it.

    The bench then gives no light before the supervisor is ready, and none if it has died. A block that switched light
    on and did not go the way into the safe state to its end leaves that to the supervisor. The bench's connections are
    closed by then.

    held: descriptors of the locks that keep others from the bench, which it holds as long as itself.

    A bench that is simulated in this process, or replayed, has none: it ends with the process.
    """
    if wire.replay is not None or not within_reach(station):
        yield Observer()
        return
    supervisor = _Supervisor(station, log, held)
    try:
        yield supervisor
    finally:
        supervisor.end()


class _Supervisor(Observer):
    """The process that supervises a bench, and what this process knows of the bench's light."""

    def __init__(self, station: Station, log: CommandLog, held: tuple[int, ...]) -> None:
        self._log = log
        self._lit = False
        try:
            self._process = subprocess.Popen(  # noqa: S603
                COMMAND, bufsize=0, stdin=subprocess.PIPE, stdout=subprocess.PIPE, **apart(held)
            )
        except OSError as error:
            raise UnsafeBench(f"the supervisor cannot be started ({error}): {REFUSED}") from None
        self._orders, self._replies = cast(BinaryIO, self._process.stdin), cast(BinaryIO, self._process.stdout)
        self._listening = ThreadPoolExecutor(1, thread_name_prefix="supervisor")
        self._ready, self._next = (self._listening.submit(self._replies.readline) for _ in range(2))
        task = Task(station=with_laser_commands(station), log_started=log.started, process=os.getpid())
        self._say_if_there(task.model_dump_json())

    def before_light(self) -> None:
        """Refuse light that nothing would switch off if this process were killed."""
        try:
            well = self._ready.result(START_S) == READY and not self._is_gone()
            if well and self._log.path is not None:
                self._say(json.dumps(str(self._log.path.absolute())))
        except OSError:  # a broken pipe, or too late
            well = False
        if not well:
            raise UnsafeBench(f"the supervisor has not started, or it or its copy has ended: {REFUSED}")

    def while_lit(self) -> None:
        """Whose supervisor is gone or alone ends, dark: soon nothing might be left to switch the light off."""
        if self._lit and self._is_gone():
            raise UnsafeBench(GONE)

    def progress(self, _done: int, _total: int, _last: Callable[[], Mapping[str, Any]] = dict) -> None:
        """As `while_lit`."""
        self.while_lit()

    def uploading(self, _what: str, _done: int, _total: int) -> None:
        """As `while_lit`: it may take minutes."""
        self.while_lit()

    def emission(self, *, on: bool) -> None:
        """Light that is on is to be seen to."""
        if on:
            self._lit = True
            self._say_if_there(json.dumps(self._lit))

    def safe_state(self, error: UnsafeBench | None) -> None:
        """Seen to, unless what emits did not obey."""
        self._lit = self._lit and error is not None and not error.disobeyed.isdisjoint(MAY_EMIT)
        self._say_if_there(json.dumps(self._lit))

    def end(self) -> None:
        """End the process; first let it make the bench safe if that was not seen to here.

        A laser that it cannot reach either it goes on trying to reach, and nobody waits for that.
        """
        if not self._lit:
            if not self._ready.done():  # nobody waits for it to start
                self._process.kill()
                self._process.wait()
            self._say_if_there(json.dumps(None))
        self._orders.close()
        if TRYING not in chain([self._next.result()], iter(self._replies.readline, b"")):
            self._process.wait()
        self._listening.shutdown()
        self._replies.close()

    def _is_gone(self) -> bool:
        """Or without its copy: then it has said something, since it was ready."""
        return self._process.poll() is not None or self._next.done()

    def _say_if_there(self, line: str) -> None:
        with suppress(OSError):  # it has ended: `before_light` and `progress` find that
            self._say(line)

    def _say(self, line: str) -> None:
        self._orders.write(f"{line}\n".encode())
