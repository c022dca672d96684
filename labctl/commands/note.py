"""`labctl note`: what people say of a run."""

from pathlib import Path
from typing import Annotated

import typer

from labctl.commands.exit_status import DONE
from labctl.commands.options import RunHereArgument
from labctl.commands.output import JsonOption, say, show
from labctl.runs.format.layout import RunPaths
from labctl.runs.notes import Notes, read_notes, require_run, say_of


def note(
    run: RunHereArgument,
    text: Annotated[str, typer.Argument(help="The note.")] = "",
    tags: Annotated[list[str] | None, typer.Option("--tag", help="A word to find it by; may be repeated.")] = None,
    untagged: Annotated[list[str] | None, typer.Option("--untag", help="Take a tag away; may be repeated.")] = None,
    star: Annotated[bool | None, typer.Option("--star/--no-star", help="Set the star, or take it away.")] = None,
    operator: Annotated[str | None, typer.Option("--operator", help="Who measured it.")] = None,
    as_json: JsonOption = False,
) -> int:
    """Write a note, tags, a star or the operator of a run, or read them.

    They are kept beside the measured data, never in them, and no note is lost.
    """
    paths = RunPaths(run)
    if text or tags or untagged or star is not None or operator is not None:
        say_of(paths, text, tags=tags or (), untagged=untagged or (), star=star, operator=operator)
    else:
        require_run(paths)
    found = read_notes(paths)
    show({"run": str(run)} | _listed(found), as_json, lambda: _print(run, found))
    return DONE


def _listed(found: Notes) -> dict[str, object]:
    return {
        "notes": [{"time": one.time, "by": one.by, "text": one.text, "picture": one.picture} for one in found.notes],
        "tags": list(found.tags),
        "star": found.star,
        "operator": found.operator,
        "problems": list(found.problems),
    }


def _print(run: Path, found: Notes) -> None:
    marks = [*(("starred",) if found.star else ()), *((f"by {found.operator}",) if found.operator else ())]
    say(f"{run}: {', '.join((*marks, *found.tags)) or 'no tags'}")
    for one in found.notes:
        picture = f" ({RunPaths(run).pictures / one.picture})" if one.picture else ""
        say(f"{one.time} {one.by}: {one.text}{picture}")
    for problem in found.problems:
        say(f"damaged: {problem}")
