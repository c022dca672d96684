"""`labctl verify`: is a run still what was measured?"""

from dataclasses import asdict
from typing import Annotated

import typer

from labctl.commands.exit_status import DONE, FELL_SHORT
from labctl.commands.options import RunHereArgument
from labctl.commands.output import JsonOption, say, show
from labctl.runs.verification import RunReport, verify_run


def verify(
    run: RunHereArgument,
    rebuild: Annotated[bool, typer.Option("--rebuild", help="Make data.h5 anew from the shards first.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Check every checksum, count and order of a run; exit 1 if anything is damaged."""
    report = verify_run(run, rebuild=rebuild)
    show({"run": report.path, "intact": report.intact} | _listed(report), as_json, lambda: _print(report))
    return DONE if report.intact else FELL_SHORT


def _listed(report: RunReport) -> dict[str, object]:
    return {name: value for name, value in asdict(report).items() if name != "path"}


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
