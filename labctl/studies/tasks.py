"""Independent tasks, carried out side by side by whoever takes them: processes of this machine, or a cluster."""

import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import AbstractContextManager
from contextvars import ContextVar
from itertools import chain, islice
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

from labctl.bench.signals import Interruption
from labctl.errors import LabctlError, notes

Name = TypeVar("Name")
Found = TypeVar("Found")

POLL_S = 0.2


class Interrupted(Exception):
    """The operator stopped it; what was finished is kept."""


class Workers(Protocol):
    """Who carries out tasks. What is submitted may be carried out twice, if a worker dies with it."""

    @property
    def records(self) -> int:
        """How many records were made in all tasks so far."""

    def room(self, running: int) -> int:
        """How many more tasks may begin while so many are running."""

    def submit(self, task: Callable[[], Found]) -> Future[tuple[Found, float]]:
        """Begin a task: its result, and the seconds it took. Cancelled: nobody has it any more, submit it again."""

    def failure(self, error: Exception) -> Exception:
        """What to say of the error that a task ended with."""


Engine = Callable[[int], AbstractContextManager[Workers]]
"""Workers for so many tasks; at the end of the block running tasks end, and wait for nobody."""


class Caller(Protocol):
    """Whoever waits for a task, as the task sees it."""

    def stopped(self) -> bool:
        """Whether the task should come to its end."""

    def measured(self, records: int) -> None:
        """So many records more."""

    @property
    def scratch(self) -> Path | None:
        """A folder in which a run is measured until it is whole and put into its place; None: it is measured there."""


CALLER: ContextVar[Caller] = ContextVar("CALLER")
"""Set by an engine wherever it carries out a task."""


def in_parallel(
    tasks: Mapping[Name, Callable[[], Found]],
    *,
    engine: Engine,
    interruption: Interruption,
    progress: Callable[[int, int], None],
    needs: Mapping[Name, Iterable[Name]] = MappingProxyType({}),
) -> dict[Name, tuple[Found, float]]:
    """Result of every task, and the seconds it took; a failure ends it all, with the notes of those that fail after it.

    Args:
        tasks: Functions of a module, or partials of them, called in other processes; the first ones go first.
        engine: Who carries them out.
        interruption: Asked again and again; once requested, running tasks end, if their runs are `run_tasks`.
        progress: Called again and again with how many tasks are done and how many records were made in them.
        needs: The tasks that must be done before a task begins.

    Raises:
        Interrupted: it was requested.
    """
    found: dict[Name, tuple[Found, float]] = {}
    failures: list[Exception] = []
    running: dict[Future[tuple[Found, float]], Name] = {}
    waiting = dict(tasks)
    with engine(len(tasks)) as workers:
        while len(found) < len(tasks) and not failures:
            ready = (name for name in waiting if found.keys() >= set(needs.get(name, ())))
            for name in tuple(islice(ready, max(0, workers.room(len(running))))):
                running[workers.submit(waiting.pop(name))] = name
            if not running:
                interruption.wait(POLL_S)
            for future in wait(running, timeout=POLL_S, return_when=FIRST_COMPLETED).done:
                name = running.pop(future)
                if future.cancelled():
                    waiting[name] = tasks[name]
                elif isinstance(error := future.exception(), Exception):
                    failures.append(workers.failure(error))
                else:
                    found[name] = future.result()
            if not failures:
                progress(len(found), workers.records)
                failures += [Interrupted()] if interruption.requested else []
    failures += [error for one in running if isinstance(error := _error_of(one), LabctlError)]
    if failures:
        first, *others = sorted(failures, key=lambda error: isinstance(error, Interrupted))
        for note in chain.from_iterable(map(notes, others)):
            first.add_note(note)
        raise first
    return found


def _error_of(ended: Future[Any]) -> BaseException | None:
    return ended.exception() if ended.done() and not ended.cancelled() else None


def one_by_one(tasks: Mapping[Name, Callable[[], Found]]) -> dict[Name, Found]:
    """Result of every task, carried out in this process one after the other."""
    return {name: task() for name, task in tasks.items()}


def timed(task: Callable[[], Found]) -> tuple[Found, float]:
    """Result of a task, and the seconds it took."""
    began = time.perf_counter()
    return task(), time.perf_counter() - began
