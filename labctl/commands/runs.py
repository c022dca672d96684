"""`labctl runs`: what has been measured."""

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, get_args

import typer

from labctl.commands.exit_status import DONE
from labctl.commands.output import JsonOption, say, show, table
from labctl.errors import UsageError
from labctl.runs.index import ORDERS, Choice, RunRow, State, list_runs

STATES = get_args(State)


def runs(
    folder: Annotated[Path, typer.Argument(help="Folder of run directories.")] = Path("runs"),
    protocol: Annotated[str | None, typer.Option("--protocol", help="Only runs of this protocol.")] = None,
    since: Annotated[
        str | None, typer.Option("--since", help="Only runs begun since, in UTC: 2026-11-21 or 2026-11-21T09:15.")
    ] = None,
    state: Annotated[str | None, typer.Option("--state", help=f"Only runs that are {', '.join(STATES)}.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Only runs with this seed.")] = None,
    limit: Annotated[int | None, typer.Option("--limit", min=1, help="Only the last so many.")] = None,
    sort: Annotated[str, typer.Option("--sort", help=f"By {', '.join(ORDERS)}; the last is the largest.")] = "started",
    as_json: JsonOption = False,
) -> int:
    """List the runs in a folder, the newest last."""
    if sort not in ORDERS:
        raise UsageError(f"--sort {sort}: choose one of {', '.join(ORDERS)}")
    choice = Choice(protocol, _time(since), _state(state), seed, limit)
    there = list_runs(folder)
    rows = choice.of(there, sort)
    show({"runs": [_listed(row) for row in rows]}, as_json, lambda: _print(folder, there, rows))
    return DONE


def _time(text: str | None) -> datetime | None:
    if text is None:
        return None
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        raise UsageError(f"--since {text}: is no date: write it like 2026-11-21 or 2026-11-21T09:15") from None
    return found if found.tzinfo else found.replace(tzinfo=UTC)


def _state(text: str | None) -> State | None:
    for state in STATES:
        if text == state:
            found: State = state
            return found
    if text is not None:
        raise UsageError(f"--state {text}: choose one of {', '.join(STATES)}")
    return None


def _listed(row: RunRow) -> dict[str, object]:
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
    }


def _print(folder: Path, there: list[RunRow], rows: list[RunRow]) -> None:
    if not there:
        say(f"{folder}: no runs yet")
    elif not rows:
        say(f"{folder}: none of its {len(there)} runs is of that kind")
    else:
        table(
            ("run", "protocol", "started", "seed", "twin", "shots", ""),
            (
                (
                    row.name,
                    row.protocol,
                    row.started,
                    "" if row.seed is None else row.seed,
                    "" if row.twin_seed is None else row.twin_seed,
                    f"{row.shots}/{row.planned}",
                    row.problem.removeprefix(f"{row.path}{os.sep}") or row.state,  # its name stands there already
                )
                for row in rows
            ),
        )
