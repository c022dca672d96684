"""`labctl publish`: a run as it is given away."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from labctl.commands.exit_status import DONE
from labctl.commands.options import RunHereArgument
from labctl.commands.output import JsonOption, say, show, warn
from labctl.errors import UsageError
from labctl.runs.publication import FORMATS, declared
from labctl.runs.publication import publish as write


def publish(
    run: RunHereArgument,
    to: Annotated[str, typer.Option("--as", help=f"Metadata: {', '.join(FORMATS)}.")],
    out: Annotated[Path, typer.Option("--out", help="Folder to make.")],
    title: Annotated[str, typer.Option("--title", help="What it is called.")] = "",
    creators: Annotated[
        list[str] | None,
        typer.Option("--creator", help='Who made it: "Ada Lovelace <0000-0002-1825-0097>"; may be repeated.'),
    ] = None,
    licence: Annotated[str, typer.Option("--licence", help="SPDX identifier, such as CC-BY-4.0, or address.")] = "",
    publisher: Annotated[str, typer.Option("--publisher", help="Who gives it away; DataCite needs it.")] = "",
    description: Annotated[str, typer.Option("--description", help="In a few sentences.")] = "",
    as_json: JsonOption = False,
) -> int:
    """Copy a run to give it away: with checksums, and as RO-Crate or with DataCite metadata.

    Title and description say if the run is unfinished, damaged, in doubt or simulated.
    """
    if to not in FORMATS:
        raise UsageError(f"--as {to}: choose one of {', '.join(FORMATS)}")
    said = declared(title=title, creators=creators or (), licence=licence, publisher=publisher, description=description)
    subject = write(run, out, to, said, datetime.now(UTC).date())
    found = {
        "run": str(run),
        "folder": str(out),
        "as": to,
        "title": f"{subject.marks}{title}",
        "faults": subject.faults,
    }
    for fault in subject.faults:
        warn(fault)
    show(found, as_json, lambda: say(f"{out}: {subject.marks}{title}"))
    return DONE
