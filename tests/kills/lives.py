"""One life of a run: a process that acquires it, or goes on with it, and tells each shot that it reports as done.

Processes are forked from one that has imported everything and measured once, so that a life takes a second. What a life
tells goes into a file, a line each, and lies in the kernel before the next step: killing the process takes none of it.
"""

import json
import os
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any

from labctl.bench.station import DurabilitySection, SimSection, Station, WiringSection
from labctl.engine.session import Acquisition, Resumption, acquire, resume
from labctl.runs.format.layout import RunPaths
from labctl.runs.write import writer
from protocols import bursts
from protocols.image_readout import ImageReadout
from tests.observers import Follower

BURST = 24
"""Pictures of a burst, instead of thousands: a short run then has several of them."""
WRITE, WRITTEN = "write", "written"


@dataclass(frozen=True)
class Kind:
    """What is acquired, and how much of it may be lost."""

    name: str
    protocol: ImageReadout
    durability: DurabilitySection

    @property
    def station(self) -> Station:
        """The simulated bench, wired for bursts; what was measured before a kill changes no frame."""
        return Station(wiring=WiringSection(burst=True), durability=self.durability, sim=SimSection(noise="by-state"))


def kinds(images: int) -> tuple[Kind, ...]:
    """A software-timed run, whose shards close by shots or, another time, by age; after each of them one in bursts."""
    software = ImageReadout(images=images, window=0.8e-9)
    burst = Kind("burst", software.model_copy(update={"timing": "burst"}), DurabilitySection())
    return (
        Kind("software-timed", software, DurabilitySection()),
        burst,
        Kind("software-timed, shards closed by age", software, DurabilitySection(shots=10_000, seconds=0.2)),
        burst,
    )


@dataclass(frozen=True)
class Told:
    """What a life told, by the monotonic clock (s).

    done: when it reported which number of records of the run as done. writes: when the write of a shard began, and
    when it had ended, infinite where it had not.
    """

    done: tuple[tuple[float, int], ...]
    writes: tuple[tuple[float, float], ...]

    @classmethod
    def read(cls, path: Path) -> "Told":
        """What is in the file `path`."""
        done, begun, ended = [], [], []
        for line in path.read_bytes().splitlines():
            moment, what = json.loads(line)
            if what == WRITE:
                begun.append(moment)
            elif what == WRITTEN:
                ended.append(moment)
            else:
                done.append((moment, what))
        missing = len(begun) - len(ended)
        return cls(tuple(done), tuple(zip(begun, ended + [float("inf")] * missing, strict=True)))


@dataclass(frozen=True)
class Life:
    """How a life went: when it began and ended (s), whether it was killed, and what it told."""

    began: float
    ended: float
    killed: bool
    told: Told


class LifeFailed(Exception):
    """A life ended by itself before its run was complete."""


def live(kind: Kind, directory: Path, told: Path, kill_after_s: float | None) -> Life:
    """Acquire the run in `directory`, or go on with it, in a process that is killed after a while unless it has ended.

    Raises:
        LifeFailed: the process ended with an error; says which.
    """
    told.unlink(missing_ok=True)
    told.touch()
    began = time.monotonic()
    process = os.fork()
    if not process:
        os._exit(_in_the_process(kind, directory, told))
    descriptor = os.pidfd_open(process)
    try:
        ended_first, *_ = select.select([descriptor], [], [], kill_after_s)
        ended = time.monotonic()
        if not ended_first:
            signal.pidfd_send_signal(descriptor, signal.SIGKILL)
        _, status = os.waitpid(process, 0)
    finally:
        os.close(descriptor)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status):
        raise LifeFailed(f"{kind.name}, {directory}: a process that was not killed failed, see above")
    return Life(began, ended, os.WIFSIGNALED(status), Told.read(told))


def _in_the_process(kind: Kind, directory: Path, path: Path) -> int:
    told = os.open(path, os.O_WRONLY | os.O_APPEND)

    def tell(what: object) -> None:
        os.write(told, f"{json.dumps([time.monotonic(), what])}\n".encode())

    def told_of(write: Callable[..., None]) -> Callable[..., None]:
        @wraps(write)
        def writes(*arguments: Any) -> None:
            tell(WRITE)
            write(*arguments)
            tell(WRITTEN)

        return writes

    bursts.LONGEST_BURST = BURST
    writer.replace_file = told_of(writer.replace_file)  # type: ignore[attr-defined]
    try:
        if RunPaths(directory).manifest.exists():
            resume(Resumption(directory), observer=Follower(lambda done, _total: tell(done)))
        else:
            acquire(
                Acquisition(kind.protocol, kind.station, directory), observer=Follower(lambda done, _total: tell(done))
            )
    except BaseException:  # noqa: BLE001 - this process has nobody else to tell
        traceback.print_exc(file=sys.stderr)
        sys.stderr.flush()
        return 1
    return 0
