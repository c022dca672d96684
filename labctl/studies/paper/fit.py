"""The one number of the twin that is fitted: by what the paper says of one curve, on seeds that nothing else uses.

The paper says where accuracy crosses a bound: below it at one acquisition time, above it at a longer one. A value of
the parameter misses that by how much its accuracy is short of the bound at the longer time, and beyond it at the
shorter:

    misfit = max(0, bound - accuracy(longer)) + max(0, accuracy(shorter) - bound)

Fitted is the value of least misfit; its interval are the values whose misfit on the same benches is not greater by more
than chance (Student's t of the differences, bench by bench).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from labctl.analysis.intervals import Statistic, difference, pooled
from labctl.bench.signals import Interruption
from labctl.errors import ExperimentError
from labctl.reports.canvas import Level
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.sensitivity import Sensitivity, sensitivity_figure
from labctl.studies.paper.experiments import Experiment, FitStudy
from labctl.studies.paper.reproduction import Plan, Progress
from labctl.studies.paper.sensitivity import acquisition_of, judged, points_of
from labctl.studies.tasks import in_parallel


@dataclass(frozen=True)
class Tried:
    """One value of the parameter: accuracy at the shorter and the longer time, and how far both miss the paper's."""

    value: float
    shorter: Statistic
    longer: Statistic
    misfit: Statistic


@dataclass(frozen=True)
class Fit:
    """What was tried, value by value; the value of least misfit, and the least and greatest that do not differ.

    bound: the accuracy that the paper's curve crosses between the two times.
    """

    bound: float
    tried: tuple[Tried, ...]
    fitted: float
    interval: tuple[float, float]

    @property
    def reached(self) -> bool:
        """Whether the fitted value is on the paper's side of the bound at both times, by the means of the benches."""
        (best,) = (one for one in self.tried if one.value == self.fitted)
        return bool(best.shorter["mean"] <= self.bound <= best.longer["mean"])


def fit_of(experiment: Experiment) -> FitStudy:
    """What the experiment's file wants fitted.

    Raises:
        ExperimentError: nothing.
    """
    if experiment.fit is None:
        raise ExperimentError(f"experiment {experiment.name} says nothing to fit: --fit is for fig3")
    return experiment.fit


def fit(plan: Plan, experiment: Experiment, *, interruption: Interruption, progress: Progress) -> Fit:
    """Acquire and judge one run a twin for every value of the parameter.

    Raises:
        ExperimentError: the experiment says nothing to fit, the bench is a real one, or no value was measured on all.
        Interrupted: the operator stopped it.
    """
    study = fit_of(experiment)
    if not plan.station.wholly_simulated:
        raise ExperimentError(f"{plan.station.source}: a real bench has no parameters to fit: leave --station out")
    twins = plan.seeds or (experiment.quick_twins if plan.quick else study.twins)
    seeds = range(study.first_seed, study.first_seed + twins)
    points = {value: points_of(study.variation, value, seeds) for value in study.variation.values}
    splits = plan.splits_of(experiment)
    tasks = {
        point: partial(
            judged, acquisition_of(plan, experiment, study.run, point, study.windows[1]), splits, study.windows
        )
        for point in chain.from_iterable(points.values())
    }
    found = in_parallel(
        tasks,
        engine=plan.engine,
        interruption=interruption,
        progress=lambda done, _steps: progress(done, len(tasks)),
    )
    scores = {
        value: [judgement for point in points[value] if (judgement := found[point][0]) is not None]
        for value in study.variation.values
    }
    tried = [_tried(study, value, benches) for value, benches in scores.items() if len(benches) == len(seeds)]
    return concluded(study.accuracy, tried)


def concluded(bound: float, tried: Sequence[Tried]) -> Fit:
    """The value of least misfit, and those that the benches do not tell from it.

    Raises:
        ExperimentError: no value was tried on all benches.
    """
    if not tried:
        raise ExperimentError(
            "no value is left to choose from: on some bench each had a run whose records were doubted; try other values"
        )
    best = min(tried, key=lambda one: float(one.misfit["mean"]))
    alike = [one.value for one in tried if not (difference(one.misfit, best.misfit)["low"] or 0.0) > 0]
    return Fit(bound, tuple(tried), best.value, (min(alike), max(alike)))


def _tried(study: FitStudy, value: float, benches: Sequence[Sequence[Any]]) -> Tried:
    shorter, longer = (pooled([bench[place] for bench in benches]) for place in (0, 1))
    short_of = np.maximum(0, study.accuracy - np.asarray(longer["by_bench"]))
    beyond = np.maximum(0, np.asarray(shorter["by_bench"]) - study.accuracy)
    return Tried(value, shorter, longer, pooled(short_of + beyond))


def figure_of(study: FitStudy, found: Fit) -> ExperimentFigure:
    """Accuracy at both times against the parameter."""
    panels = [
        Sensitivity(
            f"{study.variation.name}; {window * 1e9:g} ns, paper {side} {100 * study.accuracy:g} %",
            [one.value for one in found.tried],
            [statistic["mean"] for statistic in statistics],
            [statistic["se"] or 0.0 for statistic in statistics],
            found.fitted,
            study.variation.logarithmic,
        )
        for window, side, statistics in (
            (study.windows[0], "below", [one.shorter for one in found.tried]),
            (study.windows[1], "above", [one.longer for one in found.tried]),
        )
    ]
    crossed = Level("what the paper crosses", study.accuracy)
    figure = sensitivity_figure(panels, mark="fitted", spread="standard error", required=crossed)
    caption = (
        "Accuracy with standard errors of the mean over benches; dashed: the fitted value; dotted: what the paper's "
        f"curve crosses between both times. {in_words(study, found)}."
    )
    return ExperimentFigure("fit", figure, caption)


def in_words(study: FitStudy, found: Fit) -> str:
    """The fitted value and its interval, which may end only because nothing beyond was tried."""
    low, high = found.interval
    values = [one.value for one in found.tried]
    ends = [f"{end:g}" for end, last in ((low, min(values)), (high, max(values))) if end == last]
    beyond = f"; nothing beyond {' and '.join(ends)} was tried" if ends else ""
    return f"{study.variation.name}: {found.fitted:g}, {low:g} to {high:g} cannot be distinguished from it{beyond}"


def as_json(study: FitStudy, found: Fit) -> dict[str, Any]:
    """The parameter, what was tried, the fitted value and its interval."""
    return {
        "parameter": study.variation.parameter,
        "name": study.variation.name,
        "accuracy": study.accuracy,
        "windows_ns": [window * 1e9 for window in study.windows],
        "tried": [
            {"value": one.value, "shorter": one.shorter, "longer": one.longer, "misfit": one.misfit}
            for one in found.tried
        ],
        "fitted": found.fitted,
        "interval": list(found.interval),
        "fitted_parameter": study.variation.parameter_at(found.fitted),
        "reached": found.reached,
    }
