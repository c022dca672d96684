"""`labctl reproduce`: the paper's experiments, compared with the paper's own figures."""

import json
import time
from collections import Counter
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from labctl.analysis.intervals import Verdict
from labctl.bench.signals import UNDER_WAY, interruptible
from labctl.bench.station import read_station
from labctl.commands.access import ArmOption, AttendedOption, access_of
from labctl.commands.exit_status import DONE, FELL_SHORT
from labctl.commands.options import DataOption, FirstSeedOption, StationOption
from labctl.commands.output import JsonOption, say, show, table, tell
from labctl.commands.progress import progress_bar
from labctl.commands.scheduler import LOCAL, SchedulerOption, StoreOption, engine_of
from labctl.errors import StoppedEarly, UsageError, one_line
from labctl.runs.format.durable import not_made, replace_file
from labctl.runs.format.layout import run_name
from labctl.studies.paper.experiments import SERIES, experiments
from labctl.studies.tasks import Interrupted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from labctl.studies.paper.reproduction import Plan, Reproduced


def reproduce(
    context: typer.Context,
    names: Annotated[
        list[str] | None, typer.Argument(help="Experiments; 'all' of the paper (the default), 'beyond' it.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer twins and splits, by the same path.")] = False,
    seeds: Annotated[
        int | None, typer.Option("--seeds", min=1, help="How many seeds, instead of the usual number.")
    ] = None,
    first_seed: FirstSeedOption = 1,
    station: StationOption = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for runs and report; must be new or empty.")] = None,
    data: DataOption = None,
    attended: AttendedOption = False,
    armed: ArmOption = False,
    vary: Annotated[
        bool, typer.Option("--sensitivity", help="Instead, vary the simulated bench and see what the result rests on.")
    ] = False,
    fit: Annotated[
        bool, typer.Option("--fit", help="Instead, fit the simulated bench's one fitted number, on seeds of its own.")
    ] = False,
    scheduler: SchedulerOption = LOCAL,
    store: StoreOption = None,
    as_json: JsonOption = False,
) -> int:
    """Run experiments of the paper, or beyond it, and compare with what must be reached.

    Exit 0 if every figure is reached or open, 1 if one is not reached or an experiment of 'all' had to be skipped.
    """
    if vary and fit:
        raise UsageError("--sensitivity and --fit are two studies: ask for one of them")
    if fit and (said := context.get_parameter_source("first_seed")) is not None and said.name != "DEFAULT":
        raise UsageError("--first-seed: --fit has seeds of its own, which nothing else uses: leave it out")
    wanted = names or ["all"]
    chosen = experiments(wanted)
    engine = engine_of(scheduler, "labctl.studies.paper.report", "labctl.studies.paper.recognition", store=store)
    from labctl.studies.paper.feasibility import check
    from labctl.studies.paper.reproduction import Plan

    by_name = SERIES.keys().isdisjoint(wanted)
    folder = out or Path("runs") / run_name(datetime.now(UTC), "reproduce", " ".join(wanted))
    access = access_of(context, attended=attended, armed=armed)
    plan = Plan(chosen, read_station(station), folder, quick, seeds, first_seed, data, access, engine, store=store)
    problems = check(plan)
    if problems and (by_name or len(problems) == len(chosen)):
        raise next(iter(problems.values()))
    skipped = {name: one_line(error) for name, error in problems.items()}
    for name, why in skipped.items():
        tell(f"{name} is skipped: {why}")
    plan = replace(plan, experiments=tuple(found for found in chosen if found.name not in skipped))
    try:
        if vary:
            return _vary(plan, as_json)
        if fit:
            return _fit(plan, as_json)
        return _reproduce(plan, skipped, as_json, alone=by_name and len(wanted) == 1)
    except Interrupted:
        where = store or folder
        raise StoppedEarly(f"interrupted: the finished runs are in {where}, the bench is in the safe state") from None


def _reproduce(plan: "Plan", skipped: dict[str, str], as_json: bool, *, alone: bool) -> int:
    from labctl.studies.paper import report
    from labctl.studies.paper.reproduction import ONE_BENCH
    from labctl.studies.paper.reproduction import reproduce as carry_out

    began = time.perf_counter()
    with interruptible(UNDER_WAY) as interruption, progress_bar("reproduce") as progress:
        everything, failures = carry_out(
            plan, interruption=interruption, progress=progress.progress, uploading=progress.uploading
        )
    if not everything:
        raise next(iter(failures.values()))
    failed = {name: one_line(error) for name, error in failures.items()}
    for name, why in failed.items():
        tell(f"{name} failed: {why}")
    path = report.write_report(plan, everything, skipped=skipped, failed=failed)
    entries = [report.as_json(found) | {"benches": plan.benches_of(found.experiment)} for found in everything]
    without = {"skipped": skipped, "failed": failed}
    entries += [{"name": name, word: why, "passed": False} for word in without for name, why in without[word].items()]
    whole: dict[str, Any] = {
        "experiments": entries,
        "passed": all(entry["passed"] for entry in entries),
        "open": sum(found["open"] for found in entries if "open" in found),
        "seconds": round(time.perf_counter() - began, 1),
        "report": str(path),
    }
    _keep(plan.folder, whole)
    show(
        entries[0] | {"report": str(path)} if alone else whole,
        as_json,
        lambda: _print(whole, everything, without),
    )
    if not as_json and any(entry.get("benches", 1) < entry.get("seeds", 1) for entry in entries):
        say(ONE_BENCH)
    return DONE if whole["passed"] else FELL_SHORT


def _vary(plan: "Plan", as_json: bool) -> int:
    from labctl.studies.paper.report import write_sensitivity_report
    from labctl.studies.paper.sensitivity import as_json as described
    from labctl.studies.paper.sensitivity import figure_of, sensitivity, study_of

    if len(plan.experiments) != 1:
        raise UsageError("--sensitivity is for one experiment: name it, as in 'labctl reproduce fig3 --sensitivity'")
    began = time.perf_counter()
    experiment = plan.experiments[0]
    study = study_of(experiment)
    with interruptible(UNDER_WAY) as interruption, progress_bar("sensitivity") as progress:
        found = sensitivity(plan, experiment, interruption=interruption, progress=progress.progress)
    seconds = round(time.perf_counter() - began, 1)
    report = write_sensitivity_report(plan, experiment, figure_of(study, found), seconds)
    result = {
        "name": experiment.name,
        "window_ns": study.window * 1e9,
        "sensitivity": described(found),
        "seconds": seconds,
        "report": str(report),
    }
    _keep(plan.folder, result)
    show(result, as_json, lambda: _print_dependence(result))
    return DONE


def _fit(plan: "Plan", as_json: bool) -> int:
    from labctl.studies.paper.fit import as_json as described
    from labctl.studies.paper.fit import figure_of, fit_of, in_words
    from labctl.studies.paper.fit import fit as carry_out
    from labctl.studies.paper.report import write_fit_report

    if len(plan.experiments) != 1:
        raise UsageError("--fit is for one experiment: name it, as in 'labctl reproduce fig3 --fit'")
    began = time.perf_counter()
    experiment = plan.experiments[0]
    study = fit_of(experiment)
    with interruptible(UNDER_WAY) as interruption, progress_bar("fit") as progress:
        found = carry_out(plan, experiment, interruption=interruption, progress=progress.progress)
    seconds = round(time.perf_counter() - began, 1)
    report = write_fit_report(plan, experiment, figure_of(study, found), seconds)
    result = {
        "name": experiment.name,
        "fit": described(study, found),
        "seconds": seconds,
        "report": str(report),
    }
    _keep(plan.folder, result)
    show(result, as_json, lambda: _print_fit(result, in_words(study, found)))
    return DONE


def _print_fit(result: dict[str, Any], fitted: str) -> None:
    fit = result["fit"]
    shorter, longer = (f"accuracy at {window:g} ns" for window in fit["windows_ns"])
    table(
        (fit["name"], shorter, longer, "misfit"),
        [
            (
                f"{one['value']:g}" + (" (fitted)" if one["value"] == fit["fitted"] else ""),
                *(f"{one[name]['mean']:.3f} ± {one[name]['se'] or 0:.3f}" for name in ("shorter", "longer", "misfit")),
            )
            for one in fit["tried"]
        ],
    )
    say(fitted)
    if not fit["reached"]:
        say(f"No value reaches the paper's curve: below {fit['accuracy']:g} at the first time, above at the second.")
    say(f"{result['seconds']:.0f} s; report: {result['report']}")


def _keep(folder: Path, result: dict[str, Any]) -> None:
    replace_file(folder / "report.json", (json.dumps(result, indent=2, allow_nan=False) + "\n").encode(), not_made)


def _print_dependence(result: dict[str, Any]) -> None:
    rows = [
        (
            one["name"] if place == 0 else "",
            f"{value:g}" + (" (default)" if value == one["default"] else ""),
            f"{accuracy['mean']:.3f} ± {accuracy['sd']:.3f}" if accuracy else "ended: its records were doubted",
        )
        for one in result["sensitivity"].values()
        for place, (value, accuracy) in enumerate(zip(one["values"], one["accuracy"], strict=True))
    ]
    table(("parameter", "value", f"accuracy at {result['window_ns']:g} ns"), rows)
    say(f"{result['seconds']:.0f} s; report: {result['report']}")


def _rows(found: "Reproduced") -> list[tuple[str, ...]]:
    from labctl.studies.paper.report import results

    rows: list[tuple[str, ...]] = []
    for place, result in enumerate(results(found)):
        name, seconds = (found.experiment.name, f"{found.seconds:.0f}") if place == 0 else ("", "")
        columns = [
            (one.here, one.required, _word(one.verdict)) if one else ("", "", "") for one in (result, result.averaged)
        ]
        rows.append(
            (name, result.name, result.paper, *columns[0], *columns[1], result.baseline, result.repeats, seconds)
        )
    return rows


def _word(verdict: Verdict | None) -> str:
    """What is not reached stands out."""
    return {None: "", Verdict.NOT_REACHED: "NOT REACHED"}.get(verdict, str(verdict))


def _print(whole: dict[str, Any], everything: "Sequence[Reproduced]", without: dict[str, dict[str, str]]) -> None:
    from labctl.studies.paper.verdict import averages_only, verdicts

    column = ("must reach", "verdict")
    first = "single triggers" if any(len(found.columns) > 1 for found in everything) else "here"
    headings = ("experiment", "figure", "paper", first, *column, "mean of several", *column)
    table(
        (*headings, "digital baseline", "seeds x splits", "seconds of work"),
        [
            *(row for found in everything for row in _rows(found)),
            *((name, why, *[""] * 7, word, "", "") for word in without for name, why in without[word].items()),
        ],
    )
    say(
        "Means over seeds and, in brackets, their 95 % intervals; seeds share part of their data, so these say less of "
        "other data. Open: the interval holds what must be reached."
        if any(len(found.seeds) > 1 for found in everything)
        else "Figures of one seed have no interval. Open: one seed does not decide what must be reached."
    )
    for found in everything:
        for what in averages_only(found):
            say(
                f"{found.experiment.name}, {what}: reached by the mean of {found.experiment.averages[-1]} triggers only"
            )
    for entry in whole["experiments"]:
        if entry.get("cause"):
            say(f"{entry['name']} falls short: {' '.join(entry['cause'].split())}")
    counts = Counter(verdict for found in everything for verdict in verdicts(found))
    said = ", ".join(f"{counts[verdict]} {_word(verdict)}" for verdict in Verdict)
    say(f"{counts.total()} figures: {said}; {whole['seconds']:.0f} s in all")
    say(f"report: {whole['report']}")
