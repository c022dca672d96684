"""`labctl align`: measure what a bench must have before its first run, and keep it as its calibration."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from labctl.bench.lock import held
from labctl.bench.signals import interruptible
from labctl.bench.station import read_station
from labctl.commands.access import ArmOption, AttendedOption, access_of
from labctl.commands.beside import Beside, past_the_buffer
from labctl.commands.exit_status import DONE, FELL_SHORT
from labctl.commands.options import StationOption
from labctl.commands.output import JsonOption, errors, say, show
from labctl.errors import StoppedEarly
from labctl.studies.alignment.findings import COVERAGE, Finding


def align(
    context: typer.Context,
    station: StationOption = None,
    out: Annotated[Path | None, typer.Option("--out", help="Directory for it; must be new or empty.")] = None,
    armed: ArmOption = False,
    attended: AttendedOption = False,
    as_json: JsonOption = False,
) -> int:
    """Measure dark levels, ranges, repeatability, contrast, trigger-to-light delay, drive depth and decorrelation.

    Each step prints what it found, with its uncertainty, and what to do if it is not good.
    """
    beside = Beside(errors if as_json else Console(file=past_the_buffer("stdout"), highlight=False, emoji=False))

    def show_finding(finding: Finding) -> None:
        beside.tell(finding.line())

    bench, access = read_station(station), access_of(context, attended=attended, armed=armed)
    with (
        interruptible("this step") as interruption,
        beside.writing(),
        held(bench, "labctl align", access.wire) as hold,
    ):
        from labctl.studies.alignment import alignment  # takes longer to load than to say that another has the bench

        aligned = alignment.align_bench(
            bench,
            access,
            hold,
            directory=out,
            interruption=interruption,
            tell=show_finding,
        )
    if aligned is None:
        raise StoppedEarly(
            "interrupted: the bench is in the safe state, and no calibration is written: begin again, in a new folder"
        )
    short = sum(not finding.good for finding in aligned.findings)
    result: dict[str, Any] = {
        "good": aligned.good,
        "findings": [finding.values() for finding in aligned.findings],
        "directory": str(aligned.directory),
        "calibration": None if aligned.calibration is None else str(aligned.calibration),
        "report": str(aligned.report),
    }

    def as_text() -> None:
        verdict = "all good" if aligned.good else f"{short} of {len(aligned.findings)} to look at"
        say(f"{verdict}; uncertainties are {COVERAGE:g} standard deviations")
        if aligned.calibration is not None:
            named = "calibration" if aligned.good else "calibration, not good, of which runs will warn"
            say(f"{named}: {aligned.calibration}")
        elif access.wire.replay is not None:
            say("no calibration: a recording answered, and says nothing of the bench as it is now")
        say(f"report: {aligned.report}")

    show(result, as_json, as_text)
    return DONE if aligned.good else FELL_SHORT
