"""A run as one task among others."""

import gc
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from platform import node
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

from instruments.bench import Observer, Observers
from labctl.bench.signals import Interruption
from labctl.bench.station import Station
from labctl.engine.control import Control
from labctl.engine.engine import Outcome
from labctl.engine.inputs import inputs_for
from labctl.engine.recorded_protocol import refuse_other_inputs
from labctl.engine.resume import MAY_CHANGE
from labctl.engine.session import Acquisition, Resumption, acquire, resume
from labctl.errors import LabctlError, RunError, RunInUse, WrongPlace, writing
from labctl.runs.format.durable import NotStored
from labctl.runs.format.journal import read_journal
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest
from labctl.runs.format.provenance import versions
from labctl.runs.format.store import alone, is_elsewhere, mended
from labctl.runs.index import run_row
from labctl.runs.live.control_file import CONTROL
from labctl.runs.read.differences import differences
from labctl.runs.write.placing import put_whole
from labctl.studies.tasks import CALLER, Interrupted
from protocols.base import Measurement

AGAIN_S = 0.5
"""How often a run is tried that somebody else is writing."""
OWN_BUSINESS = (
    *(f"station.{key}" for key in MAY_CHANGE),
    *(f"protocol.{key}" for key in ("digest", "judgement", "file.path", "file.text")),
)
"""In a manifest: what may be another of the same run, and what follows from the rest."""


class TaskObserver(Observer):
    """Follows a run inside a task: counts its records, and ends it when the task should come to its end.

    A sweep that the run is part of may be told something before the run can be.
    """

    def __init__(self) -> None:
        """Of the run that its `interruption` ends."""
        self.interruption = Interruption(wait=self._wait)
        self._caller = CALLER.get()
        self._done = 0

    def stored_in(self, directory: Path) -> None:
        """From now on the run can be told something itself."""
        Control(directory.parent / CONTROL, self.interruption).wait()

    def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
        """More records: one, or those of a burst."""
        self._caller.measured(done - self._done)
        self._done = done
        self.interruption.requested |= self._caller.stopped()

    def _wait(self, seconds: float) -> None:
        time.sleep(seconds)
        self.interruption.requested |= self._caller.stopped()


def acquire_run(run: Acquisition, *others: Observer) -> Outcome:
    """Carry out one run in this process, or what it lacks of it where it is in its place already; `others` follow it.

    Raises:
        Interrupted: the caller said so; the bench is in the safe state.
        RunError: another run is in its place, or it cannot be put there.
    """
    if run.directory is None:
        raise ValueError("a run among others needs a place")
    if RunPaths(alone(run.directory)).manifest.exists():
        refuse_another(run, run.directory)
        known = _whole_in_place(run, run.directory)
        return known or resume_run(Resumption(run.directory, run.station, run.data, run.access), *others)
    task = TaskObserver()
    following = Observers(task, *others)
    with _placed(run, run.directory) as directory, nothing_left():
        meanwhile = replace(run, directory=directory)
        outcome = _whole(acquire(meanwhile, observer=following, interruption=task.interruption).outcome)
    return replace(outcome, directory=run.directory)


def require_in_place(runs: Iterable[Path]) -> None:
    """Require that runs which were measured are seen from here; whatever is in a store is.

    Raises:
        WrongPlace: one is not: whoever measured it has another folder of that name.
    """
    for run in runs:
        if not is_elsewhere(run) and not RunPaths(run).manifest.exists():
            raise WrongPlace(
                f"{run}: was measured, and is not there on {node()}: the workers share no such folder with this "
                "machine: begin anew with --store and a place that all reach"
            )


def resume_run(run: Resumption, *others: Observer) -> Outcome:
    """Go on with a run in this process, as `acquire_run`.

    On a cluster the same may be going on still where a worker is that was thought to be gone: it is waited for.
    """
    task, caller = TaskObserver(), CALLER.get()
    following = Observers(task, *others)
    while True:
        try:
            with nothing_left():
                return _whole(resume(run, observer=following, interruption=task.interruption))
        except RunInUse:
            if caller.scratch is None:
                raise
            if caller.stopped():
                raise Interrupted from None
            time.sleep(AGAIN_S)


@contextmanager
def nothing_left() -> Iterator[None]:
    """Free what the block leaves in memory at its end; what was there before it is not looked through.

    A simulated bench is a circle of few objects that hold much, as a network in training is, and the collector, which
    counts objects, would let many of them gather.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.collect()
        gc.unfreeze()


def _whole(outcome: Outcome) -> Outcome:
    """How a run went that is over."""
    if not outcome.complete:
        raise Interrupted
    return outcome


@contextmanager
def _placed(run: Acquisition, directory: Path) -> Iterator[Path]:
    """Where to measure the run that is to be in `directory` at the end of the block, if that is no failure.

    Somebody may put the same there meanwhile. What was measured and cannot be put there is kept, and the error says
    where. Of a run that ends early nothing is.
    """
    scratch = CALLER.get().scratch
    if scratch is None and not is_elsewhere(directory):
        yield directory
        return
    with writing(directory):
        if scratch is not None:
            scratch.mkdir(parents=True, exist_ok=True)
        measured = Path(mkdtemp(".part", f"{directory.name}.", scratch)) / directory.name
    with ExitStack() as stack:
        stack.callback(rmtree, measured.parent, ignore_errors=True)
        try:
            yield measured
        except NotStored as error:
            what, remedy = error.args
            raise RunError(f"{what}, on {node()}; nothing of this run is kept: {remedy}, then begin it anew") from error
        try:
            if not put_whole(measured, directory):
                refuse_another(run, directory)
        except LabctlError as error:
            stack.pop_all()
            kept = f"the run is kept on {node()} in {measured}"
            there = f"copy it to {directory}, its manifest.json last, and go on"
            error.add_note(kept if isinstance(error, WrongPlace) else f"{kept}: {there}")
            raise


def refuse_another(run: Acquisition, directory: Path) -> None:
    """Require that what is in `directory`, whole or begun, is this run.

    Raises:
        WrongPlace: it is not this run: protocol, seeds, bench or packages are others.
        RunError: its inputs are others.
    """
    then = Manifest.read(RunPaths(alone(directory))).values
    if other := other_than(asked_of(run.protocol, run.station) | {"versions": versions()}, then):
        raise WrongPlace(f"{directory}: another run is there ({other}): name another place")
    refuse_other_inputs(directory, then, inputs_for(run.protocol, run.data))


def asked_of(protocol: Measurement[Any], station: Station) -> dict[str, Any]:
    """What the manifest of a run says of what it was asked for."""
    own_file = {} if (file := protocol.source_file) is None else {"file": {"sha256": file.sha256}}
    return {
        "protocol": {"name": protocol.name, "settings": protocol.model_dump(mode="json"), **own_file},
        "station": station.model_dump(mode="json"),
    }


def other_than(now: Mapping[str, Any], then: Mapping[str, Any], *varied: str) -> str:
    """The first setting in a manifest `then` that is not what it is `now`, in words; empty if none is.

    varied: patterns of the settings that may be others.
    """
    found = differences({key: then.get(key) for key in now}, now, ignored=(*OWN_BUSINESS, *varied))
    return next((f"{one.setting} is {one.then}, not {one.now}" for one in found), "")


def _whole_in_place(run: Acquisition, directory: Path) -> Outcome | None:
    """How the run went that is in `directory`, if it lacks nothing.

    Raises:
        RunError: it lacks something, and is in a store, where it cannot go on.
    """
    paths = RunPaths(alone(directory))
    row = run_row(paths)
    lacks = row.problem or f"{row.shots} of {row.planned} shots" if not row.complete else missing_shard(paths)
    if lacks and is_elsewhere(directory):
        raise RunError(f"{directory}: is not whole ({lacks}): {mended(directory, '')}")
    if lacks:
        return None
    return Outcome(
        directory=directory,
        shots=row.shots,
        measured=0,
        complete=True,
        clipped=0,
        recovered=0,
        seconds=0.0,
        bench_seconds=0.0,
        simulated=run.station.simulated,
    )


def missing_shard(paths: RunPaths) -> str:
    """A file that the journal names and that is not there, in words; empty if all are."""
    named = {entry.shard: entry for entry in read_journal(paths.journal).entries}  # the last line of a shard counts
    shards = [paths.shard(number) for number, entry in named.items() if not entry.discarded]
    return next((f"shards/{shard.name} is missing" for shard in shards if not shard.exists()), "")
