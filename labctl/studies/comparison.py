"""Two runs side by side: what was set otherwise, how many shots, the same image, how well both are read."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.analysis.evaluation import (
    WindowAccuracy,
    accuracy_against_window,
    chance_of,
    mean_and_sd,
    window_key,
    windows_to_try,
)
from labctl.analysis.splits import enough_splits
from labctl.analysis.windows import WindowFeatures
from labctl.bench.drivers import sent_anew
from labctl.errors import AnalysisError
from labctl.printable import printable
from labctl.reports.canvas import Level, Series
from labctl.reports.figure_files import save_figure
from labctl.reports.figures.same_image import SameImage, same_image_figure
from labctl.reports.figures.window import accuracy_figure
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import protocol_settings
from labctl.runs.format.origin import Origin
from labctl.runs.read.differences import Difference, settings_that_differ
from labctl.runs.read.records import read_records
from labctl.runs.read.run import Run, open_run
from labctl.studies.inputs_of_runs import source_of
from labctl.studies.inspection import cannot_be_drawn, port_names, signals

MOST_SPLITS = 5
SEED = 1
MOST_IMAGES = 3

Columns = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Entries of the port axis of each of two runs that belong together."""


@dataclass(frozen=True)
class Comparison:
    """What two runs have in common and what not.

    Attributes:
        names: of the two runs.
        differences: settings that differ.
        shots: of each run: `planned`, `complete` and the number of each kind.
        same_image: records of images that both showed, on ports that both measured; None where there are none.
        accuracies: accuracy against the acquisition time of each run, on those ports; None where it has no labels.
        chances: what guessing reaches on each run, 0..1; None likewise.
        sample_interval_s: of the first run.
        origin: of the records of both.
        left_out: a line for everything that could not be compared.
    """

    names: tuple[str, str]
    differences: tuple[Difference, ...]
    shots: tuple[dict[str, int], dict[str, int]]
    same_image: SameImage | None
    accuracies: tuple[tuple[WindowAccuracy, ...] | None, tuple[WindowAccuracy, ...] | None]
    chances: tuple[float | None, float | None]
    sample_interval_s: float
    origin: Origin
    left_out: tuple[str, ...]


def compare(first: Path, second: Path) -> Comparison:
    """Read two runs and compare them.

    Raises:
        RunError: one of them is no run, or damaged.
    """
    left_out: list[str] = []
    same: SameImage | None = None
    accuracies: list[tuple[WindowAccuracy, ...] | None] = [None, None]
    chances: list[float | None] = [None, None]
    with open_run(first) as one, open_run(second) as other:
        columns = _common_columns(one, other)
        if not columns[0].size:
            left_out.append("traces and accuracy are left out: the runs have no port in common")
        else:
            try:
                same = _same_image((one, other), columns)
            except AnalysisError as error:
                left_out.append(f"traces are left out: {error}")
            for place, run in enumerate((one, other)):
                try:
                    accuracies[place], chances[place] = _accuracy(run, columns[place])
                except AnalysisError as error:
                    left_out.append(f"the accuracy of {run.path} is left out: {error}")
        return Comparison(
            _names(first, second),
            settings_that_differ(one.manifest, other.manifest, sent_anew),
            (_shots(one), _shots(other)),
            same,
            (accuracies[0], accuracies[1]),
            (chances[0], chances[1]),
            one.shape.sample_interval_s,
            Origin.together(Origin.of(run.manifest) for run in (one, other)),
            tuple(left_out),
        )


def draw(comparison: Comparison, out: Path) -> list[Path]:
    """Write `traces` and `accuracy` as PNG, SVG and PDF, as far as there is something to draw, into the folder `out`.

    Raises:
        RunError: they cannot be written.
    """
    pictures: list[Path] = []
    try:
        out.mkdir(parents=True, exist_ok=True)
        if comparison.same_image is not None:
            figure = same_image_figure(comparison.same_image, comparison.names)
            pictures.append(save_figure(figure, out / "traces", comparison.origin).png)
        if curves := [
            Series.of(name, {row.window_s: mean_and_sd(row.scores) for row in table})
            for name, table in zip(comparison.names, comparison.accuracies, strict=True)
            if table is not None
        ]:
            named = zip(comparison.chances, comparison.names, strict=True)
            (chance, _), *others = sorted((value, name) for value, name in named if value is not None)
            levels = [Level(f"chance of {name}", value) for value, name in others if value > chance]
            figure = accuracy_figure(curves, tau_s=comparison.sample_interval_s, chance=chance, levels=levels)
            pictures.append(save_figure(figure, out / "accuracy", comparison.origin).png)
    except OSError as error:
        raise cannot_be_drawn(out, error) from None
    return pictures


def as_json(comparison: Comparison) -> dict[str, Any]:
    """The comparison without its traces, as a JSON object."""
    same = comparison.same_image
    return {
        "runs": list(comparison.names),
        "differences": [asdict(one) for one in comparison.differences],
        "shots": list(comparison.shots),
        "same_image": None
        if same is None
        else {
            "dataset_index": [int(index) for index in same.dataset_index],
            "labels": [int(label) for label in same.labels],
            "correlation": _correlations(same),
        },
        "accuracy": [
            None if table is None else {window_key(row.window_s): mean_and_sd(row.scores) for row in table}
            for table in comparison.accuracies
        ],
        "left_out": list(comparison.left_out),
    }


def default_folder(first: Path, second: Path) -> Path:
    """Where the pictures lie if nobody says: in the figures of the first run, under the name of the second."""
    directory = first if first.is_dir() else first.parent
    return RunPaths(directory).figures / f"compared-with-{_names(first, second)[1]}"


def _names(first: Path, second: Path) -> tuple[str, str]:
    """The shortest names that tell two runs apart."""
    one, other = first.resolve(), second.resolve()
    names = (one.name, other.name) if one.name != other.name else (str(first), str(second))
    return printable(names[0]), printable(names[1])


def _correlations(same: SameImage) -> dict[str, float | None]:
    """Of the two records of each port over all images, 1 = same shape; None where they are not sampled alike."""
    if same.time_s[0].shape != same.time_s[1].shape or not np.allclose(*same.time_s, rtol=1e-9, atol=1e-15):
        return dict.fromkeys(same.ports)
    first, second = (np.swapaxes(volts, 0, 1).reshape(len(same.ports), -1) for volts in same.volts)
    return {
        port: float(np.corrcoef(one, other)[0, 1]) if np.ptp(one) and np.ptp(other) else None
        for port, one, other in zip(same.ports, first, second, strict=True)
    }


def _shots(run: Run) -> dict[str, int]:
    kinds, counts = np.unique(run.planned["kind"], return_counts=True)
    found = {str(kind): int(count) for kind, count in zip(kinds, counts, strict=True)}
    return {"planned": run.shape.shots, "complete": len(run.frames)} | found


def _common_columns(one: Run, other: Run) -> Columns:
    """Entries of each port axis that stand for the same port, at the same wavelength where ports have several."""
    several = any(len(set(run.ports)) < len(run.ports) for run in (one, other))
    traces = [
        list(zip(run.ports, run.shape.wavelength_of_port if several else run.ports, strict=True))
        for run in (one, other)
    ]
    common = [trace for trace in traces[0] if trace in traces[1]]
    first, second = (np.array([found.index(trace) for trace in common], np.intp) for found in traces)
    return first, second


def _same_image(runs: tuple[Run, Run], columns: Columns) -> SameImage:
    """One image each of up to `MOST_IMAGES` classes that both runs showed.

    Raises:
        AnalysisError: it is not known whether both showed the same image.
    """
    source = [_images_of(run.manifest) for run in runs]
    if source[0] is None or source[0] != source[1]:
        raise AnalysisError("the runs did not show images of one data set, made binary in one way")
    shots = [np.flatnonzero(run.planned["kind"] == "image") for run in runs]
    one, other = (run.planned["dataset_index"][at] for run, at in zip(runs, shots, strict=True))
    common, *places = np.intersect1d(one, other, return_indices=True)
    if not common.size:
        raise AnalysisError("the runs have no image in common")
    labels = runs[0].planned["label"][shots[0][places[0]]]
    _, chosen = np.unique(labels, return_index=True)
    chosen = chosen[:MOST_IMAGES]
    first, second = (
        np.concatenate([signals(run, at[[place]], column) for place in of[chosen]])
        for run, at, of, column in zip(runs, shots, places, columns, strict=True)
    )
    return SameImage(
        dataset_index=common[chosen],
        labels=labels[chosen],
        ports=tuple(port_names(runs[0])[place] for place in columns[0]),
        time_s=(runs[0].time - runs[0].shape.start_s, runs[1].time - runs[1].shape.start_s),
        volts=(first, second),
    )


def _images_of(manifest: Mapping[str, Any]) -> tuple[Any, ...] | None:
    """What makes images of two runs the same by their index: data set and binarisation; None where nobody says."""
    source, settings = source_of(manifest), protocol_settings(manifest)
    return None if source is None else (source, settings.get("binarisation", settings.get("threshold")))


def _accuracy(run: Run, columns: NDArray[np.intp]) -> tuple[tuple[WindowAccuracy, ...], float]:
    """Accuracy of the softmax readout on some entries of the port axis at each acquisition time, and chance.

    Raises:
        AnalysisError: the run has no labels to learn, or too few images.
    """
    records = read_records(run)
    if np.unique(records.labels).size < 2:
        raise AnalysisError("its images are of one class")
    found = accuracy_against_window(
        records.traces[:, columns],
        records.labels,
        records.groups,
        windows_s=windows_to_try(run.shape.samples, run.shape.sample_interval_s),
        window=WindowFeatures(sample_interval_s=run.shape.sample_interval_s),
        splits=min(MOST_SPLITS, enough_splits(np.unique(records.groups).size)),
        seed=SEED,
    )
    return found, chance_of(records.labels)
