"""From what came of an experiment to the table that people read, the JSON that programs read, and the report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labctl.errors import ExperimentError
from labctl.reports.experiments import ExperimentEntry, ExperimentFigure, experiments_report
from labctl.reports.page import Result
from labctl.runs.format.provenance import git_revision, versions
from labctl.studies.paper.analyses import Conclusion
from labctl.studies.paper.experiments import Experiment, Requirement, found_at, mean_at
from labctl.studies.paper.reproduction import Plan, Reproduced


@dataclass(frozen=True)
class Verdict:
    """A figure to reach, and what came out.

    Attributes:
        must: The figure.
        figure: What came out; None if it cannot be found.
        baseline: What a digital method reaches; None if there is nothing to compare with.
        here, beside: The same as text.
        wrong: Why it cannot be judged; empty if it can.
    """

    must: Requirement
    figure: float | None
    baseline: float | None
    here: str
    beside: str
    wrong: str = ""

    @property
    def reached(self) -> bool:
        """Whether it keeps its bound; what cannot be judged does not."""
        return self.figure is not None and self.must.kept(self.figure)


def verdicts(reproduced: Reproduced) -> list[Verdict]:
    """All figures that an experiment must reach; one that its file asks for in vain costs none of the others."""
    return [_verdict(must, reproduced.conclusion) for must in reproduced.experiment.must]


def passed(reproduced: Reproduced) -> bool:
    """Whether every figure that must be reached is."""
    return all(verdict.reached for verdict in verdicts(reproduced))


def cause(reproduced: Reproduced) -> str:
    """Why a figure falls short: what is wrong with the experiment's file, or else what the file says; empty if none."""
    if passed(reproduced):
        return ""
    wrong = [f"{verdict.must.what}: {verdict.wrong}" for verdict in verdicts(reproduced) if verdict.wrong]
    return "; ".join(wrong) or reproduced.experiment.cause


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
                "what": verdict.must.what,
                "paper": verdict.must.paper,
                "here": verdict.figure,
                "required": bound(verdict.must),
                "reached": verdict.reached,
                "beside": None
                if verdict.must.beside is None
                else {"what": verdict.must.beside.what, "figure": verdict.baseline},
            }
            for verdict in verdicts(reproduced)
        ],
        "seeds": len(reproduced.seeds),
        "splits": reproduced.splits,
        "passed": passed(reproduced),
        "cause": cause(reproduced),
        "runs": [str(directory) for directory in reproduced.runs],
        "seconds": round(reproduced.seconds, 1),
    }


def results(reproduced: Reproduced) -> list[Result]:
    """One line for each figure to reach, paper against here."""
    return [
        Result(
            verdict.must.what,
            verdict.must.paper,
            bound(verdict.must),
            verdict.here,
            verdict.reached,
            verdict.beside,
        )
        for verdict in verdicts(reproduced)
    ]


def bound(must: Requirement) -> str:
    """What must be reached, as text."""
    sign, limit = (">=", must.at_least) if must.at_least is not None else ("<=", must.at_most)
    return f"{sign} {_text(must, limit or 0.0)}"


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
            figures=found.conclusion.figures,
            seeds=found.seeds,
            splits=found.splits,
            seconds=found.seconds,
            settings={
                "runs": {name: run.model_dump() for name, run in found.experiment.runs.items()},
                "analysis": found.experiment.settings,
            },
            notes=(*found.experiment.notes, *found.conclusion.notes),
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


def _verdict(must: Requirement, conclusion: Conclusion) -> Verdict:
    here, baseline = conclusion.here, conclusion.baseline
    try:
        return Verdict(
            must,
            must.figure(here),
            None if must.beside is None else mean_at(baseline, must.beside.path),
            _text(must, must.figure(here)) if must.minus else _with_spread(must, found_at(here, must.path)),
            ""
            if must.beside is None
            else f"{must.beside.what} {_with_spread(must, found_at(baseline, must.beside.path))}",
        )
    except ExperimentError as error:
        return Verdict(must, None, None, "none", "", str(error))


def _with_spread(must: Requirement, value: Any) -> str:
    if isinstance(value, dict):
        return f"{_text(must, value['mean'])} ± {_text(must, value['sd'])}"
    return _text(must, float(value))


def _text(must: Requirement, value: float) -> str:
    return f"{100 * value:.1f} %" if must.percent else f"{value:.3g}"
