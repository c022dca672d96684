"""From what came of an experiment to the table that people read, the JSON that programs read, and the report."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from labctl.analysis.intervals import Verdict
from labctl.reports.experiments import ExperimentEntry, ExperimentFigure, experiments_report
from labctl.reports.page import Averaged, Result
from labctl.runs.format.origin import Origin
from labctl.runs.format.provenance import git_revision, versions
from labctl.studies.paper.experiments import Experiment, Requirement
from labctl.studies.paper.reproduction import Plan, Reproduced
from labctl.studies.paper.verdict import Comparison, Judged, averages_only, cause, comparisons, passed, verdicts
from labctl.studies.processes import side_by_side
from labctl.studies.tasks import one_by_one


def as_json(reproduced: Reproduced) -> dict[str, Any]:
    """The entry of one experiment."""
    experiment, single = reproduced.experiment, reproduced.columns[0].conclusion
    return {
        "name": experiment.name,
        "title": experiment.title,
        "series": experiment.series,
        "paper": experiment.paper,
        "averages": list(experiment.averages),
        "here": single.here,
        "averaged": reproduced.columns[1].conclusion.here if len(reproduced.columns) > 1 else None,
        "baseline": single.baseline,
        "must": [
            {
                "what": found.must.what,
                "paper": found.must.paper,
                **_judged_as_json(found.must, found.columns[0]),
                "averaged": _judged_as_json(found.must, found.columns[1]) if len(found.columns) > 1 else None,
                "averages_only": found.averages_only,
                "beside": None
                if found.must.beside is None
                else {
                    "what": found.must.beside.what,
                    "figure": None if found.baseline is None else found.baseline["mean"],
                },
            }
            for found in comparisons(reproduced)
        ],
        "seeds": len(reproduced.seeds),
        "first_seed": reproduced.seeds[0],
        "splits": reproduced.splits,
        "passed": passed(reproduced),
        "open": verdicts(reproduced).count(Verdict.OPEN),
        "cause": cause(reproduced),
        "runs": [str(directory) for directory in reproduced.runs],
        "seconds": round(reproduced.seconds, 1),
    }


def results(reproduced: Reproduced) -> list[Result]:
    """One line for each figure, paper against here."""
    return [
        Result(
            found.must.what,
            found.must.paper,
            _required(found.must, found.columns[0]),
            figure_text(found.must, found.columns[0]),
            found.columns[0].verdict,
            _beside(found),
            None
            if len(found.columns) < 2
            else Averaged(
                _required(found.must, found.columns[1]),
                figure_text(found.must, found.columns[1]),
                found.columns[1].verdict,
            ),
            _repeats(found.columns[0]),
        )
        for found in comparisons(reproduced)
    ]


def figure_text(must: Requirement, judged: Judged) -> str:
    """A figure with its interval, if it has one; before it how many of how many, if it was counted."""
    figure = judged.figure
    if figure is None:
        return "none"
    counts = f"{figure['right']} of {figure['counted']}: " if "counted" in figure else ""
    if figure["low"] is None:
        return counts + _text(must, figure["mean"])
    ends = f"[{_number(must, figure['low'])}, {_number(must, figure['high'])}]"
    return f"{counts}{_text(must, figure['mean'])} {ends}"


def write_report(
    plan: Plan, everything: Sequence[Reproduced], *, skipped: dict[str, str], failed: dict[str, str]
) -> Path:
    """The report of all experiments, in the plan's folder."""
    entries = [
        ExperimentEntry(
            name=found.experiment.name,
            title=found.experiment.title,
            statement=f"Paper: {found.experiment.paper}. {' '.join(found.experiment.statement.split())}",
            results=results(found),
            origin=Origin.of_runs(found.runs),
            figures=_figures(found),
            seeds=found.seeds,
            splits=found.splits,
            seconds=found.seconds,
            settings={
                "runs": {name: run.model_dump() for name, run in found.experiment.runs.items()},
                "averages": found.experiment.averages,
                "analysis": found.experiment.settings,
            },
            notes=_notes(found),
            cause=cause(found),
        )
        for found in everything
    ]
    return experiments_report(
        plan.folder / "report.html",
        title="The paper's experiments on this bench"
        if all(found.experiment.series == "paper" for found in everything)
        else "Experiments on this bench",
        entries=entries,
        provenance=_provenance(plan) | {"skipped": skipped, "failed": failed},
        carried_out=side_by_side,
    )


def write_sensitivity_report(plan: Plan, experiment: Experiment, figure: ExperimentFigure, seconds: float) -> Path:
    """The report of what an experiment's result depends on, in the plan's folder."""
    entry = ExperimentEntry(
        name=experiment.name,
        title=f"{experiment.title}: what it rests on",
        statement="One parameter of the twin at a time is moved away from the value that all experiments use.",
        results=(),
        origin=Origin.SIMULATED,
        figures=(figure,),
        splits=plan.splits_of(experiment),
        seconds=seconds,
        settings={"sensitivity": experiment.sensitivity.model_dump() if experiment.sensitivity else {}},
    )
    return experiments_report(
        plan.folder / "report.html",
        entries=[entry],
        provenance=_provenance(plan),
        title="What the result rests on",
        carried_out=one_by_one,
    )


def write_fit_report(plan: Plan, experiment: Experiment, figure: ExperimentFigure, seconds: float) -> Path:
    """The report of the one number of the twin that is fitted, in the plan's folder."""
    entry = ExperimentEntry(
        name=experiment.name,
        title=f"{experiment.title}: what is fitted",
        statement="One parameter of the twin is moved until the accuracy crosses what the paper says where it says.",
        results=(),
        origin=Origin.SIMULATED,
        figures=(figure,),
        splits=plan.splits_of(experiment),
        seconds=seconds,
        settings={"fit": experiment.fit.model_dump() if experiment.fit else {}},
    )
    return experiments_report(
        plan.folder / "report.html",
        entries=[entry],
        provenance=_provenance(plan),
        title="The number that is fitted",
        carried_out=one_by_one,
    )


def _provenance(plan: Plan) -> dict[str, Any]:
    return {
        "station": plan.station.model_dump(mode="json"),
        "versions": versions(),
        "git_revision": git_revision(),
    }


def _figures(found: Reproduced) -> tuple[ExperimentFigure, ...]:
    """Those of single triggers, then those of the mean of several, called so."""
    single, *others = (column.conclusion.figures for column in found.columns)
    several = f"The mean of {found.experiment.averages[-1]} triggers. " if others else ""
    return (
        *(replace(figure, caption=f"Single triggers. {figure.caption}") if others else figure for figure in single),
        *(
            replace(figure, stem=f"{figure.stem}-averaged", caption=several + figure.caption)
            for figures in others
            for figure in figures
        ),
    )


def _notes(found: Reproduced) -> tuple[str, ...]:
    """Those of the file and of the analysis, and which figures single triggers do not reach."""
    of_analysis = dict.fromkeys(note for column in found.columns for note in column.conclusion.notes)
    notes = (*found.experiment.notes, *of_analysis)
    if only := averages_only(found):
        notes = (f"Only the mean of {found.experiment.averages[-1]} triggers reaches: {'; '.join(only)}.", *notes)
    return notes


def _judged_as_json(must: Requirement, judged: Judged) -> dict[str, Any]:
    figure, verdict = judged.figure, judged.verdict
    return {
        "here": None if figure is None else figure["mean"],
        "low": None if figure is None else figure["low"],
        "high": None if figure is None else figure["high"],
        "seeds": None if figure is None else len(figure["by_bench"]),
        "splits": None if figure is None else figure["splits"],
        "required": _required(must, judged),
        "verdict": verdict,
        "reached": None if judged.bound is None else verdict is Verdict.REACHED,
    }


def _required(must: Requirement, judged: Judged) -> str:
    return "" if judged.bound is None else f"{judged.bound.sign} {_text(must, judged.bound.limit)}"


def _beside(found: Comparison) -> str:
    """The digital baseline; its number of splits where it is not that of the figure."""
    if found.must.beside is None or found.baseline is None:
        return ""
    figure, splits = found.columns[0].figure, found.baseline["splits"]
    fewer = f" ({splits} splits)" if figure is not None and splits != figure["splits"] else ""
    unit = " %" if found.must.percent else ""
    return f"{found.must.beside.what} {_number(found.must, found.baseline['mean'])}{unit}{fewer}"


def _repeats(judged: Judged) -> str:
    return "" if judged.figure is None else f"{len(judged.figure['by_bench'])} × {judged.figure['splits']}"  # noqa: RUF001


def _text(must: Requirement, value: float) -> str:
    unit = " points" if must.minus or must.difference else " %"
    return _number(must, value) + (unit if must.percent else "")


def _number(must: Requirement, value: float) -> str:
    return f"{100 * value:.1f}" if must.percent else f"{value:.3g}"
