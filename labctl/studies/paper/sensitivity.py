"""What a result rests on: the same run on twins whose parameters are varied one at a time around their defaults."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.analysis.evaluation import validate
from labctl.analysis.intervals import SHARE, Statistic, pooled
from labctl.bench.signals import Interruption
from labctl.bench.simulation import drive_depth_rad
from labctl.bench.station import Station
from labctl.engine.recorder import WrongRecord
from labctl.engine.session import Acquisition
from labctl.errors import ExperimentError
from labctl.reports.canvas import Level
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.sensitivity import Sensitivity, sensitivity_figure
from labctl.studies.paper.experiments import Experiment, SensitivityStudy, Variation
from labctl.studies.paper.reproduction import Plan, Progress
from labctl.studies.paper.twin_runs import TwinRuns, window_features
from labctl.studies.run_tasks import acquire_run
from labctl.studies.tasks import in_parallel


@dataclass(frozen=True)
class Dependence:
    """How the accuracy depends on one parameter, over the twins, for each of its values.

    None: on one twin at least the run ended, because its own records were doubted.
    """

    variation: Variation
    accuracy: list[Statistic | None]


@dataclass(frozen=True)
class Point:
    """A twin of the study: its seed, and the parameters that are not at their defaults."""

    seed: int
    parameters: tuple[tuple[str, float], ...]

    @property
    def name(self) -> str:
        """Name of the run's directory."""
        return f"seed-{self.seed}" + "".join(f"-{name}-{value:g}" for name, value in self.parameters)


def study_of(experiment: Experiment) -> SensitivityStudy:
    """What the experiment's file wants varied.

    Raises:
        ExperimentError: nothing.
    """
    if experiment.sensitivity is None:
        raise ExperimentError(f"experiment {experiment.name} says nothing to vary: --sensitivity is for fig3")
    return experiment.sensitivity


def sensitivity(
    plan: Plan, experiment: Experiment, *, interruption: Interruption, progress: Progress
) -> list[Dependence]:
    """Acquire and judge one run a twin for every value of every parameter.

    Raises:
        ExperimentError: the experiment says nothing to vary, or the bench is a real one.
        Interrupted: the operator stopped it.
    """
    study = study_of(experiment)
    if not plan.station.wholly_simulated:
        raise ExperimentError(f"{plan.station.source}: a real bench has no parameters to vary: leave --station out")
    seeds = plan.seeds_from_first(study.quick_twins if plan.quick else study.twins)
    points = {
        (variation, value): points_of(variation, value, seeds)
        for variation in study.parameters
        for value in variation.values
    }
    splits = plan.splits_of(experiment)
    tasks = {
        point: partial(
            judged, acquisition_of(plan, experiment, study.run, point, study.window), splits, (study.window,)
        )
        for point in chain.from_iterable(points.values())
    }
    found = in_parallel(
        tasks,
        engine=plan.engine,
        interruption=interruption,
        progress=lambda done, _steps: progress(done, len(tasks)),
    )
    return [
        Dependence(
            in_words(variation, plan.station),
            [_together([found[point][0] for point in points[variation, value]]) for value in variation.values],
        )
        for variation in study.parameters
    ]


def figure_of(study: SensitivityStudy, dependences: Sequence[Dependence]) -> ExperimentFigure:
    """The dependence on every parameter, side by side."""
    panels = []
    for found in dependences:
        known = [(value, one) for value, one in zip(found.variation.values, found.accuracy, strict=True) if one]
        panels.append(
            Sensitivity(
                found.variation.name,
                [value for value, _ in known],
                [accuracy["mean"] for _, accuracy in known],
                [accuracy["sd"] for _, accuracy in known],
                found.variation.default,
                found.variation.logarithmic,
            )
        )
    caption = "Accuracy against one parameter of the twin at a time; the mark shows what all experiments use."
    required = None if study.required is None else Level("must reach", study.required)
    figure = sensitivity_figure(panels, title=f"acquisition time {study.window * 1e9:g} ns", required=required)
    return ExperimentFigure("sensitivity", figure, caption)


def as_json(dependences: Sequence[Dependence]) -> dict[str, Any]:
    """Parameter -> its name, values, accuracies and default."""
    return {
        found.variation.parameter: {
            "name": found.variation.name,
            "values": list(found.variation.values),
            "accuracy": found.accuracy,
            "default": found.variation.default,
        }
        for found in dependences
    }


def in_words(variation: Variation, station: Station) -> Variation:
    """What it is called beside its results: a gain of the driver by the depth that it gives the drive, rad."""
    if variation.parameter != "rf_gain":
        return variation
    *depths, default = (
        drive_depth_rad(station.with_parameters(dict(point.parameters)))
        for value in (*variation.values, variation.default)
        for point in points_of(variation, value, (station.sim.twin_seed,))
    )
    return variation.model_copy(update={"values": tuple(depths), "default": default})


def _together(benches: Sequence[list[NDArray[np.float64]] | None]) -> Statistic | None:
    scores = [bench[0] for bench in benches if bench is not None]
    return pooled(scores, within=SHARE) if len(scores) == len(benches) else None


def points_of(variation: Variation, value: float, seeds: Iterable[int]) -> list[Point]:
    """The twins for one value of a parameter; all defaults are the same twins."""
    changed = () if value == variation.default else ((variation.parameter, variation.parameter_at(value)),)
    return [Point(seed, changed) for seed in seeds]


def acquisition_of(plan: Plan, experiment: Experiment, run: str, point: Point, window_s: float) -> Acquisition:
    """The run of one twin, as long as `window_s`, single triggers."""
    single, *_ = plan.columns_of(experiment, point.seed)
    protocol = single[run].model_copy(update={"window": window_s})
    return plan.acquisition(protocol, plan.place_of(point.name), dict(point.parameters))


def judged(run: Acquisition, splits: int, windows_s: Sequence[float]) -> list[NDArray[np.float64]] | None:
    """Accuracy (splits,) of one twin, which is acquired first, in each of some windows.

    None where the run ends because its records seem to be dark, or those of other pictures.
    """
    try:
        directory = acquire_run(run).directory
    except WrongRecord:
        return None
    twin = TwinRuns({"run": directory}, {"run": run.protocol}, run.protocol.seed, splits)
    records = twin.records("run")
    ways = twin.random_splits(records)
    return [validate(window_features(records, window_s), records.labels, ways).scores for window_s in windows_s]
