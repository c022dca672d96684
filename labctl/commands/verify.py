"""`labctl verify`: is a run, or each run of a sweep, still what was measured?"""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from labctl.commands.exit_status import DONE, FELL_SHORT
from labctl.commands.output import JsonOption, say, show
from labctl.runs.format.store import here
from labctl.runs.sweep import is_sweep, places, read
from labctl.runs.verification import RunReport, verify_run
from labctl.studies.sweeps.run_folder import begun, runs_of


def verify(
    subject: Annotated[
        Path,
        typer.Argument(
            metavar="RUN|SWEEP", help="Run directory, or the folder of a sweep for all its runs.", parser=here
        ),
    ],
    rebuild: Annotated[bool, typer.Option("--rebuild", help="Make data.h5 anew from the shards first.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Check every checksum, count and order of a run, or of each run of a sweep; exit 1 if anything is damaged."""
    if is_sweep(subject):
        return _verify_sweep(subject, rebuild, as_json)
    report = verify_run(subject, rebuild=rebuild)
    show(_listed(report), as_json, lambda: _print(report))
    return DONE if report.intact else FELL_SHORT


def _verify_sweep(sweep: Path, rebuild: bool, as_json: bool) -> int:
    file = read(sweep)
    folder = here(str(runs_of(sweep, file)))
    planned = len(places(file.sweep))
    reports = [verify_run(folder / name, rebuild=rebuild) for name in begun(sweep, file)]
    intact = all(report.intact for report in reports)
    found = {"sweep": str(sweep), "intact": intact, "planned": planned, "runs": [_listed(one) for one in reports]}

    def tell() -> None:
        for report in reports:
            _print(report)
        say(f"{sweep}: {'intact' if intact else 'DAMAGED'}: {len(reports)} of {planned} runs have begun")

    show(found, as_json, tell)
    return DONE if intact else FELL_SHORT


def _listed(report: RunReport) -> dict[str, Any]:
    values = asdict(report)
    return {"run": values.pop("path"), "intact": report.intact, **values}


def _print(report: RunReport) -> None:
    whole = "complete" if report.complete else "incomplete"
    state = f"{whole}, intact" if report.intact else "DAMAGED"
    say(f"{report.path}: {state}: {report.shots} of {report.planned} shots in {report.shards} shards")
    say(f"data.h5: {report.data_file}")
    if report.damaged is not None:
        first, last = report.damaged.first, report.damaged.last
        say(f"first damaged: {report.damaged.file}{' is missing' if last is None else f', bytes {first} to {last}'}")
    for line in (*report.problems, *report.notes):
        say(line)
