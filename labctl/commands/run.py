"""`labctl run`: one acquisition."""

from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from instruments.bench import Observers
from instruments.units import DIGITS
from labctl.bench.signals import interruptible
from labctl.bench.station import read_station
from labctl.commands.access import ArmOption, AttendedOption, access_of
from labctl.commands.exit_status import DONE, INTERRUPTED
from labctl.commands.options import DataOption, NoteOption, OperatorOption, StarOption, StationOption, TagsOption
from labctl.commands.output import JsonOption, say, show, table
from labctl.commands.progress import progress_bar
from labctl.errors import UsageError
from labctl.runs.said import Said, Saying
from protocols.registry import protocol_names, read_protocol

if TYPE_CHECKING:
    from labctl.engine.engine import Outcome


def run(
    context: typer.Context,
    protocol: Annotated[
        str | None,
        typer.Argument(help="Name of a protocol, or a file: TOML with settings, or Python that defines one."),
    ] = None,
    station: StationOption = None,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value; may be repeated.")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Run directory; must be new or empty.")] = None,
    data: DataOption = None,
    attended: AttendedOption = False,
    armed: ArmOption = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be done; open nothing.")] = False,
    note: NoteOption = "",
    tags: TagsOption = None,
    star: StarOption = False,
    operator: OperatorOption = None,
    profile: Annotated[bool, typer.Option("--profile", help="Print where the time of a shot goes.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Carry out a protocol and store the run."""
    if protocol is None:
        names = ", ".join(protocol_names())
        raise UsageError(f"Missing argument 'protocol': choose one of {names}, or name a protocol file")
    asked = read_protocol(protocol, settings or [])
    found = read_station(station)
    if station is None:
        found = found.cabled(projector=asked.projector)
    access = access_of(context, attended=attended, armed=armed)

    from labctl.commands.next_steps import options_again, resumable  # what is loaded from here on takes long
    from labctl.engine.plan import new_directory
    from labctl.engine.session import Acquisition, acquire

    directory = out or new_directory(asked, datetime.now(UTC))
    acquisition = Acquisition(asked, found, directory, data, access, profile)
    saying = Saying(Said(note=note, tags=tuple(tags or ()), star=star, operator=operator))
    if dry_run:
        from labctl.engine.forecast import forecast

        plan = forecast(acquisition)
        show(plan, as_json, lambda: table(("what", "value"), _for_people(plan)))
        return DONE
    options = options_again(attended=attended, armed=armed, data=data)
    with interruptible() as interruption, resumable(directory, options), progress_bar(asked.name) as progress:
        acquired = acquire(acquisition, observer=Observers(progress, saying), interruption=interruption)
    result = describe(acquired.outcome, options) | ({"profile_ms_per_shot": acquired.budget} if acquired.budget else {})
    show(result, as_json, lambda: print_outcome(result))
    return DONE if acquired.outcome.complete else INTERRUPTED


def _for_people(plan: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The plan with units; a person is told no digest."""
    with_units: dict[str, tuple[str, Callable[[Any], str]]] = {
        "wavelengths_nm": ("wavelengths", lambda found: f"{', '.join(f'{one:{DIGITS}}' for one in found)} nm"),
        "laser_power_w": ("laser power", lambda found: f"{1e3 * found:g} mW"),
        "estimated_seconds_on_a_real_bench": ("time on a real bench", lambda found: f"{found:.0f} s"),
        "dose_j": ("light in that time", lambda found: f"{found:.3g} J at most"),
        "armed": ("laser armed", lambda found: "yes" if found else "no"),
        "bytes_needed": ("on disk", lambda found: f"{1e-6 * found:.1f} MB"),
        "ports": ("ports", lambda found: "; ".join(", ".join(map(str, one)) for one in found)),
    }
    rows = []
    for key, value in plan.items():
        if key != "digest":
            title, written = with_units.get(key, (key, str))
            rows.append((title, written(value)))
    return rows


def describe(outcome: "Outcome", options: str) -> dict[str, Any]:
    """What is printed of a run that was carried out or resumed; `options` are those that going on with it needs."""
    from labctl.commands.next_steps import is_replayed, next_command, resume_command
    from labctl.runs.read.run import open_run

    with open_run(outcome.directory) as stored:
        digest = stored.digest()
        ports = list(stored.ports)
        records = {"records": sum(stored.done), "records_planned": stored.shape.shots * len(stored.shape.passes)}
    goes_on = not outcome.complete and not is_replayed(outcome.directory)
    following = resume_command(outcome.directory, options) if goes_on else next_command(outcome.directory)
    return {
        "run": str(outcome.directory),
        "shots": outcome.shots,
        "measured": outcome.measured,
        "complete": outcome.complete,
        **records,
        "ports": ports,
        "frames_sha256": digest,
        "clipped": outcome.clipped,
        "recovered": outcome.recovered,
        "seconds": round(outcome.seconds, 3),
        "shots_per_second": round(outcome.shots_per_second, 1),
        "bench_seconds": round(outcome.bench_seconds, 3),
        "simulated": outcome.simulated,
        "next": following,
    }


def print_outcome(result: dict[str, Any]) -> None:
    """Print what `describe` says, for people."""
    from labctl.commands.next_steps import is_replayed

    resumed = f", {result['measured']} of them now" if result["measured"] < result["shots"] else ""
    ports = ", ".join(map(str, dict.fromkeys(result["ports"])))
    say(f"{result['run']}: {result['shots']} shots on ports {ports}{resumed}")
    if not result["complete"]:
        say(f"{result['records']} of {result['records_planned']} records on disk; a shot is whole with its last pass")
    timed = result["simulated"] and not is_replayed(Path(result["run"]))  # a recording has no clock of a bench
    real = f"; a real bench needs about {result['bench_seconds']:.0f} s" if timed else ""
    say(f"{result['seconds']:.1f} s, {result['shots_per_second']:.0f} shots/s{real}")
    if result["clipped"]:
        say(f"{result['clipped']} records touch the end of the vertical range")
    if result["recovered"]:
        say(f"lost links after which the run went on: {result['recovered']} (see the lines with ! in commands.log)")
    if not result["complete"]:
        say("interrupted: the finished shots are kept, the bench is in the safe state")
    say(f"next: {result['next']}")
    if "profile_ms_per_shot" in result:
        budget = result["profile_ms_per_shot"].items()
        table(("step", "ms a shot"), ((step.replace("_", " "), f"{ms:.3f}") for step, ms in budget))
