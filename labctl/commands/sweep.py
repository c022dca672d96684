"""`labctl sweep`: a protocol over settings of itself and of the bench."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from instruments.bench import Observer
from labctl.bench.opening import Access
from labctl.bench.signals import interruptible
from labctl.bench.station import Station, read_station
from labctl.commands.access import ArmOption, AttendedOption, access_of
from labctl.commands.exit_status import DONE, INTERRUPTED
from labctl.commands.next_steps import options_again, resume_command
from labctl.commands.options import DataOption, NoteOption, OperatorOption, StarOption, StationOption, TagsOption
from labctl.commands.output import JsonOption, say, show, table, tell
from labctl.commands.progress import progress_bar
from labctl.commands.scheduler import LOCAL, SideBySideOption, StoreOption, engine_of
from labctl.errors import UsageError, WrongPlace
from labctl.printable import typed_path
from labctl.runs.said import Said
from labctl.runs.sweep import Sweep, read_to_go_on
from labctl.runs.sweep_axes import Order, parse_axis
from labctl.studies.sweeps import folder
from labctl.studies.sweeps.declaration import Point, declared, points, read_sweep, refuse_set_twice
from labctl.studies.sweeps.run_folder import runs_of
from protocols.base import Judgement, Measurement
from protocols.registry import named_protocol, protocol_class

if TYPE_CHECKING:
    from labctl.studies.tasks import Engine


def sweep(
    context: typer.Context,
    subject: Annotated[
        str,
        typer.Argument(
            metavar="PROTOCOL|FILE", help="Name of a protocol, a Python file that defines one, or a sweep file (TOML)."
        ),
    ],
    over: Annotated[
        list[str] | None,
        typer.Option("--over", help='An axis: "window=0.4 ns,1 ns" or "power=3:30:7 mW"; may be repeated.'),
    ] = None,
    side_by_side: Annotated[bool, typer.Option("--zip", help="Vary axes together, not in every combination.")] = False,
    order: Annotated[
        Order | None, typer.Option("--order", help="Order in which points are measured; default random.")
    ] = None,
    reference_every: Annotated[
        int | None,
        typer.Option(
            "--reference-every", min=0, help="Measure the first point again after so many others; default 10, 0: never."
        ),
    ] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value; may be repeated.")] = None,
    station: StationOption = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder of the sweep; must be new or empty.")] = None,
    data: DataOption = None,
    attended: AttendedOption = False,
    armed: ArmOption = False,
    note: NoteOption = "",
    tags: TagsOption = None,
    star: StarOption = False,
    operator: OperatorOption = None,
    scheduler: SideBySideOption = None,
    store: StoreOption = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be done; open nothing.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Carry out a protocol at every point of one or several axes; each point is a run, with the same notes."""
    asked, protocol = _asked(subject, over or [], settings or [], side_by_side, order, reference_every)
    bench = read_station(station)
    if station is None:
        bench = bench.cabled(projector=protocol.projector)
    every = points(asked, protocol, bench)
    said = Said(note=note, tags=tuple(tags or ()), star=star, operator=operator)
    directory = out or folder.new_directory(every[0].protocol, datetime.now(UTC))
    access = access_of(context, attended=attended, armed=armed)
    if store is not None:
        if not bench.wholly_simulated:
            raise UsageError(f"--store = {store}: runs of a real bench are measured into --out: leave --store out")
        scheduler = scheduler or LOCAL
    if scheduler is not None:
        folder.require_simulated(every)
    engine = None if scheduler is None else engine_of(scheduler, store=store)
    plan = _plan(every, directory, data, access)
    if dry_run:
        show(plan, as_json, lambda: _print_plan(plan))
        return DONE
    if store is not None:
        folder.refuse_others(every, store, data=data, access=access)
    folder.begin(directory, asked, protocol, bench, said, store)
    tell(_in_words(plan))
    return measure(
        directory,
        every,
        options=options_again(attended=attended, armed=armed, data=data, scheduler=scheduler),
        access=access,
        data=data,
        engine=engine,
        kept=_kept(scheduler, store),
        as_json=as_json,
    )


def go_on(
    directory: Path,
    station: Station | None,
    *,
    options: str,
    access: Access,
    data: Path | None,
    scheduler: str | None,
    as_json: bool,
) -> int:
    """Go on with a sweep where it ended: `labctl resume`."""
    file = read_to_go_on(directory)
    store = None
    if file.store:
        scheduler, store = scheduler or LOCAL, runs_of(directory, file)
    protocol = folder.protocol_of(directory, file)
    every = points(file.sweep, protocol, folder.station_of(directory, file, protocol, station))
    engine = None if scheduler is None else engine_of(scheduler, store=store)
    return measure(
        directory,
        every,
        options=options,
        access=access,
        data=data,
        engine=engine,
        kept=_kept(scheduler, store),
        as_json=as_json,
    )


def measure(
    directory: Path,
    every: list[Point],
    *,
    options: str,
    access: Access,
    data: Path | None,
    as_json: bool,
    engine: "Engine | None",
    kept: str,
) -> int:
    """Carry out what a sweep lacks, one run after the other or side by side by `engine`, and say how far it is.

    kept: what stays if it ends early, in words.
    """
    command = resume_command(directory, options)
    noting = _noting(f"the sweep can go on: {command}") if access.wire.replay is None else nullcontext()
    with interruptible() as interruption, noting:
        if engine is None:
            found = folder.carry_out(
                directory, every, data=data, access=access, interruption=interruption, follow=_follow
            )
        else:
            with progress_bar("sweep") as progress:
                found = folder.carry_out_side_by_side(
                    directory,
                    every,
                    engine=engine,
                    data=data,
                    access=access,
                    interruption=interruption,
                    progress=progress.progress,
                )
    whole = found.complete == found.runs
    judged = all(point.protocol.judgement is Judgement.READOUT for point in every)
    look = f"labctl {'evaluate' if judged else 'runs'} {typed_path(directory)}"
    result = {
        "sweep": str(directory),
        "runs": found.runs,
        "complete": found.complete,
        "measured": found.measured,
        "next": look if whole else command,
    }
    show(result, as_json, lambda: _print(result, kept))
    return DONE if whole else INTERRUPTED


@contextmanager
def _noting(note: str) -> Iterator[None]:
    try:
        yield
    except BaseException as error:
        if not isinstance(error, WrongPlace):
            error.add_note(note)
        raise


@contextmanager
def _follow(number: int, count: int, point: Point) -> Iterator[Observer]:
    with progress_bar(f"{number} of {count}: {point.name}") as progress:
        yield progress


def _asked(
    subject: str,
    over: list[str],
    settings: list[str],
    side_by_side: bool,
    order: Order | None,
    reference_every: int | None,
) -> tuple[Sweep, type[Measurement[Any]]]:
    axes, changed = dict(parse_axis(one) for one in over), dict(_setting(one) for one in settings)
    if len(axes) < len(over):
        raise UsageError("--over: an axis is there twice: give each once, with all its values")
    others = (
        ({"zip": True} if side_by_side else {})
        | ({} if order is None else {"order": order})
        | ({} if reference_every is None else {"reference_every": reference_every})
    )
    if subject.endswith(".toml"):
        found = read_sweep(Path(subject), over=axes, settings=changed, others=others)
        protocol = protocol_class(found.protocol)
    else:
        protocol = named_protocol(subject)
        if not axes:
            raise UsageError('--over is missing: say what is to be varied, such as --over "window=0.4 ns,1 ns"')
        found = declared({"protocol": protocol.name, "over": axes, "settings": changed} | others, subject)
    refuse_set_twice(found)
    return found, protocol


def _setting(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not equals:
        raise UsageError(f"--set {text}: write it as key=value")
    return key.strip(), value.strip()


def _plan(every: list[Point], directory: Path, data: Path | None, access: Access) -> dict[str, Any]:
    """What the whole will do, from what each run will: refused here is refused before there is light."""
    each = list(folder.forecasts(every, data=data, access=access))
    return {
        "sweep": str(directory),
        "runs": len(every),
        "points": [{"run": point.name, **point.values} for point in every],
        "shots": sum(one["shots"] for one in each),
        "estimated_seconds_on_a_real_bench": sum(one["estimated_seconds_on_a_real_bench"] for one in each),
        "dose_j": sum(one["dose_j"] for one in each),
        "bytes_needed": sum(one["bytes_needed"] for one in each),
        "armed": all(one["armed"] for one in each),
    }


def _in_words(plan: dict[str, Any]) -> str:
    minutes = plan["estimated_seconds_on_a_real_bench"] / 60
    return (
        f"{plan['runs']} runs, {plan['shots']} shots: {minutes:.1f} min on a real bench, "
        f"{plan['dose_j']:.3g} J of light at most, {1e-6 * plan['bytes_needed']:.1f} MB on disk"
    )


def _print_plan(plan: dict[str, Any]) -> None:
    headings = list(plan["points"][0])
    table(headings, ([point[heading] for heading in headings] for point in plan["points"]))
    say(_in_words(plan))


def _kept(scheduler: str | None, store: object) -> str:
    """What stays of a sweep that ends early: of a run that is not measured in its place, nothing."""
    in_place = scheduler in (None, LOCAL) and not store
    return "the finished shots are kept" if in_place else "the finished runs are kept, those under way begin anew"


def _print(result: dict[str, Any], kept: str) -> None:
    say(f"{result['sweep']}: {result['complete']} of {result['runs']} runs complete, {result['measured']} measured now")
    if result["complete"] < result["runs"]:
        say(f"interrupted: {kept}, the bench is in the safe state")
    say(f"next: {result['next']}")
