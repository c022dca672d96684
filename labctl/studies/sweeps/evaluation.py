"""What a sweep says: how well a readout works at each of its points, and whether the bench drifted meanwhile."""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from labctl.analysis.recognition import recognition
from labctl.errors import AnalysisError, writing
from labctl.reports.canvas import Series
from labctl.reports.figure_files import save_figure
from labctl.reports.figures.sweep import sweep_figure
from labctl.runs.format.origin import Origin
from labctl.runs.format.store import alone
from labctl.runs.read.records import read_records
from labctl.runs.read.run import open_run
from labctl.runs.sweep import read
from labctl.runs.sweep_axes import as_numbers
from labctl.studies.sweeps.run_folder import begun, runs_of
from labctl.studies.tasks import one_by_one

FIGURES = "figures"
Judged = dict[str, Any]
Answer = Judged | AnalysisError
"""How a run is judged; or why it is not, where it lacks shots still."""


def evaluate_sweep(
    directory: Path,
    *,
    window_s: float | None = None,
    ports: Sequence[int] | None = None,
    carried_out: Callable[[Mapping[str, Callable[[], Answer]]], Mapping[str, Answer]] = one_by_one,
) -> dict[str, Any]:
    """Accuracy of a softmax readout at every point of a sweep that was measured, by random splits; draws its figure.

    A run that has begun is a point as soon as its images are enough.

    window_s: part of each record that the readout sees, None for all. ports: those that it sees, None for all. The
    interval is Wilson's, of the images that the splits test, each counted once. Runs at one point, such as the
    reference, are listed in the order they were measured: they differ by chance and by drift. carried_out: who reads
    the runs and judges them.

    Raises:
        AnalysisError: nothing is measured yet, or a run has no such window or ports, or too few images.
        RunError: no such sweep, or one of its runs is damaged, or another sweep's.
    """
    file = read(directory)
    runs, there = runs_of(directory, file), begun(directory, file)
    judged = carried_out({name: partial(_accuracy, alone(runs / name), window_s, ports) for name in there})
    rows = [
        {"run": name, **values, **found}
        for name, values in there.items()
        if not isinstance(found := judged[name], AnalysisError)
    ]
    if not rows:
        why = next((str(error) for error in judged.values()), "nothing is measured yet")
        raise AnalysisError(f"{directory}: {why}: go on with 'labctl resume {directory}'")
    axes = list(file.sweep.over)
    figure, origin = (
        _figure(rows, file.sweep.over, zipped=file.sweep.zip),
        Origin.of_runs(runs / row["run"] for row in rows),
    )
    with writing(directory / FIGURES, "make room"):
        (directory / FIGURES).mkdir(exist_ok=True)
        pictures = save_figure(figure, directory / FIGURES / "accuracy", origin)
    return {
        "sweep": str(directory),
        "axes": axes,
        "points": rows,
        "reference": _repeated(rows, axes),
        "figure": str(pictures.png),
    }


def _accuracy(run: Path, window_s: float | None, ports: Sequence[int] | None) -> Answer:
    with open_run(run) as opened:
        complete = opened.complete
        try:
            records = read_records(opened)
            found = recognition(
                records.traces,
                records.labels,
                records.groups,
                sample_interval_s=records.sample_interval_s,
                window_s=window_s,
                ports=ports,
                recorded_ports=records.ports,
            )
        except AnalysisError as error:
            if complete:
                raise
            return error
    return {
        "accuracy": found.accuracy,
        "interval": list(found.interval),
        "chance": found.chance,
        "judged_images": found.images,  # `images` may be an axis
        "complete": complete,
    }


def _repeated(rows: Sequence[Mapping[str, Any]], axes: Sequence[str]) -> list[float]:
    """Accuracies at the point that was measured most often, as they came; none where each was measured once."""
    at: dict[tuple[str, ...], list[float]] = {}
    for row in rows:
        at.setdefault(tuple(row[axis] for axis in axes), []).append(row["accuracy"])
    found = max(at.values(), key=len)
    return found if len(found) > 1 else []


def _figure(rows: list[dict[str, Any]], over: Mapping[str, Sequence[str]], *, zipped: bool = False) -> Any:
    """Against the axis with most values; a curve for each combination of the others, unless these go along with it."""
    along = max(over, key=lambda axis: len({row[axis] for row in rows}))
    beside = [axis for axis in over if axis != along]
    others = [] if zipped else beside
    values = [row[along] for row in rows]
    numbers, unit = as_numbers(values)
    texts = None if numbers is not None else [text for text in dict.fromkeys(over[along]) if text in values]
    at = numbers if numbers is not None else [float((texts or []).index(value)) for value in values]
    curves: dict[str, list[tuple[float, dict[str, Any]]]] = {}
    for place, row in zip(at, rows, strict=True):
        label = ", ".join(f"{axis} {row[axis]}" for axis in others) or "softmax readout"
        curves.setdefault(label, []).append((place, row))
    drawn = []
    for label in sorted(curves, key=_by_number):
        points = sorted(curves[label], key=lambda point: point[0])
        positions, accuracies, intervals = zip(
            *((place, row["accuracy"], row["interval"]) for place, row in points), strict=True
        )
        drawn.append(Series(label, positions, accuracies, [0.0] * len(points), intervals=intervals))
    chances = {row["chance"] for row in rows}
    chance = chances.pop() if len(chances) == 1 else None
    axis = ", with ".join([f"{along} ({unit})" if unit else along, *(beside if zipped else [])])
    return sweep_figure(drawn, axis=axis, ticks=texts, chance=chance)


def _by_number(label: str) -> tuple[float, str]:
    found = re.search(r"[-+]?\d+\.?\d*", label)
    return (float(found.group()) if found else 0.0), label
