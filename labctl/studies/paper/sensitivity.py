"""What a result rests on: the same run on twins whose parameters are varied one at a time around their defaults."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.analysis.evaluation import cross_validated_accuracy, pooled
from labctl.analysis.windows import WindowFeatures
from labctl.bench.signals import Interruption
from labctl.bench.station import Station
from labctl.engine.session import Acquisition
from labctl.errors import ExperimentError
from labctl.reports.curves import Sensitivity, sensitivity_figure
from labctl.reports.experiments import ExperimentFigure
from labctl.runs.read.records import read_records
from labctl.runs.read.run import open_run
from labctl.studies.paper.experiments import Experiment, Varied
from labctl.studies.paper.experiments import Sensitivity as Study
from labctl.studies.paper.reproduction import Plan, Progress, acquire_run
from labctl.studies.processes import in_parallel


@dataclass(frozen=True)
class Dependence:
    """How the accuracy depends on one parameter: {"mean", "sd"} for each of its values."""

    varied: Varied
    accuracy: list[dict[str, float]]


@dataclass(frozen=True)
class _Point:
    """One run of the study and how it is judged."""

    run: Acquisition
    window_s: float
    splits: int
    seed: int


@dataclass
class _Points:
    """Every run of the study; all defaults are the same runs."""

    points: dict[str, _Point] = field(default_factory=dict)
    names: dict[tuple[str, float], list[str]] = field(default_factory=dict)


def study_of(experiment: Experiment) -> Study:
    """What the experiment's file says to vary.

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
    planned = _points(plan, experiment, study)
    found = in_parallel(
        {name: partial(_judged, point) for name, point in planned.points.items()},
        interruption=interruption,
        progress=lambda done, _steps: progress(done, len(planned.points)),
    )
    return [
        Dependence(
            varied,
            [pooled(found[name][0] for name in planned.names[varied.parameter, value]) for value in varied.values],
        )
        for varied in study.parameters
    ]


def figure_of(study: Study, dependences: Sequence[Dependence]) -> ExperimentFigure:
    """The dependence on every parameter, side by side."""
    panels = [
        Sensitivity(
            found.varied.name,
            found.varied.values,
            [accuracy["mean"] for accuracy in found.accuracy],
            [accuracy["sd"] for accuracy in found.accuracy],
            found.varied.default,
            found.varied.logarithmic,
        )
        for found in dependences
    ]
    caption = "Accuracy against one parameter of the twin at a time; the mark shows what all experiments use."
    figure = sensitivity_figure(panels, window_s=study.window, required=study.required)
    return ExperimentFigure("sensitivity", figure, caption)


def as_json(dependences: Sequence[Dependence]) -> dict[str, Any]:
    """Parameter -> its name, values, accuracies and default."""
    return {
        found.varied.parameter: {
            "name": found.varied.name,
            "values": list(found.varied.values),
            "accuracy": found.accuracy,
            "default": found.varied.default,
        }
        for found in dependences
    }


def _points(plan: Plan, experiment: Experiment, study: Study) -> _Points:
    planned = _Points()
    splits = plan.splits_of(experiment)
    twins = plan.seeds or (study.quick_twins if plan.quick else study.twins)
    for varied in study.parameters:
        for value in varied.values:
            names = planned.names[varied.parameter, value] = []
            for seed in range(1, twins + 1):
                changed = {} if value == varied.default else {varied.parameter: varied.parameter_at(value)}
                name = f"seed-{seed}" + "".join(f"-{key}-{number:g}" for key, number in changed.items())
                names.append(name)
                protocol = experiment.protocols[study.run].model_copy(update={"seed": seed, "window": study.window})
                run = plan.acquisition(protocol, plan.folder / name)
                run = replace(run, station=_changed(run.station, changed))
                planned.points.setdefault(name, _Point(run, study.window, splits, seed))
    return planned


def _changed(station: Station, parameters: dict[str, float]) -> Station:
    return station.model_copy(update={"sim": station.sim.model_copy(update={"parameters": parameters})})


def _judged(point: _Point) -> NDArray[np.float64]:
    with open_run(acquire_run(point.run).directory) as run:
        records = read_records(run)
    window = WindowFeatures(window_s=point.window_s, sample_interval_s=records.sample_interval_s)
    features = window.fit_transform(records.traces)
    return cross_validated_accuracy(features, records.labels, records.groups, splits=point.splits, seed=point.seed)
