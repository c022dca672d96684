"""`labctl schema`: what editors complete and check station and protocol files by."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from labctl.bench.schema import names, schema_of, write_schemas
from labctl.commands.exit_status import DONE
from labctl.commands.output import JsonOption, say, show
from labctl.errors import UsageError


def schema(
    name: Annotated[str | None, typer.Argument(help="station, or the name of a protocol.")] = None,
    write: Annotated[
        Path | None, typer.Option("--write", help="Write all of them into this folder, as NAME.schema.json.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Print the JSON Schema of station files or of a protocol's files, for editors."""
    if (name is None) == (write is None):
        raise UsageError(f"name one of {', '.join(names())}, or give a folder with --write")
    if write is None:
        indent = None if as_json else 2
        sys.stdout.write(json.dumps(schema_of(str(name)), indent=indent, ensure_ascii=False) + "\n")
        return DONE
    written = [str(path) for path in write_schemas(write)]
    show({"written": written}, as_json, lambda: _print(written))
    return DONE


def _print(written: list[str]) -> None:
    for path in written:
        say(path)
