"""Carrying out experiments: every run they need once, every twin examined, all of it in parallel where it may be."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any

from instruments.bench import Observer
from instruments.values import Uploading
from labctl.bench.opening import Access
from labctl.bench.signals import Interruption
from labctl.bench.simulation import physical_parameters
from labctl.bench.station import Station
from labctl.engine.engine import Outcome
from labctl.engine.session import Acquisition, acquire
from labctl.errors import AnalysisError, StationError
from labctl.runs.format.store import alone
from labctl.studies.paper.analyses import Conclusion, analysis_of
from labctl.studies.paper.experiments import Experiment
from labctl.studies.paper.twin_runs import TwinRuns
from labctl.studies.processes import processes
from labctl.studies.run_tasks import acquire_run, nothing_left, require_in_place
from labctl.studies.tasks import Engine, Interrupted, in_parallel
from protocols.base import Measurement
from protocols.image_readout import ImageReadout

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
        folder: Where the report goes.
        quick: Fewer twins and splits.
        seeds: How many seeds, in place of what the experiments say.
        first_seed: The first of them.
        data: Folder of data sets that is looked at first.
        access: How the bench is opened.
        engine: Who carries out what can be done side by side.
        name: What the directory of a run is called, by the run's name in the experiment file, its protocol and the
            twin's parameters that it changes.
        store: Where the runs go, a folder or a place in a store; None: into `folder`.
    """

    experiments: tuple[Experiment, ...]
    station: Station
    folder: Path
    quick: bool = False
    seeds: int | None = None
    first_seed: int = 1
    data: Path | None = None
    access: Access = Access()
    engine: Engine = processes
    name: Callable[[str, Measurement[Any], Mapping[str, Any]], str] = name_by_settings
    store: Path | None = None

    def place_of(self, run: str) -> Path:
        """Where a run of this name goes."""
        return alone((self.store or self.folder) / run)

    def seeds_of(self, experiment: Experiment) -> tuple[int, ...]:
        """Seeds of an experiment, one after the other."""
        return self.seeds_from_first(experiment.quick_twins if self.quick else experiment.twins)

    def seeds_from_first(self, usual: int) -> tuple[int, ...]:
        """So many seeds as are asked for, or the `usual` number."""
        return tuple(range(self.first_seed, self.first_seed + (self.seeds or usual)))

    def splits_of(self, experiment: Experiment) -> int:
        """Random splits for each seed."""
        return experiment.quick_splits if self.quick else experiment.splits

    def columns_of(self, experiment: Experiment, seed: int) -> tuple[dict[str, Measurement[Any]], ...]:
        """Protocols of the runs of one seed by name, for each of the experiment's averages.

        Still images come in bursts where the station is wired for them: they see the same light, in a fraction of the
        time.
        """
        changes = [{"averages": averages} for averages in experiment.averages] or [{}]
        return tuple(
            {
                name: self._quickest(protocol.model_copy(update={**change, "seed": seed}))
                for name, protocol in experiment.protocols.items()
            }
            for change in changes
        )

    def _quickest(self, protocol: Measurement[Any]) -> Measurement[Any]:
        free = isinstance(protocol, ImageReadout) and "timing" not in protocol.model_fields_set
        return protocol.model_copy(update={"timing": "burst"}) if free and self.station.wiring.burst else protocol

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
            StationError: `parameters` of a bench that is not simulated, or that cannot be.
        """
        if not self.station.wholly_simulated:
            if parameters:
                raise StationError(
                    f"{self.station.source}: {next(iter(parameters))} is changed for a run, and only a wholly "
                    "simulated bench has such a parameter: leave --station out"
                )
            return self.station
        twin = self.station.twin(seed).with_parameters(parameters)
        if parameters:
            physical_parameters(twin)
        return twin if "projector" in twin.wiring.model_fields_set else twin.cabled(projector=protocol.projector)


@dataclass(frozen=True)
class Column:
    """What came of an experiment with one number of triggers a frame.

    Attributes:
        findings: What the analysis found, for each seed.
        conclusion: What all of them say together.
        outcomes: How the runs went: name in the experiment file -> for each seed.
    """

    findings: tuple[Any, ...]
    conclusion: Conclusion
    outcomes: Mapping[str, tuple[Outcome, ...]]


@dataclass(frozen=True)
class Reproduced:
    """What came of one experiment.

    Attributes:
        experiment: The experiment.
        seeds: Its seeds.
        splits: Random splits for each seed.
        columns: What came of each of the experiment's averages, single triggers first.
        seconds: What all of it took, by the work of every process.
    """

    experiment: Experiment
    seeds: tuple[int, ...]
    splits: int
    columns: tuple[Column, ...]
    seconds: float

    @property
    def runs(self) -> tuple[Path, ...]:
        """The run directories, column by column and seed by seed; a run that has two names comes once."""
        by_seed = chain.from_iterable(zip(*column.outcomes.values(), strict=True) for column in self.columns)
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
        WrongPlace: runs were measured, and are not seen by all.
    """
    twins = {
        (experiment.name, seed): (experiment, _twins(plan, experiment, seed))
        for experiment in _in_order(plan)
        for seed in plan.seeds_of(experiment)
    }
    runs = {
        directory: plan.acquisition(twin.protocols[name], directory, experiment.runs[name].parameters)
        for experiment, columns in twins.values()
        for twin in columns
        for name, directory in twin.runs.items()
    }
    tasks: dict[Task, Callable[[], Any]] = {name: partial(_examine, *of_seed) for name, of_seed in twins.items()}
    done: dict[Task, tuple[Any, float]] = {}

    def follow(finished: int, records: int = 0) -> None:
        progress(len(done) + finished, len(runs) + len(twins))
        measured(records)

    needs: dict[Task, Iterable[Task]] = {}
    if plan.station.wholly_simulated:
        tasks |= {directory: partial(acquire_run, run) for directory, run in runs.items()}
        needs = {name: _directories(columns) for name, (_, columns) in twins.items()}
    else:
        done |= _acquired_in_turn(runs, interruption, follow, uploading)
    done |= in_parallel(tasks, engine=plan.engine, needs=needs, interruption=interruption, progress=follow)
    require_in_place(runs)
    reproduced, failed = [], {}
    for experiment in plan.experiments:
        own = {seed: twins[experiment.name, seed][1] for seed in plan.seeds_of(experiment)}
        try:
            reproduced.append(_concluded(plan, experiment, own, done))
        except AnalysisError as error:
            failed[experiment.name] = error
    return reproduced, failed


def _in_order(plan: Plan) -> Sequence[Experiment]:
    """As they are carried out; side by side those with networks first: begun last, one leaves a core idle."""
    if not plan.station.wholly_simulated:
        return plan.experiments
    return sorted(plan.experiments, key=lambda experiment: not analysis_of(experiment)[0].needs_torch)


def _twins(plan: Plan, experiment: Experiment, seed: int) -> tuple[TwinRuns, ...]:
    """The runs of one seed, for each of the experiment's averages."""
    known: dict[str, Any] = {}
    return tuple(
        TwinRuns(
            {
                name: plan.place_of(plan.name(name, protocol, experiment.runs[name].parameters))
                for name, protocol in protocols.items()
            },
            protocols,
            seed,
            plan.splits_of(experiment),
            plan.data,
            seed - plan.first_seed,
            known,
        )
        for protocols in plan.columns_of(experiment, seed)
    )


def _directories(columns: Iterable[TwinRuns]) -> list[Path]:
    return [directory for twin in columns for directory in twin.runs.values()]


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
    plan: Plan,
    experiment: Experiment,
    twins: Mapping[int, tuple[TwinRuns, ...]],
    done: Mapping[Task, tuple[Any, float]],
) -> Reproduced:
    """What the twins of an experiment, by seed, say together; `done` has the result and the seconds of every task."""
    began = time.perf_counter()
    examined = [done[experiment.name, seed][0] for seed in twins]
    if failures := [found for found in examined if isinstance(found, AnalysisError)]:
        raise failures[0]
    columns = tuple(
        _column(plan, experiment, findings, runs, done)
        for findings, runs in zip(zip(*examined, strict=True), zip(*twins.values(), strict=True), strict=True)
    )
    directories = {directory for runs in twins.values() for directory in _directories(runs)}
    tasks: list[Task] = [*directories, *((experiment.name, seed) for seed in twins)]
    seconds = sum(done[task][1] for task in tasks) + time.perf_counter() - began
    return Reproduced(experiment, tuple(twins), plan.splits_of(experiment), columns, seconds)


def _column(
    plan: Plan,
    experiment: Experiment,
    findings: tuple[Any, ...],
    twins: tuple[TwinRuns, ...],
    done: Mapping[Task, tuple[Any, float]],
) -> Column:
    analysis, settings = analysis_of(experiment)
    conclusion = analysis.conclude(findings, settings)
    if plan.benches_of(experiment) < len(twins):
        conclusion = replace(conclusion, notes=(ONE_BENCH, *conclusion.notes))
    outcomes = {name: tuple(done[twin.runs[name]][0] for twin in twins) for name in experiment.runs}
    return Column(findings, conclusion, outcomes)


def _examine(experiment: Experiment, columns: tuple[TwinRuns, ...]) -> list[Any] | AnalysisError:
    """What the runs of one seed show, for each of the experiment's averages; or why they show nothing."""
    analysis, settings = analysis_of(experiment)
    require_in_place(_directories(columns))
    try:
        with nothing_left():
            return [analysis.examine(twin, settings) for twin in columns]
    except AnalysisError as error:
        return error
