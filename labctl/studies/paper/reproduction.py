"""Carrying out experiments: every run they need once, every twin examined, all of it in parallel where it may be."""

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

from instruments.bench import Observer
from instruments.values import Uploading
from labctl.bench.signals import Interruption
from labctl.bench.station import Station
from labctl.engine.session import Acquisition, acquire
from labctl.errors import AnalysisError
from labctl.studies.paper.analyses import analysis_of
from labctl.studies.paper.contract import Conclusion, Material
from labctl.studies.paper.experiments import Experiment
from labctl.studies.processes import Interrupted, TaskObserver, in_parallel
from protocols.base import Measurement

ONE_BENCH = "One bench for every seed: seeds differ in images, order, drive and splits, not in fibre, chip and noise."

Progress = Callable[[int, int], None]
"""Called with the number of tasks that are done and of all: runs, then examinations."""


@dataclass(frozen=True)
class Plan:
    """What is to be carried out.

    Attributes:
        experiments: The experiments.
        station: The bench; where all of it is simulated, each seed is another twin.
        folder: Where the runs go.
        quick: Fewer twins and splits.
        seeds: How many seeds, in place of what the experiments say.
        data: Folder of data sets that is looked at first.
        attended: Whether somebody is at the bench.
        armed: Whether light is allowed, whatever the station says.
    """

    experiments: tuple[Experiment, ...]
    station: Station
    folder: Path
    quick: bool = False
    seeds: int | None = None
    data: Path | None = None
    attended: bool = False
    armed: bool = False

    def seeds_of(self, experiment: Experiment) -> tuple[int, ...]:
        """Seeds of an experiment: 1, 2, ..."""
        count = self.seeds or (experiment.quick_twins if self.quick else experiment.twins)
        return tuple(range(1, count + 1))

    def splits_of(self, experiment: Experiment) -> int:
        """Random splits for each seed."""
        return experiment.quick_splits if self.quick else experiment.splits

    def benches_of(self, experiment: Experiment) -> int:
        """On how many benches an experiment is measured: a twin for each seed, or the one bench that there is."""
        return len(self.seeds_of(experiment)) if self.station.wholly_simulated else 1

    def station_for(self, protocol: Measurement[Any], seed: int) -> Station:
        """The station as a run needs it.

        A simulated bench is another twin for each seed, and is cabled as the protocol asks unless its file says how.
        """
        if not self.station.wholly_simulated:
            return self.station
        twin = self.station.twin(seed)
        return twin if "projector" in twin.wiring.model_fields_set else twin.cabled(projector=protocol.projector)


@dataclass(frozen=True)
class Reproduced:
    """What came of one experiment."""

    experiment: Experiment
    seeds: tuple[int, ...]
    splits: int
    conclusion: Conclusion
    seconds: float
    runs: tuple[Path, ...]


@dataclass(frozen=True)
class RunTask:
    """One run: the protocol with its seed, on which station, into which directory."""

    protocol: Measurement[Any]
    station: Station
    directory: Path
    data: Path | None
    attended: bool = False
    armed: bool = False


@dataclass(frozen=True)
class _Examination:
    """One twin of one experiment."""

    experiment: Experiment
    seed: int
    material: Material


@dataclass
class _Tasks:
    """Everything to do: each run once, whoever needs it."""

    runs: dict[Path, RunTask] = field(default_factory=dict)
    examinations: list[_Examination] = field(default_factory=list)


def reproduce(
    plan: Plan, *, interruption: Interruption, progress: Progress, uploading: Uploading
) -> tuple[list[Reproduced], dict[str, AnalysisError]]:
    """Acquire every run, examine every twin, and conclude; `uploading` hears of uploads to the one bench there is.

    Returns:
        What came of the experiments; and of those whose analysis failed, name -> why. The others do not suffer from it.

    Raises:
        Interrupted: the operator stopped it.
        InstrumentError, DatasetError, ProtocolError, StationError, RunError: a run failed.
    """
    tasks = _tasks(plan)
    runs, examinations = len(tasks.runs), len(tasks.examinations)
    in_turn = partial(_acquired_in_turn, uploading=uploading)
    acquire_all = _acquired_in_parallel if plan.station.wholly_simulated else in_turn
    acquired = acquire_all(tasks.runs, interruption, lambda done: progress(done, runs + examinations))
    examined = in_parallel(
        _examine,
        dict(enumerate(tasks.examinations)),
        workers=os.cpu_count() or 1,
        interruption=interruption,
        progress=lambda done, _steps: progress(runs + done, runs + examinations),
    )
    everything, failed = [], {}
    for experiment in plan.experiments:
        try:
            everything.append(_concluded(plan, experiment, tasks, acquired, examined))
        except AnalysisError as error:
            failed[experiment.name] = error
    return everything, failed


def _tasks(plan: Plan) -> _Tasks:
    tasks = _Tasks()
    for experiment in plan.experiments:
        for seed in plan.seeds_of(experiment):
            protocols = {
                name: protocol.model_copy(update={"seed": seed}) for name, protocol in experiment.protocols.items()
            }
            directories = {name: _directory(plan, protocol, seed) for name, protocol in protocols.items()}
            for name, directory in directories.items():
                station = plan.station_for(protocols[name], seed)
                run = RunTask(protocols[name], station, directory, plan.data, plan.attended, plan.armed)
                tasks.runs.setdefault(directory, run)
            material = Material(directories, protocols, seed, plan.splits_of(experiment), plan.data)
            tasks.examinations.append(_Examination(experiment, seed, material))
    return tasks


def _acquired_in_parallel(
    runs: Mapping[Path, RunTask], interruption: Interruption, progress: Callable[[int], None]
) -> Mapping[Path, tuple[object, float]]:
    """Carry out runs on simulated benches of their own."""
    return in_parallel(
        acquire_run,
        runs,
        workers=os.cpu_count() or 1,
        interruption=interruption,
        progress=lambda done, _steps: progress(done),
    )


def _acquired_in_turn(
    runs: Mapping[Path, RunTask], interruption: Interruption, progress: Callable[[int], None], uploading: Uploading
) -> Mapping[Path, tuple[object, float]]:
    """Carry out runs on the one bench there is; in this process, which has the terminal and hears its operator."""
    acquired: dict[Path, tuple[object, float]] = {}

    class Following(Observer):
        def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
            progress(len(acquired))

        def uploading(self, what: str, done: int, total: int) -> None:
            uploading(what, done, total)

    for directory, run in runs.items():
        began = time.perf_counter()
        acquisition = Acquisition(run.protocol, run.station, directory, run.data, run.attended, run.armed)
        outcome = acquire(acquisition, observer=Following(), interruption=interruption)
        acquired[directory] = outcome, time.perf_counter() - began
        if interruption.requested:
            raise Interrupted
        progress(len(acquired))
    return acquired


def _directory(plan: Plan, protocol: Measurement[Any], seed: int) -> Path:
    """Where a run goes; equal runs of several experiments are one."""
    identity = sha256(f"{protocol.digest()} {seed}".encode()).hexdigest()[:8]
    return plan.folder / f"{protocol.name}-seed-{seed}-{identity}"


def _concluded(
    plan: Plan,
    experiment: Experiment,
    tasks: _Tasks,
    acquired: Mapping[Path, tuple[object, float]],
    examined: Mapping[int, tuple[Any, float]],
) -> Reproduced:
    began = time.perf_counter()
    analysis, settings = analysis_of(experiment)
    own = [number for number, found in enumerate(tasks.examinations) if found.experiment is experiment]
    directories = tuple(
        dict.fromkeys(directory for number in own for directory in tasks.examinations[number].material.runs.values())
    )
    findings = [examined[number][0] for number in own]
    if failures := [found for found in findings if isinstance(found, AnalysisError)]:
        raise failures[0]
    conclusion = analysis.conclude(findings, settings)
    if plan.benches_of(experiment) < len(own):
        conclusion = replace(conclusion, notes=(ONE_BENCH, *conclusion.notes))
    seconds = sum(examined[number][1] for number in own) + sum(acquired[directory][1] for directory in directories)
    return Reproduced(
        experiment,
        plan.seeds_of(experiment),
        plan.splits_of(experiment),
        conclusion,
        seconds + time.perf_counter() - began,
        directories,
    )


def acquire_run(run: RunTask) -> None:
    """Carry out one run in this process; it ends early, in the safe state, if the parent says so."""
    interruption = Interruption()
    acquisition = Acquisition(run.protocol, run.station, run.directory, run.data)
    acquire(acquisition, observer=TaskObserver(interruption), interruption=interruption)


def _examine(examination: _Examination) -> Any:
    """What one twin shows, or the `AnalysisError` that says why it shows nothing."""
    analysis, settings = analysis_of(examination.experiment)
    try:
        return analysis.examine(examination.material, settings)
    except AnalysisError as error:
        return error
