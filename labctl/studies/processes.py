"""Work in several processes at once, which ends early, and orderly, when somebody asks for it."""

import multiprocessing
import signal
import time
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event
from typing import Any, TypeVar

from instruments.bench import Observer
from labctl.bench.signals import Interruption

Name = TypeVar("Name")
Task = TypeVar("Task")
Found = TypeVar("Found")

POLL_S = 0.2


class Interrupted(Exception):
    """The operator stopped it; what was finished is kept."""


class _Shared:
    """What the processes of one pool share."""

    stop: Event
    steps: "Synchronized[int]"


def in_parallel(
    function: Callable[[Task], Found],
    tasks: Mapping[Name, Task],
    *,
    workers: int,
    interruption: Interruption,
    progress: Callable[[int, int], None],
) -> dict[Name, tuple[Found, float]]:
    """Result of `function` for every task, and the seconds it took; the first failure ends it all.

    Args:
        function: A function of a module, called in another process.
        tasks: What it is called with, by any name.
        workers: How many processes.
        interruption: Asked again and again; once requested, running tasks hear of it by `stop_requested`.
        progress: Called again and again with how many tasks are done and how many steps they have told of.

    Raises:
        Interrupted: it was requested.
    """
    context = multiprocessing.get_context("spawn")
    stop, steps = context.Event(), context.Value("q", 0)
    with ProcessPoolExecutor(min(workers, len(tasks)), context, initializer=_join, initargs=(stop, steps)) as pool:
        try:
            futures = {name: pool.submit(_timed, function, task) for name, task in tasks.items()}
            waiting = set(futures.values())
            while waiting:
                finished, waiting = wait(waiting, timeout=POLL_S, return_when=FIRST_COMPLETED)
                for future in finished:
                    future.result()
                progress(len(futures) - len(waiting), steps.value)
                if interruption.requested:
                    raise Interrupted
        finally:
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)
    return {name: future.result() for name, future in futures.items()}


def stop_requested() -> bool:
    """Inside a task: whether it should come to its end."""
    return _Shared.stop.is_set()


def step_done() -> None:
    """Inside a task: tell of one step."""
    with _Shared.steps.get_lock():
        _Shared.steps.value += 1


class TaskObserver(Observer):
    """Follows a run inside a task: counts its records, and ends it when the task should come to its end."""

    def __init__(self, interruption: Interruption) -> None:
        """Of the run that `interruption` ends."""
        self._interruption = interruption

    def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
        """One step more."""
        step_done()
        self._interruption.requested |= stop_requested()


def _join(stop: Event, steps: "Synchronized[int]") -> None:
    # Ctrl-C reaches the whole process group; these processes hear of it from their parent.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Shared.stop, _Shared.steps = stop, steps


def _timed(function: Callable[[Any], Any], task: Any) -> tuple[Any, float]:
    began = time.perf_counter()
    return function(task), time.perf_counter() - began
