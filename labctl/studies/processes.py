"""Processes of this machine that carry out tasks: as many as there are cores."""

import gc
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import forkserver, resource_tracker
from multiprocessing.context import BaseContext
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event
from pathlib import Path
from threading import Thread
from typing import TypeVar

from labctl.bench.signals import Interruption
from labctl.bench.simulation import SIMULATION
from labctl.errors import WorkerKilled
from labctl.printable import log_printably
from labctl.studies.tasks import CALLER, Workers, in_parallel, one_by_one, timed

Name = TypeVar("Name")
Found = TypeVar("Found")

OWN = ("labctl", "protocols", "instruments", "sim_backends")
"""Our packages; what they need comes with them."""
FIRST, LATE = "labctl.studies.template_process", (SIMULATION, "pint")
"""What is loaded before all else, and what tasks load when they need it, and most do."""

MOST = 61 if sys.platform == "win32" else sys.maxsize
"""Windows waits for no more at once, and `ProcessPoolExecutor` refuses them."""


@dataclass(frozen=True)
class _Shared:
    """What the processes of one pool share."""

    stop: Event
    made: "Synchronized[int]"
    scratch: Path | None

    def stopped(self) -> bool:
        """Whether running tasks should end."""
        return self.stop.is_set()

    def measured(self, records: int) -> None:
        """So many records more, made in this process."""
        with self.made.get_lock():
            self.made.value += records


@dataclass(frozen=True)
class _Pool:
    executor: ProcessPoolExecutor
    size: int
    shared: _Shared

    @property
    def records(self) -> int:
        """How many records were made."""
        return self.shared.made.value

    def room(self, running: int) -> int:
        """A task for each process."""
        return self.size - running

    def submit(self, task: Callable[[], Found]) -> Future[tuple[Found, float]]:
        """Begin a task.

        Raises:
            WorkerKilled: one of the processes was killed, and with it went all.
        """
        try:
            return self.executor.submit(timed, task)
        except BrokenProcessPool as error:
            raise self.failure(error) from error

    def failure(self, error: Exception) -> Exception:
        """The error itself, or that a process was killed."""
        if not isinstance(error, BrokenProcessPool):
            return error
        return WorkerKilled(
            "a process that carried out a task was killed, perhaps because memory was short: finished runs stay where "
            "they are; end other programs, and begin again"
        )


@contextmanager
def processes(tasks: int, scratch: Path | None = None) -> Iterator[Workers]:
    """Processes for so many tasks.

    scratch: where they measure a run until it is whole, if others may be at the same one; None: where it will be, so
    that it can be watched.
    """
    context = _context()
    size = min(os.cpu_count() or 1, tasks, MOST)
    shared = _Shared(context.Event(), context.Value("q", 0), scratch)
    with (
        ProcessPoolExecutor(size, context, initializer=_join, initargs=(shared, dict(os.environ))) as executor,
        _stopped_at_once(),  # while running tasks come to their end
    ):
        try:
            # Begun before the first task: the executor notices the end only of processes that it knew when it last
            # looked, and it looks again whenever something is done.
            for _ in range(size):
                executor.submit(int)
            with _stopped_at_once():
                yield _Pool(executor, size, shared)
        finally:
            shared.stop.set()
            executor.shutdown(wait=True, cancel_futures=True)


def side_by_side(tasks: Mapping[Name, Callable[[], Found]]) -> dict[Name, Found]:
    """Result of every task; one alone is carried out in this process."""
    if len(tasks) < 2:
        return one_by_one(tasks)
    found = in_parallel(tasks, engine=processes, interruption=Interruption(), progress=lambda *_: None)
    return {name: result for name, (result, _) in found.items()}


def load_meanwhile(*modules: str) -> None:
    """Load what processes will need in the one that they will be copies of, while this process goes on.

    To load scikit-learn takes seconds. Where to copy a process is not safe there is no such one, and each loads it.
    """
    if sys.platform == "linux":
        multiprocessing.get_context("forkserver").set_forkserver_preload([FIRST, *modules, *LATE])
        resource_tracker.ensure_running()  # the next line would, and unblock the signal
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # until it ignores Ctrl-C
        try:
            forkserver.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _context() -> BaseContext:
    if sys.platform != "linux":
        return multiprocessing.get_context("spawn")
    load_meanwhile(*(name for name in tuple(sys.modules) if name.partition(".")[0] in OWN))
    return multiprocessing.get_context("forkserver")


@contextmanager
def _stopped_at_once() -> Iterator[None]:
    """Whatever stops the block at once ends the processes too; one with light on makes its bench dark first."""
    try:
        yield
    except KeyboardInterrupt:
        for process in multiprocessing.active_children():
            process.terminate()
        raise


def _join(shared: _Shared, environment: Mapping[str, str]) -> None:
    gc.enable()  # which it is not in the process that is copied
    os.environ.clear()  # of when that one began
    os.environ.update(environment)
    # Ctrl-C reaches the whole process group; these processes hear of it from their parent.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    CALLER.set(shared)
    log_printably()
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Stop this process when the one that it works for has ended, however that was."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
