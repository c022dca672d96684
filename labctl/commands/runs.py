"""`labctl runs`: what has been measured."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, get_args

import typer

from labctl.commands.exit_status import DONE
from labctl.commands.options import LARGEST_NUMBER
from labctl.commands.output import JsonOption, say, show, table
from labctl.errors import UsageError
from labctl.runs.catalogue import Catalogue, Found
from labctl.runs.format.store import is_elsewhere, location
from labctl.runs.index import RunRow, State
from labctl.runs.search import when
from labctl.studies.sweeps.run_folder import own_runs

STATES = get_args(State)
USUAL = Path("runs")
"""Where runs go; before the first one it is not there."""
EXAMPLE = '"images >= 300 and accuracy > 0.9 and tag = good"'


def runs(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder of run directories, or its URL.", parser=location)
    ] = USUAL,
    where: Annotated[str, typer.Option("--where", help=f"Only runs that fit: {EXAMPLE}; or words.")] = "",
    protocol: Annotated[str | None, typer.Option("--protocol", help="Only runs of this protocol.")] = None,
    since: Annotated[
        str | None, typer.Option("--since", help="Only runs begun since, in UTC: 2026-11-21 or 2026-11-21T09:15.")
    ] = None,
    state: Annotated[str | None, typer.Option("--state", help=f"Only runs that are {', '.join(STATES)}.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Only runs with this seed.")] = None,
    limit: Annotated[int | None, typer.Option("--limit", max=LARGEST_NUMBER, help="Only the last N.")] = None,
    sort: Annotated[str, typer.Option("--sort", help="By any key of --keys; the last is the largest.")] = "started",
    columns: Annotated[str, typer.Option("--columns", help='Keys to show as well, such as "images,accuracy".')] = "",
    keys: Annotated[bool, typer.Option("--keys", help="List the keys that runs can be found and sorted by.")] = False,
    as_json: JsonOption = False,
) -> int:
    """List the runs in a folder, or those of a sweep wherever they are, the newest last."""
    if folder != USUAL and not is_elsewhere(folder) and not folder.is_dir():
        raise UsageError(f"{folder}: no such folder: name one with runs in it")
    folder, only = own_runs(folder)
    catalogue = Catalogue(folder, only=only)
    if keys:
        known = catalogue.keys()
        show({"keys": known}, as_json, lambda: say(", ".join(known) or f"{folder}: no runs yet"))
        return DONE
    asked = [where] if where.strip() else []
    asked += [f'protocol = "{protocol}"'] if protocol is not None else []
    asked += [f'started >= "{when(f"--since {since}", since)[0]}"'] if since is not None else []
    asked += [f'state = "{_state(state)}"'] if state is not None else []
    asked += [f"seed = {seed}"] if seed is not None else []
    more = [key.strip().lower() for key in columns.split(",") if key.strip()]
    found = catalogue.find(*asked, sort=sort, limit=limit, shown=more)
    listed = [_listed(one) for one in found] if as_json else []
    show({"runs": listed}, as_json, lambda: _print(folder, found, more, asked=bool(asked)))
    return DONE


def _state(text: str) -> str:
    if text not in STATES:
        raise UsageError(f"--state {text}: choose one of {', '.join(STATES)}")
    return text


def _listed(found: Found) -> dict[str, object]:
    row = found.row
    return {
        "run": str(row.path),
        "protocol": row.protocol,
        "started": row.started,
        "seed": row.seed,
        "twin_seed": row.twin_seed,
        "shots": row.shots,
        "planned": row.planned,
        "complete": row.complete,
        "state": row.state,
        "problem": row.problem,
        "known": {key: list(values) for key, values in found.facts.items()},
    }


def _print(folder: Path, found: list[Found], columns: list[str], *, asked: bool) -> None:
    if not found:
        say(f"{folder}: no run in it matches" if asked else f"{folder}: no runs yet")
        return
    table(
        ("run", "protocol", "started", "seed", "twin", "shots", "tags", *columns, ""),
        (
            (
                one.row.name,
                one.row.protocol,
                one.row.started,
                "" if one.row.seed is None else one.row.seed,
                "" if one.row.twin_seed is None else one.row.twin_seed,
                f"{one.row.shots}/{one.row.planned}",
                " ".join((*("*" for star in one.facts.get("star", ()) if star), *map(str, one.facts.get("tag", ())))),
                *(_text(one.facts.get(key, ())) for key in columns),
                _how(one.row),
            )
            for one in found
        ),
    )


def _text(values: Sequence[str | float]) -> str:
    return ", ".join(f"{value:.6g}" if isinstance(value, float) else value for value in values)


def _how(row: RunRow) -> str:
    return row.problem.removeprefix(f"{row.path}").lstrip(os.sep + "/") or row.state  # its name stands there already
