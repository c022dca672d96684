"""From what came of an experiment to the table that people read, the JSON that programs read, and the report."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from labctl.experiments import Experiment, Must, found_at, mean_at
from labctl.provenance import git_revision, versions
from labctl.reports.experiments import ExperimentEntry, ExperimentFigure, experiments_report
from labctl.reports.html import Result
from labctl.reproduction.reproducing import Plan, Reproduced


def passed(reproduced: Reproduced) -> bool:
    """Whether every figure that must be reached is."""
    here = reproduced.conclusion.here
    return all(must.reached(here) for must in reproduced.experiment.must)


def as_json(reproduced: Reproduced) -> dict[str, Any]:
    """The entry of one experiment."""
    experiment, conclusion = reproduced.experiment, reproduced.conclusion
    return {
        "name": experiment.name,
        "title": experiment.title,
        "paper": experiment.paper,
        "here": conclusion.here,
        "baseline": conclusion.baseline,
        "must": [
            {
                "what": must.what,
                "paper": must.paper,
                "here": must.figure(conclusion.here),
                "required": bound(must),
                "reached": must.reached(conclusion.here),
                "beside": None
                if must.beside is None
                else {"what": must.beside.what, "figure": mean_at(conclusion.baseline, must.beside.path)},
            }
            for must in experiment.must
        ],
        "seeds": len(reproduced.seeds),
        "splits": reproduced.splits,
        "passed": passed(reproduced),
        "cause": "" if passed(reproduced) else experiment.cause,
        "runs": [str(directory) for directory in reproduced.runs],
        "seconds": round(reproduced.seconds, 1),
    }


def results(reproduced: Reproduced) -> list[Result]:
    """One line for each figure to reach, paper against here."""
    here, baseline = reproduced.conclusion.here, reproduced.conclusion.baseline
    return [
        Result(must.what, must.paper, bound(must), number(must, here), must.reached(here), beside(must, baseline))
        for must in reproduced.experiment.must
    ]


def bound(must: Must) -> str:
    """What must be reached, as text."""
    sign, limit = (">=", must.at_least) if must.at_least is not None else ("<=", must.at_most)
    return f"{sign} {_text(must, limit or 0.0)}"


def number(must: Must, here: dict[str, Any]) -> str:
    """What was reached, with its standard deviation where it has one."""
    if must.minus:
        return _text(must, must.figure(here))
    return _with_spread(must, found_at(here, must.path))


def beside(must: Must, baseline: dict[str, Any]) -> str:
    """What a digital method reaches, by name; empty where there is nothing to compare with."""
    if must.beside is None:
        return ""
    return f"{must.beside.what} {_with_spread(must, found_at(baseline, must.beside.path))}"


def write_report(plan: Plan, everything: Sequence[Reproduced], skipped: dict[str, str]) -> Path:
    """The report of all experiments, in the plan's folder."""
    entries = [
        ExperimentEntry(
            name=found.experiment.name,
            title=found.experiment.title,
            statement=f"Paper: {found.experiment.paper}. {' '.join(found.experiment.statement.split())}",
            results=results(found),
            figures=found.conclusion.figures,
            seeds=found.seeds,
            splits=found.splits,
            seconds=found.seconds,
            settings={
                "runs": {name: run.model_dump() for name, run in found.experiment.runs.items()},
                "analysis": found.experiment.settings,
            },
            notes=(*found.experiment.notes, *found.conclusion.notes),
            cause="" if passed(found) else found.experiment.cause,
        )
        for found in everything
    ]
    return experiments_report(
        plan.folder / "report.html", entries=entries, provenance=_provenance(plan) | {"skipped": skipped}
    )


def write_sensitivity_report(plan: Plan, experiment: Experiment, figure: ExperimentFigure, seconds: float) -> Path:
    """The report of what an experiment's result depends on, in the plan's folder."""
    entry = ExperimentEntry(
        name=experiment.name,
        title=f"{experiment.title}: what it rests on",
        statement="One parameter of the twin at a time is moved away from the value that all experiments use.",
        results=(),
        figures=(figure,),
        splits=plan.splits_of(experiment),
        seconds=seconds,
        settings={"sensitivity": experiment.sensitivity.model_dump() if experiment.sensitivity else {}},
    )
    return experiments_report(
        plan.folder / "report.html", entries=[entry], provenance=_provenance(plan), title="What the result rests on"
    )


def _provenance(plan: Plan) -> dict[str, Any]:
    return {
        "station": plan.station.model_dump(mode="json"),
        "versions": versions(),
        "git_revision": git_revision(),
    }


def _with_spread(must: Must, value: Any) -> str:
    if isinstance(value, dict):
        return f"{_text(must, value['mean'])} ± {_text(must, value['sd'])}"
    return _text(must, float(value))


def _text(must: Must, value: float) -> str:
    return f"{100 * value:.1f} %" if must.percent else f"{value:.3g}"
