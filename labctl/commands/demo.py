"""`labctl demo`: the main experiment of the paper on simulated benches."""

from pathlib import Path
from typing import Annotated, Any

import typer

from labctl.bench.signals import interruptible
from labctl.commands.access import access_of
from labctl.commands.exit_status import DONE, FELL_SHORT, INTERRUPTED
from labctl.commands.output import JsonOption, progress_bar, say, show, table
from labctl.studies.demonstration import demonstrate, paper_says
from labctl.studies.paper.experiments import experiments


def demo(
    context: typer.Context,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the runs; default runs/.")] = None,
    as_json: JsonOption = False,
) -> int:
    """Run the paper's image recognition on simulated benches: acquire, train, evaluate, report."""
    (experiment,) = experiments(["demonstration"])
    with interruptible() as interruption, progress_bar("demo") as progress:
        folder, access = out or Path("runs"), access_of(context)
        result = demonstrate(experiment, folder, access, interruption=interruption, progress=progress.progress)
    if result is None:
        return INTERRUPTED
    show(result, as_json, lambda: _print_demo(result))
    return DONE if result["passed"] else FELL_SHORT


def _print_demo(result: dict[str, Any]) -> None:
    say(f"Digits 0-3, {result['shots']} images, ports 2-6, {result['twins']} simulated benches, 10 splits each")
    table(
        ("T_N (ns)", "accuracy", "sd", "without chip", "sd", "paper"),
        (
            (
                window,
                f"{reached['mean']:.3f}",
                f"{reached['sd']:.3f}",
                f"{result['accuracy_without_reservoir'][window]['mean']:.3f}",
                f"{result['accuracy_without_reservoir'][window]['sd']:.3f}",
                paper_says(window),
            )
            for window, reached in result["accuracy"].items()
        ),
    )
    verdict = "reached" if result["passed"] else "NOT reached"
    say(f"the paper's result is {verdict}; {result['shots_per_second']:.0f} shots/s, {result['seconds']:.0f} s in all")
    say(f"run: {result['run']}")
    say(f"report: {result['report']}")
