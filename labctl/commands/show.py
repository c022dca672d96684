"""`labctl show`: one run in pictures and numbers, or what another file says of itself."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from labctl.commands.exit_status import DONE
from labctl.commands.output import JsonOption, say, table
from labctl.commands.output import show as output
from labctl.commands.ranges import ShotsOption, ports_of, shots_of
from labctl.errors import UsageError
from labctl.runs.format.origin import Origin
from labctl.runs.format.store import is_elsewhere, location
from labctl.runs.read.run import Run, open_run
from labctl.studies.file_summary import is_run, summary_of
from labctl.studies.inspection import Look, look_at, part_of, place_of_pictures

SOURCE = "protocol.file.text"
"""The Python file of a protocol: no value for a table."""


def show(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="RUN|FILE",
            help="Run, by its URL elsewhere too, readout, recording, station or protocol file.",
            parser=location,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the pictures, or one .png; default RUN/figures.")
    ] = None,
    shots: ShotsOption = None,
    ports: Annotated[str | None, typer.Option("--ports", help='Ports to look at, such as "2-6".')] = None,
    as_json: JsonOption = False,
) -> int:
    """Draw what a run measured: traces, images, codes, drift. Of other files: say what they hold."""
    if not path.exists():
        raise UsageError(f"{path}: no such file or directory: name a run directory, a data.h5 or another file")
    if is_run(path):
        _show_run(path, out, shots_of(shots), ports_of(ports), as_json=as_json)
        return DONE
    if is_elsewhere(path):
        raise UsageError(f"{path}: is not a run: copy the file here to see what it holds")
    if out or shots or ports:
        raise UsageError(f"{path}: is not a run: leave --out, --shots and --ports out")
    summary = summary_of(path)
    output(summary, as_json, lambda: table(("what", "value"), _flat(summary)))
    return DONE


def _show_run(
    path: Path, out: Path | None, shots: tuple[int, int] | None, ports: tuple[int, ...] | None, *, as_json: bool
) -> None:
    """Numbers at once, pictures as soon as they are drawn."""
    with open_run(path) as run:
        part = part_of(run, shots, ports)
        look, place = look_at(run, part), place_of_pictures(run, out)
        found = _described(path, run) | {"shown_shots": int(part.shots.size), "signals": _signals(look)}
        if not as_json:
            _print(found)

        from labctl.studies.run_pictures import (
            draw,  # with matplotlib, which takes longer to load than all of the above
        )

        drawn = draw(run, part, look, place, "shown-" if out is None else "")
    found |= {"pictures": [str(picture) for picture in drawn.pictures], "left_out": list(drawn.left_out)}
    output(found, as_json, lambda: _print_pictures(found))


def _described(path: Path, run: Run) -> dict[str, Any]:
    shots, manifest = run.shots, run.manifest
    kinds, counts = np.unique(shots["kind"], return_counts=True)
    return {
        "run": str(path),
        "complete": run.complete,
        "shots": len(run.frames),
        "planned": run.shape.shots,
        "suspect": run.suspect,
        "kinds": {str(kind): int(count) for kind, count in zip(kinds, counts, strict=True)},
        "ports": list(run.ports),
        "samples": run.shape.samples,
        "sample_interval_s": run.shape.sample_interval_s,
        "clipped_shots": int(np.count_nonzero(np.any(run.clipped, axis=1))),
        "frames_sha256": None if is_elsewhere(path) else run.digest(),
        "protocol": manifest.get("protocol"),
        "started": manifest.get("started"),
        "seeds": manifest.get("seeds"),
        "origin": Origin.of(manifest),
        "instruments": manifest.get("instruments"),
    }


def _signals(look: Look) -> list[dict[str, Any]]:
    """Of each port: part of the frames that are clipped, part of the range that is used, drift of the reference."""
    rows: list[dict[str, Any]] = []
    for place, port in enumerate(look.ports):
        row: dict[str, Any] = {
            "port": port,
            "clipped_fraction": float(look.clipped[place]),
            "range_used": float(look.codes.used[place]),
        }
        if look.drift is not None:
            first, last = look.drift.level[[0, -1], place]
            correlation = float(look.drift.correlation[-1, place])
            row["reference_level_v"] = {"first": float(first), "last": float(last)}
            row["reference_correlation"] = correlation if np.isfinite(correlation) else None
        rows.append(row)
    return rows


def _print(found: dict[str, Any]) -> None:
    apart = ("instruments", "signals")
    rows = _flat({key: value for key, value in found.items() if key not in apart})
    table(("what", "value"), (row for row in rows if row[0] != SOURCE))
    say("")
    headings = ("port", "clipped frames", "range used", "reference level first, last", "correlation of first and last")
    table(headings, map(_signal_row, found["signals"]))
    say("")


def _print_pictures(found: dict[str, Any]) -> None:
    for picture in found["pictures"]:
        say(picture)
    for line in found["left_out"]:
        say(line)


def _signal_row(row: dict[str, Any]) -> tuple[str, ...]:
    level, correlation = row.get("reference_level_v"), row.get("reference_correlation")
    return (
        row["port"],
        f"{100 * row['clipped_fraction']:.3g} %",
        f"{100 * row['range_used']:.0f} %",
        f"{1e3 * level['first']:.4g} mV, {1e3 * level['last']:.4g} mV" if level else "",
        "" if correlation is None else f"{correlation:.4f}",
    )


def _flat(values: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for key, value in values.items():
        rows.extend(_flat(value, f"{prefix}{key}.") if isinstance(value, dict) else [(f"{prefix}{key}", str(value))])
    return rows
