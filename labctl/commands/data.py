"""Data sets: list, fetch, verify, path."""

from pathlib import Path
from typing import Annotated, Any

import typer

from labctl import datasets
from labctl.commands.exit_status import DONE, FELL_SHORT
from labctl.commands.options import DataOption
from labctl.commands.output import JsonOption, say, show, table
from labctl.errors import DatasetError

app = typer.Typer(help=__doc__, no_args_is_help=True, rich_markup_mode=None, add_completion=False)

Name = Annotated[str, typer.Argument(help="Name of a data set.")]


@app.command("list")
def list_data(data: DataOption = None, as_json: JsonOption = False) -> int:
    """List the data sets and where each one is."""
    rows = [_card(card, data) for card in datasets.catalogue()]
    show(
        {"datasets": rows},
        as_json,
        lambda: table(
            ("name", "kind", "size", "licence", "where"),
            (
                (
                    row["name"],
                    row["kind"],
                    row["shape"],
                    row["licence"],
                    row["path"] or row["obtain"],
                )
                for row in rows
            ),
        ),
    )
    return DONE


@app.command()
def fetch(name: Name, as_json: JsonOption = False) -> int:
    """Download a data set into the user's cache, checking every sha256."""
    folder = str(datasets.fetch(name))
    show({"name": name, "path": folder}, as_json, lambda: say(folder))
    return DONE


@app.command()
def verify(name: Name, data: DataOption = None, as_json: JsonOption = False) -> int:
    """Check every file of a data set against its card; exit 1 if one differs."""
    checks = datasets.verify(name, data)
    files = [{"path": str(check.path), "ok": check.ok, "problem": check.problem} for check in checks]
    well = all(file["ok"] for file in files)
    show(
        {"name": name, "ok": well, "files": files},
        as_json,
        lambda: table(("file", "finding"), ((file["path"], file["problem"] or "ok") for file in files)),
    )
    return DONE if well else FELL_SHORT


@app.command()
def path(name: Name, data: DataOption = None, as_json: JsonOption = False) -> int:
    """Print the folder that holds a data set."""
    folder = str(datasets.path(name, data))
    show({"name": name, "path": folder}, as_json, lambda: say(folder))
    return DONE


def _card(card: datasets.Card, data: Path | None) -> dict[str, Any]:
    try:
        found = str(datasets.path(card.name, data))
    except DatasetError:
        found = ""
    return {
        "name": card.name,
        "title": card.title,
        "kind": card.kind,
        "shape": str(card.shape),
        "licence": card.licence,
        "path": found,
        "obtain": card.obtain or f"labctl data fetch {card.name}",
    }
