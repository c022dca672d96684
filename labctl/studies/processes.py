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
from typing import TypeVar

from labctl.bench.signals import Interruption

Name = TypeVar("Name")
Found = TypeVar("Found")

POLL_S = 0.2


class Interrupted(Exception):
    """The operator stopped it; what was finished is kept."""


class _Shared:
    """What the processes of one pool share."""

    stop: Event
    steps: "Synchronized[int]"


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
        interruption: Asked again and again; once requested, running tasks hear of it by `stop_requested`.
        progress: Called again and again with how many tasks are done and how many steps they have reported.
        needs: The tasks that must be done before a task begins.

    Raises:
        Interrupted: it was requested.
    """
    context = multiprocessing.get_context("spawn")
    workers = min(os.cpu_count() or 1, len(tasks))
    stop, steps = context.Event(), context.Value("q", 0)
    found: dict[Name, tuple[Found, float]] = {}
    running: dict[Future[tuple[Found, float]], Name] = {}
    with ProcessPoolExecutor(workers, context, initializer=_join, initargs=(stop, steps)) as pool:
        try:
            while len(found) < len(tasks):
                begun = found.keys() | set(running.values())
                ready = (name for name in tasks if name not in begun and found.keys() >= set(needs.get(name, ())))
                for name in islice(ready, workers - len(running)):
                    running[pool.submit(_timed, tasks[name])] = name
                for future in wait(running, timeout=POLL_S, return_when=FIRST_COMPLETED).done:
                    found[running.pop(future)] = future.result()
                progress(len(found), steps.value)
                if interruption.requested:
                    raise Interrupted
        finally:
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)
    return found


def stop_requested() -> bool:
    """Inside a task: whether it should come to its end."""
    return _Shared.stop.is_set()


def step_done() -> None:
    """Inside a task: report one step."""
    with _Shared.steps.get_lock():
        _Shared.steps.value += 1


def _join(stop: Event, steps: "Synchronized[int]") -> None:
    # Ctrl-C reaches the whole process group; these processes hear of it from their parent.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Shared.stop, _Shared.steps = stop, steps


def _timed(task: Callable[[], Found]) -> tuple[Found, float]:
    began = time.perf_counter()
    return task(), time.perf_counter() - began
