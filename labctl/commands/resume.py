"""`labctl resume`: go on with a run that ended early."""

from pathlib import Path
from typing import Annotated

import typer

from labctl.bench.signals import interruptible
from labctl.bench.station import read_station
from labctl.commands import sweep
from labctl.commands.access import ArmOption, AttendedOption, access_of
from labctl.commands.exit_status import DONE, INTERRUPTED, WRONG_USE
from labctl.commands.next_steps import options_again, resumable
from labctl.commands.options import DataOption
from labctl.commands.output import JsonOption, say, show, table, warn
from labctl.commands.progress import progress_bar
from labctl.commands.run import describe, print_outcome
from labctl.commands.scheduler import SideBySideOption
from labctl.engine import session
from labctl.engine.resume import SettingsChanged
from labctl.engine.session import Resumption
from labctl.errors import UsageError
from labctl.runs.format.store import here
from labctl.runs.sweep import is_sweep


def resume(
    context: typer.Context,
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run directory, or the folder of a sweep.", parser=here)],
    station: Annotated[
        Path | None, typer.Option("--station", help="Station file of this bench; else the one it was begun with here.")
    ] = None,
    data: DataOption = None,
    attended: AttendedOption = False,
    armed: ArmOption = False,
    scheduler: SideBySideOption = None,
    as_json: JsonOption = False,
) -> int:
    """Go on with a run at its first missing shot, with the settings and seeds it was begun with; or with a sweep."""
    access = access_of(context, attended=attended, armed=armed)
    named = None if station is None else read_station(station)
    options = options_again(attended=attended, armed=armed, data=data, station=station, scheduler=scheduler)
    if is_sweep(run):
        return sweep.go_on(run, named, options=options, access=access, data=data, scheduler=scheduler, as_json=as_json)
    if scheduler is not None:
        raise UsageError("--scheduler is for sweeps: a run is measured by one machine: leave it out")
    resumption = Resumption(run, named, data, access)
    try:
        with interruptible() as interruption, resumable(run, options), progress_bar("resume") as progress:
            outcome = session.resume(resumption, observer=progress, interruption=interruption)
    except SettingsChanged as changed:
        return _refuse(changed, as_json)
    result = describe(outcome, options)
    nothing_to_do = outcome.complete and not outcome.measured
    show(result, as_json, lambda: say(f"{run}: complete already") if nothing_to_do else print_outcome(result))
    return DONE if outcome.complete else INTERRUPTED


def _refuse(changed: SettingsChanged, as_json: bool) -> int:
    rows = [vars(difference) for difference in changed.differences]
    warn(str(changed))
    show(
        {"error": str(changed), "exit": WRONG_USE, "differences": rows},
        as_json,
        lambda: table(("setting", "then", "now"), (tuple(row.values()) for row in rows)),
    )
    return WRONG_USE
