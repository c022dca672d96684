"""`labctl export`: a run as a file of another format."""

from pathlib import Path
from typing import Annotated

import typer

from labctl.commands.exit_status import DONE
from labctl.commands.output import JsonOption, say, show
from labctl.commands.progress import progress_bar
from labctl.commands.ranges import ShotsOption, shots_of
from labctl.errors import UsageError
from labctl.runs.export import FORMATS, Content, write
from labctl.runs.format.store import here
from labctl.runs.read.run import open_run


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run directory or data.h5.", parser=here)],
    to: Annotated[str, typer.Option("--to", help=f"Format: {', '.join(FORMATS)}.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="File to make, for zarr a folder; default next to the run.")
    ] = None,
    shots: ShotsOption = None,
    codes: Annotated[
        bool, typer.Option("--codes/--volts", help="Digitiser codes with scale and offset, or the signal in volts.")
    ] = False,
    as_json: JsonOption = False,
) -> int:
    """Write a run, finished or not, as netCDF, zarr, npz or CSV, whatever its size; nothing is overwritten."""
    if to not in FORMATS:
        raise UsageError(f"--to {to}: choose one of {', '.join(FORMATS)}")
    path = out or _beside(run, FORMATS[to])
    with open_run(run) as opened, progress_bar("export") as progress:
        content = Content.of(opened, shots_of(shots), "codes" if codes else "volts", progress.progress)
        size = write(content, to, path)
    found = {
        "run": str(run),
        "file": str(path),
        "format": to,
        "shots": len(content.shots),
        "traces": "codes" if codes else "volts",
        "bytes": size,
    }
    show(found, as_json, lambda: say(f"{path}: {found['shots']} shots, {size / 1e6:.3g} MB"))
    return DONE


def _beside(run: Path, suffix: str) -> Path:
    """For the run runs/mine the file runs/mine.nc; for a data file of its own the same name with that ending."""
    where = run.resolve()
    where = where.parent if where.name == "data.h5" and (where.parent / "manifest.json").exists() else where
    return where.with_name((where.name if where.is_dir() else where.stem) + suffix)
