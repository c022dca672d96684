"""Carrying out experiments: every run they need once, every twin examined, all of it in parallel where it may be."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any

from instruments.bench import Observer
from instruments.values import Uploading
from labctl.bench.opening import Access
from labctl.bench.signals import Interruption
from labctl.bench.station import Station
from labctl.engine.engine import Outcome
from labctl.engine.session import Acquisition, acquire
from labctl.errors import AnalysisError, StationError
from labctl.studies.paper.analyses import Conclusion, analysis_of
from labctl.studies.paper.experiments import Experiment
from labctl.studies.paper.twin_runs import TwinRuns
from labctl.studies.processes import Interrupted, TaskObserver, in_parallel
from protocols.base import Measurement

NOTHING_CHANGED: Mapping[str, Any] = MappingProxyType({})

ONE_BENCH = "One bench for every seed: seeds differ in images, order, drive and splits, not in fibre, chip and noise."

Progress = Callable[[int, int], None]
"""Called with the number of tasks that are done and of all: runs, then examinations."""

Task = Path | tuple[str, int]
"""A run, by its directory, or the examination of a twin, by the experiment's name and the seed."""


def _unheard(*_told: object) -> None:
    pass


def name_by_settings(_run: str, protocol: Measurement[Any], parameters: Mapping[str, Any]) -> str:
    """A name that equal runs of several experiments share."""
    changed = f" {sorted(parameters.items())}" if parameters else ""
    identity = sha256(f"{protocol.digest()} {protocol.seed}{changed}".encode()).hexdigest()[:8]
    return f"{protocol.name}-seed-{protocol.seed}-{identity}"


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
        access: How the bench is opened.
        name: What the directory of a run is called, by the run's name in the experiment file, its protocol and the
            twin's parameters that it changes.
    """

    experiments: tuple[Experiment, ...]
    station: Station
    folder: Path
    quick: bool = False
    seeds: int | None = None
    data: Path | None = None
    access: Access = Access()
    name: Callable[[str, Measurement[Any], Mapping[str, Any]], str] = name_by_settings

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

    def acquisition(
        self, protocol: Measurement[Any], directory: Path, parameters: Mapping[str, Any] = NOTHING_CHANGED
    ) -> Acquisition:
        """A run of `protocol` into `directory`, on the station as it needs it."""
        station = self.station_for(protocol, protocol.seed, parameters)
        return Acquisition(protocol, station, directory, self.data, self.access)

    def station_for(
        self, protocol: Measurement[Any], seed: int, parameters: Mapping[str, Any] = NOTHING_CHANGED
    ) -> Station:
        """The station as a run needs it.

        A simulated bench is another twin for each seed, with `parameters` that differ from the station's, and is
        cabled as the protocol asks unless its file says how.

        Raises:
            StationError: `parameters` of a bench that is not simulated.
        """
        if not self.station.wholly_simulated:
            if parameters:
                raise StationError(
                    f"{self.station.source}: {next(iter(parameters))} is changed for a run, and only a wholly "
                    "simulated bench has such a parameter: leave --station out"
                )
            return self.station
        twin = self.station.twin(seed).with_parameters(parameters)
        return twin if "projector" in twin.wiring.model_fields_set else twin.cabled(projector=protocol.projector)


@dataclass(frozen=True)
class Reproduced:
    """What came of one experiment.

    Attributes:
        experiment: The experiment.
        seeds: Its seeds.
        splits: Random splits for each seed.
        findings: What its analysis found, for each seed.
        conclusion: What all of them say together.
        outcomes: How its runs went: name in the experiment file -> for each seed.
        seconds: What all of it took, by the work of every process.
    """

    experiment: Experiment
    seeds: tuple[int, ...]
    splits: int
    findings: tuple[Any, ...]
    conclusion: Conclusion
    outcomes: Mapping[str, tuple[Outcome, ...]]
    seconds: float

    @property
    def runs(self) -> tuple[Path, ...]:
        """The run directories, seed by seed; a run that has two names comes once."""
        by_seed = zip(*self.outcomes.values(), strict=True)
        return tuple(dict.fromkeys(outcome.directory for outcomes in by_seed for outcome in outcomes))


def reproduce(
    plan: Plan,
    *,
    interruption: Interruption,
    progress: Progress = _unheard,
    uploading: Uploading = _unheard,
    measured: Callable[[int], None] = _unheard,
) -> tuple[list[Reproduced], dict[str, AnalysisError]]:
    """Acquire every run, examine every twin, and conclude.

    `uploading` hears of uploads to the one bench there is; `measured`, where all are simulated, how many records there
    are so far.

    Returns:
        What came of the experiments; and of those whose analysis failed, name -> why. The others do not suffer from it.

    Raises:
        Interrupted: the operator stopped it.
        InstrumentError, DatasetError, ProtocolError, StationError, RunError: a run failed.
    """
    twins = {
        (experiment.name, seed): (experiment, _twin(plan, experiment, seed))
        for experiment in plan.experiments
        for seed in plan.seeds_of(experiment)
    }
    runs = {
        directory: plan.acquisition(twin.protocols[name], directory, experiment.runs[name].parameters)
        for experiment, twin in twins.values()
        for name, directory in twin.runs.items()
    }
    tasks: dict[Task, Callable[[], Any]] = {name: partial(_examine, *twin) for name, twin in twins.items()}
    done: dict[Task, tuple[Any, float]] = {}

    def follow(finished: int, records: int = 0) -> None:
        progress(len(done) + finished, len(runs) + len(twins))
        measured(records)

    needs: dict[Task, Iterable[Task]] = {}
    if plan.station.wholly_simulated:
        tasks |= {directory: partial(acquire_run, run) for directory, run in runs.items()}
        needs = {name: twin.runs.values() for name, (_, twin) in twins.items()}
    else:
        done |= _acquired_in_turn(runs, interruption, follow, uploading)
    done |= in_parallel(tasks, needs=needs, interruption=interruption, progress=follow)
    reproduced, failed = [], {}
    for experiment in plan.experiments:
        own = {seed: twins[experiment.name, seed][1] for seed in plan.seeds_of(experiment)}
        try:
            reproduced.append(_concluded(plan, experiment, own, done))
        except AnalysisError as error:
            failed[experiment.name] = error
    return reproduced, failed


def acquire_run(run: Acquisition) -> Outcome:
    """Carry out one run in this process; it ends early, in the safe state, if the parent says so."""
    interruption = Interruption()
    return acquire(run, observer=TaskObserver(interruption), interruption=interruption).outcome


def _twin(plan: Plan, experiment: Experiment, seed: int) -> TwinRuns:
    protocols = {name: protocol.model_copy(update={"seed": seed}) for name, protocol in experiment.protocols.items()}
    directories = {
        name: plan.folder / plan.name(name, protocol, experiment.runs[name].parameters)
        for name, protocol in protocols.items()
    }
    return TwinRuns(directories, protocols, seed, plan.splits_of(experiment), plan.data)


def _acquired_in_turn(
    runs: Mapping[Path, Acquisition],
    interruption: Interruption,
    progress: Callable[[int], None],
    uploading: Uploading,
) -> dict[Task, tuple[Any, float]]:
    """Carry out runs on the one bench there is; in this process, which has the terminal."""
    acquired: dict[Task, tuple[Any, float]] = {}

    class Following(Observer):
        def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
            progress(len(acquired))

        def uploading(self, what: str, done: int, total: int) -> None:
            uploading(what, done, total)

    for directory, run in runs.items():
        began = time.perf_counter()
        outcome = acquire(run, observer=Following(), interruption=interruption).outcome
        acquired[directory] = outcome, time.perf_counter() - began
        if interruption.requested:
            raise Interrupted
        progress(len(acquired))
    return acquired


def _concluded(
    plan: Plan, experiment: Experiment, twins: Mapping[int, TwinRuns], done: Mapping[Task, tuple[Any, float]]
) -> Reproduced:
    """What the twins of an experiment, by seed, say together; `done` has the result and the seconds of every task."""
    began = time.perf_counter()
    findings = tuple(done[experiment.name, seed][0] for seed in twins)
    if failures := [found for found in findings if isinstance(found, AnalysisError)]:
        raise failures[0]
    analysis, settings = analysis_of(experiment)
    conclusion = analysis.conclude(findings, settings)
    if plan.benches_of(experiment) < len(twins):
        conclusion = replace(conclusion, notes=(ONE_BENCH, *conclusion.notes))
    directories = {directory for twin in twins.values() for directory in twin.runs.values()}
    tasks: list[Task] = [*directories, *((experiment.name, seed) for seed in twins)]
    return Reproduced(
        experiment,
        tuple(twins),
        plan.splits_of(experiment),
        findings,
        conclusion,
        {name: tuple(done[twin.runs[name]][0] for twin in twins.values()) for name in experiment.runs},
        sum(done[task][1] for task in tasks) + time.perf_counter() - began,
    )


def _examine(experiment: Experiment, twin: TwinRuns) -> Any:
    """What one twin shows, or the `AnalysisError` that says why it shows nothing."""
    analysis, settings = analysis_of(experiment)
    try:
        return analysis.examine(twin, settings)
    except AnalysisError as error:
        return error
