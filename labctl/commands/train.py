"""`labctl train`: a readout from a run."""

from pathlib import Path
from typing import Annotated, Any

import typer

from instruments.units import quantity
from labctl.commands.exit_status import DONE
from labctl.commands.next_steps import require_readout
from labctl.commands.options import RunHereArgument
from labctl.commands.output import JsonOption, say, show, table
from labctl.commands.ranges import ports_of
from labctl.commands.scheduler import SideBySideOption, carrying
from labctl.errors import UsageError
from labctl.runs.sweep_axes import parse_axis
from labctl.studies.readout_search import search_readout
from labctl.studies.readout_training import train_readout


def train(
    run: RunHereArgument,
    readout: Annotated[str, typer.Option("--readout", help="softmax")] = "softmax",
    window: Annotated[
        str | None, typer.Option("--window", help='Acquisition time T_N, such as "0.4 ns", which is the default.')
    ] = None,
    ports: Annotated[
        str | None, typer.Option("--ports", help='Ports, such as "2-6"; without it all of the run.')
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the split.")] = 1,
    over: Annotated[
        list[str] | None,
        typer.Option(
            "--search",
            metavar="AXIS",
            help='Try each value of window, tau or C, such as "C=0.1,1,10", and take the best; may be repeated.',
        ),
    ] = None,
    scheduler: SideBySideOption = None,
    out: Annotated[Path | None, typer.Option("--out", help="Model file; default inside the run directory.")] = None,
    as_json: JsonOption = False,
) -> int:
    """Train a readout on nine tenths of a run's images; the rest is kept for `labctl evaluate`.

    With --search every combination of some values is judged by splits of these nine tenths, and the best is trained.
    """
    if readout != "softmax":
        raise UsageError(f"--readout {readout}: unknown readout: choose softmax")
    require_readout(run)
    window_s = seconds("0.4 ns" if window is None else window)
    if over:
        axes = dict(parse_axis(one, "--search") for one in over)
        if len(axes) < len(over):
            raise UsageError("--search: an axis is there twice: give each once, with all its values")
        if window is not None and "window" in axes:
            raise UsageError("--window and --search window=...: both say the acquisition time: leave one of them out")
        carried_out = carrying(scheduler, "search")
        found = search_readout(
            run,
            axes,
            window_s=window_s,
            ports=ports_of(ports),
            seed=seed,
            out=out,
            carried_out=carried_out,
        )
        show(found, as_json, lambda: _print_search(found, list(axes)))
        return DONE
    if scheduler is not None:
        raise UsageError("--scheduler is for --search: one readout is trained here: leave it out")
    trained = train_readout(run, window_s=window_s, ports=ports_of(ports), seed=seed, out=out)
    show(trained, as_json, lambda: _print_training(trained))
    return DONE


def seconds(text: str) -> float:
    """The option --window in s; UsageError if it is no time."""
    try:
        return quantity(text, "s")
    except ValueError as error:
        raise UsageError(f"--window: {error}") from None


def _print_training(trained: dict[str, Any]) -> None:
    say(f"{trained['model']}: softmax on {trained['features']} features, {trained['training_shots']} training shots")
    say_what_is_special(trained)
    say(f"accuracy on the {trained['test_shots']} shots kept apart: {with_interval(trained)}, 95 % interval")


def _print_search(found: dict[str, Any], axes: list[str]) -> None:
    table(
        (*axes, "features", "accuracy", ""),
        (
            (
                *(row[axis] for axis in axes),
                row["features"],
                f"{row['accuracy']:.3f} ± {row['sd']:.3f}",
                "best" if row is found["best"] else "",
            )
            for row in found["search"]
        ),
    )
    say("by splits of the training shots alone")
    _print_training(found)


def say_what_is_special(found: dict[str, Any]) -> None:
    """What of the images of a run somebody should know who reads how good a readout is."""
    if found["left_out"]:
        say(f"{found['left_out']} more images of the run, evenly spread, are left out: memory is bounded")
    if found["identical_images"]:
        say(
            f"{found['identical_images']} images of the run are identical to another one of it: some are tested that a "
            "readout was trained on, and it seems better than it is"
        )


def with_interval(found: dict[str, Any]) -> str:
    """An accuracy and its interval, for people."""
    low, high = found["interval"]
    return f"{found['accuracy']:.3f} [{low:.3f}, {high:.3f}]"
