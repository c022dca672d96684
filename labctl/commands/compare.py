"""`labctl compare`: two runs side by side."""

from pathlib import Path
from typing import Annotated, Any

import typer

from labctl.commands.exit_status import DONE
from labctl.commands.output import JsonOption, say, show, table
from labctl.runs.format.store import here
from labctl.studies import comparison


def compare(
    first: Annotated[Path, typer.Argument(metavar="A", help="Run directory or data.h5.", parser=here)],
    second: Annotated[Path, typer.Argument(metavar="B", help="The run to compare it with.", parser=here)],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the pictures; default among the figures of A.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Compare two runs: settings that differ, shots, traces of the same image, accuracy against acquisition time."""
    found = comparison.compare(first, second)
    pictures = comparison.draw(found, out or comparison.default_folder(first, second))
    result = comparison.as_json(found) | {"pictures": [str(picture) for picture in pictures]}
    show(result, as_json, lambda: _print(result))
    return DONE


def _print(result: dict[str, Any]) -> None:
    names = result["runs"]
    if result["differences"]:
        rows = [(one["setting"], one["then"], one["now"]) for one in result["differences"]]
        table(("setting that differs", *names), rows)
    else:
        say("no setting differs")
    say("")
    counts = [dict(one) for one in result["shots"]]
    what = dict.fromkeys(name for one in counts for name in one)
    table(("shots", *names), [(name, *(one.get(name, 0) for one in counts)) for name in what])
    if result["same_image"]:
        say("")
        correlation = result["same_image"]["correlation"].items()
        table(
            ("port", "correlation of the traces of the same images"),
            [(port, "sampled otherwise" if value is None else f"{value:.4f}") for port, value in correlation],
        )
    if any(result["accuracy"]):
        say("")
        tables = [one or {} for one in result["accuracy"]]
        windows = sorted({window for one in tables for window in one}, key=float)
        table(
            ("T_N (ns)", *(f"accuracy of {name}" for name in names)),
            [(window, *(_accuracy(one.get(window)) for one in tables)) for window in windows],
        )
    say("")
    for line in (*result["pictures"], *result["left_out"]):
        say(line)


def _accuracy(found: dict[str, float] | None) -> str:
    return f"{found['mean']:.3f} ± {found['sd']:.3f}" if found else ""
