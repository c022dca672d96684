"""`labctl runs`: what has been measured. `labctl show`: one run, model or file in words."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from labctl.commands.output import JsonOption, say, table
from labctl.commands.output import show as output
from labctl.failures import DONE, UsageError
from labctl.runs import RunPaths, list_runs, open_run


def runs(
    folder: Annotated[Path, typer.Argument(help="Folder of run directories.")] = Path("runs"),
    as_json: JsonOption = False,
) -> int:
    """List the runs in a folder."""
    rows = list_runs(folder)
    listed = [
        {
            "run": str(row.path),
            "protocol": row.protocol,
            "started": row.started,
            "seed": row.seed,
            "twin_seed": row.twin_seed,
            "shots": row.shots,
            "planned": row.planned,
            "complete": row.complete,
            "problem": row.problem,
        }
        for row in rows
    ]
    output(
        {"runs": listed},
        as_json,
        lambda: (
            table(
                ("run", "protocol", "started", "shots", ""),
                (
                    (
                        row.name,
                        row.protocol,
                        row.started,
                        f"{row.shots}/{row.planned}",
                        row.problem or _state(row.complete),
                    )
                    for row in rows
                ),
            )
            if rows
            else say(f"{folder}: no runs yet")
        ),
    )
    return DONE


def show(
    path: Annotated[Path, typer.Argument(help="Run directory, data.h5 or model file.")],
    as_json: JsonOption = False,
) -> int:
    """Say what a run or a file holds."""
    if not path.exists():
        raise UsageError(f"{path}: no such file or directory: name a run directory, a data.h5 or a model file")
    is_run = path.is_dir() or path.name == RunPaths(path.parent).data.name
    found = _run(path) if is_run else _model(path)
    output(found, as_json, lambda: table(("what", "value"), _flat(found)))
    return DONE


def _run(path: Path) -> dict[str, Any]:
    with open_run(path) as run:
        shots = run.shots
        kinds, counts = np.unique(shots["kind"], return_counts=True)
        manifest = run.manifest
        return {
            "run": str(path),
            "complete": run.complete,
            "shots": len(run.frames),
            "kinds": {str(kind): int(count) for kind, count in zip(kinds, counts, strict=True)},
            "ports": list(run.ports),
            "samples": run.shape.samples,
            "sample_interval_s": run.shape.sample_interval_s,
            "clipped_shots": int(np.count_nonzero(np.any(run.clipped, axis=1))),
            "frames_sha256": run.digest(),
            "protocol": manifest.get("protocol"),
            "started": manifest.get("started"),
            "seeds": manifest.get("seeds"),
            "instruments": manifest.get("instruments"),
        }


def _model(path: Path) -> dict[str, Any]:
    from labctl.analysis.models import load_metadata  # here, since it brings scikit-learn

    return {"model": str(path)} | load_metadata(path)


def _state(complete: bool) -> str:
    return "complete" if complete else "incomplete"


def _flat(values: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for key, value in values.items():
        rows.extend(_flat(value, f"{prefix}{key}.") if isinstance(value, dict) else [(f"{prefix}{key}", str(value))])
    return rows
