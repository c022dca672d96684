"""How readouts that follow fare on a run, from shot to shot, beside readouts that stay as they were trained."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.analysis.intervals import interval
from labctl.analysis.prequential import READOUTS, prequential
from labctl.analysis.windows import WindowFeatures
from labctl.runs.read.records import read_records
from labctl.runs.read.run import open_run

WINDOW_S = 0.4e-9
"""Acquisition time by default, or the whole record where that is shorter."""
FIRST_SHOTS, FIRST_PART = 1000, 4
"""All readouts begin with so many shots, or with one in so many where that is fewer."""
LAST_PART = 4
"""One in so many of the shots that count: what is left of the accuracy at the end."""
BLOCKS = 12


def evaluate_online(directory: Path, *, window_s: float | None, ports: tuple[int, ...] | None) -> dict[str, Any]:
    """Accuracy of the readouts on a run in the order it was measured, all of it, at its end, and block by block.

    Raises:
        AnalysisError: a port or window that the run does not have, or too few images.
        RunError: no such run.
    """
    with open_run(directory) as run:
        records, passes = read_records(run), len(run.shape.passes)
    shots, recorded_s = records.labels.size, records.traces.shape[2] * records.sample_interval_s
    window = WindowFeatures(
        ports=ports,
        window_s=min(WINDOW_S, recorded_s) if window_s is None else window_s,
        sample_interval_s=records.sample_interval_s,
        recorded_ports=records.ports if ports else None,
    )
    order = np.argsort(records.time_s, kind="stable")
    features = window.fit_transform(records.traces)[order]
    first = min(FIRST_SHOTS, shots // FIRST_PART)
    found = prequential(features, records.labels[order], records.groups[order], first=first)
    last = -(-found.places.size // LAST_PART)
    blocks = np.array_split(np.arange(found.places.size), min(BLOCKS, found.places.size))
    return {
        "run": str(directory),
        "window_s": window.window_s,
        "ports": list(ports or records.ports),
        "features": features.shape[1],
        "passes": passes,
        "shots": shots,
        "first_shots": first,
        "judged_shots": int(found.places.size),
        "last_shots": last,
        "chance": float(np.max(np.unique_counts(records.labels).counts) / shots),
        "block_ends": [int(found.places[block[-1]]) + 1 for block in blocks],
        "readouts": {
            name: {"all": _accuracy(found.right[name]), "last": _accuracy(found.right[name][-last:])}
            | {"blocks": [float(np.mean(found.right[name][block])) for block in blocks]}
            for name in READOUTS
        },
    }


def in_words(found: dict[str, Any]) -> list[str]:
    """What a table of the readouts does not say: how they were judged, and what to keep in mind."""
    ports = ", ".join(map(str, found["ports"]))
    lines = [
        f"{found['features']} features of {found['window_s'] * 1e9:g} ns on ports {ports}; all begin with the first "
        f"{found['first_shots']} of {found['shots']} shots; those that follow learn each later one after predicting it"
    ]
    if found["passes"] > 1:
        lines.append(
            f"the run has {found['passes']} passes, one after the other: where the bench drifts, ports of different "
            "passes saw another fibre at the same shot; --ports of one pass are what one machine sees at once"
        )
    return lines


def _accuracy(right: NDArray[np.bool_]) -> dict[str, Any]:
    return {"accuracy": float(np.mean(right)), "interval": list(interval(int(right.sum()), right.size))}
