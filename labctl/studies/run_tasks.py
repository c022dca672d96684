"""A run as one task among others."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from instruments.bench import Observer, Observers
from labctl.bench.signals import Interruption
from labctl.engine.engine import Outcome
from labctl.engine.session import Acquisition, Resumption, acquire, resume
from labctl.studies.tasks import CALLER, Interrupted


class TaskObserver(Observer):
    """Follows a run inside a task: counts its records, and ends it when the task should come to its end."""

    def __init__(self, interruption: Interruption) -> None:
        """Of the run that `interruption` ends."""
        self._interruption = interruption
        self._caller = CALLER.get()
        self._done = 0

    def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
        """More records: one, or those of a burst."""
        self._caller.measured(done - self._done)
        self._done = done
        self._interruption.requested |= self._caller.stopped()


def acquire_run(run: Acquisition, *others: Observer) -> Outcome:
    """Carry out one run in this process, where the caller wants it meanwhile; `others` follow it.

    Raises:
        Interrupted: the caller said so; the bench is in the safe state.
    """
    if run.directory is None:
        raise ValueError("a run among others needs a place")
    interruption = Interruption()
    following = Observers(TaskObserver(interruption), *others)
    with CALLER.get().placed(run.directory) as directory:
        meanwhile = replace(run, directory=directory)
        outcome = _whole(acquire(meanwhile, observer=following, interruption=interruption).outcome)
    return replace(outcome, directory=run.directory)


def resume_run(run: Resumption, *others: Observer) -> Outcome:
    """Go on with a run in this process, as `acquire_run`."""
    interruption = Interruption()
    following = Observers(TaskObserver(interruption), *others)
    return _whole(resume(run, observer=following, interruption=interruption))


def _whole(outcome: Outcome) -> Outcome:
    if not outcome.complete:
        raise Interrupted
    return outcome
