"""A run as one task among others."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any
from uuid import uuid4

from instruments.bench import Observer, Observers
from labctl.bench.signals import Interruption
from labctl.engine.engine import Outcome
from labctl.engine.session import Acquisition, Resumption, acquire, resume
from labctl.studies.tasks import CALLER


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
    """Carry out one run in this process; it ends early, in the safe state, if the caller says so. `others` follow it.

    It is measured beside its place and put there when it is complete: if it is carried out twice, because nobody heard
    of the first time, the run that is there already stays, and has the same digits.
    """
    if run.directory is None:
        raise ValueError("a run among others needs a place")
    interruption, place = Interruption(), run.directory
    beside = place.with_name(f"{place.name}.{uuid4().hex[:8]}.part")
    run = replace(run, directory=beside)
    following = Observers(TaskObserver(interruption), *others)
    outcome = acquire(run, observer=following, interruption=interruption).outcome
    if not outcome.complete:
        return outcome
    try:
        beside.rename(place)
    except OSError:
        if not place.exists():
            raise
        shutil.rmtree(beside)
    return replace(outcome, directory=place)


def resume_run(run: Resumption, *others: Observer) -> Outcome:
    """Go on with a run in this process, as `acquire_run`."""
    interruption = Interruption()
    return resume(run, observer=Observers(TaskObserver(interruption), *others), interruption=interruption)
