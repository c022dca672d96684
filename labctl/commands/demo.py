"""`labctl demo`: the main experiment of the paper on simulated benches."""

from pathlib import Path
from typing import Annotated, Any

import typer

from labctl.bench.signals import UNDER_WAY, interruptible
from labctl.bench.station import SIMULATED_STATION
from labctl.commands.access import access_of
from labctl.commands.exit_status import DONE
from labctl.commands.options import FirstSeedOption
from labctl.commands.output import JsonOption, say, show, table
from labctl.commands.progress import progress_bar
from labctl.commands.scheduler import LOCAL, SchedulerOption, StoreOption, engine_of
from labctl.errors import StoppedEarly


def demo(
    context: typer.Context,
    first_seed: FirstSeedOption = 1,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the runs; default runs/.")] = None,
    scheduler: SchedulerOption = LOCAL,
    store: StoreOption = None,
    as_json: JsonOption = False,
) -> int:
    """Run the paper's image recognition on simulated benches: acquire, train, evaluate, report."""
    engine = engine_of(scheduler, "labctl.studies.demonstration", store=store)
    from labctl.studies.demonstration import demonstrate
    from labctl.studies.paper.experiments import experiments
    from labctl.studies.paper.reproduction import Plan

    (experiment,) = experiments(["demonstration"])
    with interruptible(UNDER_WAY) as interruption, progress_bar("demo") as progress:
        plan = Plan(
            (experiment,),
            SIMULATED_STATION,
            out or Path("runs"),
            first_seed=first_seed,
            access=access_of(context),
            engine=engine,
            store=store,
        )
        result = demonstrate(plan, interruption=interruption, progress=progress.progress)
    if result is None:
        raise StoppedEarly(
            f"interrupted: the bench is in the safe state; next: labctl demo begins again, "
            f"labctl runs {store or plan.folder} lists what was measured"
        )
    show(result, as_json, lambda: _print_demo(result))
    return DONE


def _print_demo(result: dict[str, Any]) -> None:
    from labctl.studies.demonstration import SEVERAL, SINGLE, paper_says

    last = result["first_seed"] + result["twins"] - 1
    say(
        f"Digits 0-3, {result['shots']} images, ports 2-6, {result['twins']} simulated benches (seeds "
        f"{result['first_seed']} to {last}), {result['splits']} splits each"
    )
    table(
        ("T_N (ns)", "single triggers", "chip bypassed", "mean of 16", "chip bypassed", "paper"),
        (
            (
                window,
                *(
                    _accuracy(column[curve][window])
                    for column in (result, result["averaged"])
                    for curve in ("accuracy", "accuracy_without_reservoir")
                ),
                paper_says(window),
            )
            for window in result["accuracy"]
        ),
    )
    say("Means over benches and, in brackets, their 95 % intervals; open: the interval holds what must be reached.")
    for must in result["must"]:
        said = [f"{name} {word}" for name, word in ((SINGLE, must["verdict"]), (SEVERAL, must["averaged"]["verdict"]))]
        say(f"{must['what']}: {', '.join(said)}")
    say(f"{result['shots_per_second']:.0f} shots/s, {result['seconds']:.0f} s in all")
    say(f"run: {result['run']}")
    say(f"report: {result['report']}")


def _accuracy(reached: dict[str, Any]) -> str:
    if reached["low"] is None:
        return f"{reached['mean']:.3f}"
    return f"{reached['mean']:.3f} [{reached['low']:.3f}, {reached['high']:.3f}]"
