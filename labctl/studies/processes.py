"""Work in several processes at once, which ends early, and orderly, when it is interrupted."""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from itertools import islice
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event
from types import MappingProxyType
from typing import Any, TypeVar

from instruments.bench import Observer
from labctl.bench.signals import Interruption
from labctl.printable import log_printably

Name = TypeVar("Name")
Found = TypeVar("Found")

POLL_S = 0.2


class Interrupted(Exception):
    """The operator stopped it; what was finished is kept."""


class _Shared:
    """What the processes of one pool share."""

    stop: Event
    records: "Synchronized[int]"


def in_parallel(
    tasks: Mapping[Name, Callable[[], Found]],
    *,
    interruption: Interruption,
    progress: Callable[[int, int], None],
    needs: Mapping[Name, Iterable[Name]] = MappingProxyType({}),
) -> dict[Name, tuple[Found, float]]:
    """Result of every task, and the seconds it took, on as many processes as there are cores; a failure ends it all.

    Args:
        tasks: Functions of a module, or partials of them, called in other processes; the first ones go first.
        interruption: Asked again and again; once requested, running tasks end, if a `TaskObserver` follows them.
        progress: Called again and again with how many tasks are done and how many records were made in them.
        needs: The tasks that must be done before a task begins.

    Raises:
        Interrupted: it was requested.
    """
    context = multiprocessing.get_context("spawn")
    workers = min(os.cpu_count() or 1, len(tasks))
    stop, records = context.Event(), context.Value("q", 0)
    found: dict[Name, tuple[Found, float]] = {}
    running: dict[Future[tuple[Found, float]], Name] = {}
    with ProcessPoolExecutor(workers, context, initializer=_join, initargs=(stop, records)) as pool:
        try:
            while len(found) < len(tasks):
                begun = found.keys() | set(running.values())
                ready = (name for name in tasks if name not in begun and found.keys() >= set(needs.get(name, ())))
                for name in islice(ready, workers - len(running)):
                    running[pool.submit(_timed, tasks[name])] = name
                for future in wait(running, timeout=POLL_S, return_when=FIRST_COMPLETED).done:
                    found[running.pop(future)] = future.result()
                progress(len(found), records.value)
                if interruption.requested:
                    raise Interrupted
        finally:
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)
    return found


class TaskObserver(Observer):
    """Follows a run inside a task: counts its records, and ends it when the task should come to its end."""

    def __init__(self, interruption: Interruption) -> None:
        """Of the run that `interruption` ends."""
        self._interruption = interruption
        self._done = 0

    def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
        """More records: one, or those of a burst."""
        with _Shared.records.get_lock():
            _Shared.records.value += done - self._done
        self._done = done
        self._interruption.requested |= _Shared.stop.is_set()


def _join(stop: Event, records: "Synchronized[int]") -> None:
    # Ctrl-C reaches the whole process group; these processes hear of it from their parent.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Shared.stop, _Shared.records = stop, records
    log_printably()


def _timed(task: Callable[[], Found]) -> tuple[Found, float]:
    began = time.perf_counter()
    return task(), time.perf_counter() - began
