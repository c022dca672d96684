"""From what came of an experiment to the table that people read, the JSON that programs read, and the report."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from labctl.analysis.intervals import Bound, Statistic, Verdict
from labctl.errors import LabctlError
from labctl.reports.experiments import ExperimentEntry, ExperimentFigure, experiments_report
from labctl.reports.page import Averaged, Result
from labctl.runs.format.provenance import git_revision, versions
from labctl.studies.paper.experiments import Experiment, Requirement, statistic_at
from labctl.studies.paper.reproduction import Column, Plan, Reproduced


@dataclass(frozen=True)
class Judged:
    """A figure of one column, and what it must be; both None where there is none."""

    figure: Statistic | None
    bound: Bound | None

    @property
    def verdict(self) -> Verdict | None:
        """Whether it keeps its bound."""
        return None if self.figure is None or self.bound is None else self.bound.verdict(self.figure)


@dataclass(frozen=True)
class Comparison:
    """A figure to reach, and what came out.

    Attributes:
        must: The figure.
        columns: With single triggers and, where the experiment has it, with the mean of several.
        baseline: What a digital method reaches; None if there is nothing to compare with.
        wrong: Why it cannot be judged; empty if it can.
    """

    must: Requirement
    columns: tuple[Judged, ...]
    baseline: Statistic | None = None
    wrong: str = ""

    @property
    def fell_short(self) -> bool:
        """Whether it is surely not reached in a column; what cannot be judged is not either."""
        return bool(self.wrong) or any(column.verdict is Verdict.NOT_REACHED for column in self.columns)

    @property
    def averages_only(self) -> bool:
        """Whether single triggers do not keep, for sure, what the mean of several does."""
        if len(self.columns) < 2 or self.columns[1].verdict is not Verdict.REACHED:
            return False
        return Judged(self.columns[0].figure, self.columns[1].bound).verdict is not Verdict.REACHED


def comparisons(reproduced: Reproduced) -> list[Comparison]:
    """All figures that an experiment must reach; one that its file asks for in vain costs none of the others."""
    return [_comparison(must, reproduced.columns) for must in reproduced.experiment.must]


def passed(reproduced: Reproduced) -> bool:
    """Whether no figure falls short: each is reached, or open."""
    return not any(found.fell_short for found in comparisons(reproduced))


def verdicts(reproduced: Reproduced) -> list[Verdict]:
    """Those on every figure with a bound, column by column."""
    found = [column.verdict for comparison in comparisons(reproduced) for column in comparison.columns]
    return [verdict for verdict in found if verdict is not None]


def cause(reproduced: Reproduced) -> str:
    """Why a figure falls short: what is wrong with the experiment's file, or else what the file says; empty if none."""
    if passed(reproduced):
        return ""
    wrong = [f"{found.must.what}: {found.wrong}" for found in comparisons(reproduced) if found.wrong]
    return "; ".join(wrong) or reproduced.experiment.cause


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
    """A figure with its interval, if it has one."""
    figure = judged.figure
    if figure is None:
        return "none"
    if figure["low"] is None:
        return _text(must, figure["mean"])
    return f"{_text(must, figure['mean'])} [{_number(must, figure['low'])}, {_number(must, figure['high'])}]"


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
        entries=entries,
        provenance=_provenance(plan) | {"skipped": skipped, "failed": failed},
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


def averages_only(found: Reproduced) -> list[str]:
    """What the mean of several triggers reaches and single ones do not, in words."""
    return [one.must.what for one in comparisons(found) if one.averages_only]


def _comparison(must: Requirement, columns: Sequence[Column]) -> Comparison:
    bounds = (must.bound, must.averaged_bound)[: len(columns)]
    try:
        return Comparison(
            must,
            tuple(
                Judged(must.figure(column.conclusion.here), bound)
                for column, bound in zip(columns, bounds, strict=True)
            ),
            None if must.beside is None else statistic_at(columns[0].conclusion.baseline, must.beside.path),
        )
    except LabctlError as error:
        return Comparison(must, tuple(Judged(None, bound) for bound in bounds), wrong=str(error))


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
    return f"{found.must.beside.what} {_text(found.must, found.baseline['mean'])}{fewer}"


def _repeats(judged: Judged) -> str:
    return "" if judged.figure is None else f"{len(judged.figure['by_bench'])} × {judged.figure['splits']}"  # noqa: RUF001


def _text(must: Requirement, value: float) -> str:
    return _number(must, value) + (" %" if must.percent else "")


def _number(must: Requirement, value: float) -> str:
    return f"{100 * value:.1f}" if must.percent else f"{value:.3g}"
