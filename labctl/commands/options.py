"""Options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

from labctl.errors import UsageError
from labctl.runs.format.store import here


def _folder(path: Path | None) -> Path | None:
    """Raises UsageError: it is not there, and other places would be searched in its stead."""
    if path is not None and not path.is_dir():
        raise UsageError(f"--data {path}: is no folder: name one that holds data sets, or leave --data out")
    return path


LARGEST_NUMBER = (1 << 63) - 1
"""That SQLite takes."""
RunHereArgument = Annotated[Path, typer.Argument(metavar="RUN", help="Run directory.", parser=here)]
StationOption = Annotated[Path | None, typer.Option("--station", help="Station file; without it the simulated bench.")]
DataOption = Annotated[
    Path | None, typer.Option("--data", callback=_folder, help="Folder of data sets, searched first.")
]
NoteOption = Annotated[str, typer.Option("--note", help="A note on the run; kept beside the data.")]
TagsOption = Annotated[list[str] | None, typer.Option("--tag", help="A word to find it by; may be repeated.")]
StarOption = Annotated[bool, typer.Option("--star", help="Mark the run with a star.")]
OperatorOption = Annotated[str | None, typer.Option("--operator", help="Who measures it.")]
PortBaseOption = Annotated[
    int | None, typer.Option("--port-base", min=1024, max=65500, help="First TCP port; without it any free ones.")
]
SaveStationOption = Annotated[
    Path | None, typer.Option("--save-station", help="Write a station file that points at these instruments.")
]
FirstSeedOption = Annotated[
    int,
    typer.Option(
        "--first-seed", min=0, max=4_000_000_000, help="First seed: other images and, where simulated, other benches."
    ),
]
