"""What the pages show of learning, computed in a process of its own that gives way to everything else.

It takes nothing from the acquisition, and is there only while somebody looks.
"""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from labctl.dashboard.accuracy import GROWTH, LEAST, Curve, curve
from labctl.dashboard.following import BLOCK, Following, follow
from labctl.dashboard.sweep_accuracy import Recognition, recognised
from labctl.runs.format.layout import RunPaths
from labctl.runs.index import Stamp, stamp

NICENESS = 19
RESTS = 19
AT_ONCE_S = 0.2
"""Processor time after which no further step is taken before others had their turn."""

Step = Callable[[Path, Any], tuple[Any, bool]]
"""From the directory of a run and what is known of it: what is known then, and whether others follow."""
Subject = tuple[Path, Stamp | None, Step]
"""A run, which is known by the stamp of its plan too, and a step."""


class Learning:
    """Takes steps for one subject at a time, in a process that is started with the first of them.

    One that somebody kills is followed by another, which is asked the same. While a run is growing it rests for
    `RESTS` times the processor time that the last ones took. Whoever had the last ones lets the others ask first.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start nothing yet."""
        self._clock = clock
        self._process: BaseProcess | None = None
        self._caller = ThreadPoolExecutor(1)
        self._known: dict[Subject, Any] = {}
        self._computed: dict[Subject, int] = {}
        self._pending: tuple[Subject, int, Future[tuple[Any, bool, float]]] | None = None
        self._served: Subject | None = None
        self._rested = clock()

    def curve(self, directory: Path, records: int, *, growing: bool) -> Curve:
        """What is known of a run of so many records; if that is old, something newer comes later.

        Of a run that is `growing` it is old when there may be another point.
        """
        what = _subject(directory, curve)
        due = max(LEAST, GROWTH * self._collected(what))
        found: Curve = self._latest(what, Curve(), records, records >= due, growing=growing)
        return found

    def following(self, directory: Path, records: int, *, growing: bool) -> Following:
        """The same of the readout that follows a run of so many records."""
        what = _subject(directory, follow)
        old = records >= self._collected(what) + BLOCK
        found: Following = self._latest(what, Following(), records, old, growing=growing)
        return found

    def recognition(self, directory: Path, shots: int, *, growing: bool) -> Recognition | None:
        """How well a run that has so many shots is recognised as a whole; None while that is not known.

        `growing`: the bench measures meanwhile, though not this run.
        """
        what = _subject(directory, recognised)
        old = shots != self._collected(what)
        found: Recognition | None = self._latest(what, None, shots, old, growing=growing)
        return found

    def close(self) -> None:
        """End the process, whatever it computes."""
        if self._process is not None:
            self._process.kill()

    def _latest(self, what: Subject, nothing: object, size: int, another_point: bool, *, growing: bool) -> Any:
        """What is known; something newer is begun where it is old and nothing else is computed."""
        known = self._known.get(what, nothing)
        rested = self._clock() >= self._rested
        old = rested and another_point if growing else size != self._computed.get(what, 0)
        if old and self._pending is None:
            directory, _, step = what
            if self._served == what:
                self._served = None
            else:
                self._served = what
                self._pending = what, size, self._caller.submit(_asked, self._link(), (step, directory, known))
        return known

    def _collected(self, what: Subject) -> int:
        """Take what was computed; of what size the run was when its last step was taken."""
        if self._pending is not None and self._pending[2].done():
            done, size, result = self._pending
            self._pending = None
            with suppress(EOFError, OSError):  # of a process that was killed: another one is asked again
                self._known[done], follows, seconds = result.result()
                if not follows:
                    self._computed[done] = size
                self._rested = self._clock() + RESTS * seconds
        return self._computed.get(what, 0)

    def _link(self) -> Connection:
        """To the process, which is there."""
        if self._process is None or not self._process.is_alive():
            context = multiprocessing.get_context("spawn")
            self._ours, theirs = context.Pipe()
            self._process = context.Process(target=_answer, args=(theirs,), daemon=True)
            self._process.start()
            theirs.close()  # so that nobody has it any more when the process has died
        return self._ours


def _subject(directory: Path, step: Step) -> Subject:
    return directory, stamp(RunPaths(directory).plan), step


def _asked(link: Connection, what: tuple[Step, Path, Any]) -> tuple[Any, bool, float]:
    """What the process at the other end finds.

    Raises:
        EOFError, OSError: It was killed.
    """
    link.send(what)
    found: tuple[Any, bool, float] = link.recv()
    return found


def _answer(link: Connection) -> None:
    """Take the steps that are asked for, as long as somebody may ask."""
    _give_way()
    with suppress(EOFError, ConnectionError):
        while True:
            link.send(_timed(*link.recv()))


def _give_way() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole process group; the dashboard ends this one
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    import labctl.analysis.evaluation  # what the steps are made of, so that the first one does not count for it
    import labctl.analysis.prequential
    import labctl.runs.read.records  # noqa: F401


def _timed(step: Step, directory: Path, known: Any) -> tuple[Any, bool, float]:
    """What some steps find, whether another one follows, and the processor time they took, s."""
    began, follows, took_s = time.process_time(), True, 0.0
    while follows and took_s < AT_ONCE_S:
        known, follows = step(directory, known)
        took_s = time.process_time() - began
    return known, follows, took_s
