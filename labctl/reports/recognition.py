"""The report of an image recognition: accuracy against acquisition time, confusion, traces, where it came from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.reports.figures import (
    Curve,
    accuracy_figure,
    confusion_figure,
    save_figure,
    traces_figure,
)
from labctl.reports.page import Paragraph, Picture, Result, Results, Section, Table, mapping_section, write_report
from labctl.runs.format.layout import RunPaths
from labctl.runs.read.run import Run, open_run, volts

Accuracy = Mapping[str, Mapping[str, float]]
"""Acquisition time in ns as text -> {"mean", "sd"} of the accuracy."""

PORT_NAMES = {0: "before the chip"}


@dataclass(frozen=True)
class Confusion:
    """Test shots over all splits: true class by row, predicted class by column, shape (k, k)."""

    title: str
    counts: NDArray[np.int64]


def recognition_report(
    directory: Path,
    *,
    title: str,
    summary: str,
    accuracies: Mapping[str, Accuracy],
    results: Sequence[Result],
    confusions: Sequence[Confusion],
    classes: Sequence[str],
) -> Path:
    """Write `figures/` and `report.html` of the run in `directory` and return the path of the report.

    Args:
        directory: Run directory; its traces and its manifest are shown.
        title: Headline.
        summary: What was done and what came out, one paragraph.
        accuracies: One curve for each name.
        results: Paper against here.
        confusions: One matrix each.
        classes: Names of the classes, in the order of the matrices.
    """
    paths = RunPaths(directory)
    paths.figures.mkdir(exist_ok=True)
    curves = [_curve(name, accuracy) for name, accuracy in accuracies.items()]
    with open_run(directory) as run:
        interval = run.shape.sample_interval_s
        figures = (
            (
                "accuracy",
                accuracy_figure(curves, tau_s=interval, chance=1 / len(classes)),
                "Accuracy on test images against the acquisition time; bands are one standard deviation over splits.",
            ),
            (
                "confusion",
                confusion_figure([(confusion.title, confusion.counts) for confusion in confusions], list(classes)),
                "Test images of all splits, true class by row.",
            ),
            ("traces", _traces(run, classes), "One image of each class on every port; time 0 is the trigger."),
        )
        manifest = run.manifest
    pictures = []
    for name, figure, caption in figures:
        _, svg = save_figure(figure, paths.figures / name)
        pictures.append(Picture(svg, caption, caption))
    write_report(
        paths.report,
        title=title,
        sections=(
            Section("What came out", (Paragraph(summary), Results(results), pictures[0], _table(accuracies))),
            Section("Which classes are taken for which", (pictures[1],)),
            Section("What the oscilloscope saw", (pictures[2],)),
            mapping_section("Where it came from", manifest),
        ),
    )
    return paths.report


def _curve(name: str, accuracy: Accuracy) -> Curve:
    return Curve(
        name,
        [float(window) * 1e-9 for window in accuracy],
        [reached["mean"] for reached in accuracy.values()],
        [reached["sd"] for reached in accuracy.values()],
    )


def _table(accuracies: Mapping[str, Accuracy]) -> Table:
    windows = next(iter(accuracies.values()))
    rows = [
        (
            window,
            *(f"{accuracy[window]['mean']:.3f} ± {accuracy[window]['sd']:.3f}" for accuracy in accuracies.values()),
        )
        for window in windows
    ]
    return Table(("T_N (ns)", *accuracies), rows)


def _traces(run: Run, classes: Sequence[str]) -> Any:
    shots = run.shots
    images = np.flatnonzero(shots["kind"] == "image")
    labels = shots["label"][images]
    chosen = np.array([images[np.flatnonzero(labels == label)[0]] for label in np.unique(labels)])
    order = np.argsort(chosen)
    frames = np.empty((chosen.size, *run.frames.shape[1:]), run.frames.dtype)
    frames[order] = run.frames[chosen[order]]
    return traces_figure(
        run.time,
        volts(frames, run.scale, run.offset),
        shots=[f"class {name}" for name in classes],
        ports=[PORT_NAMES.get(port, f"port {port}") for port in run.ports],
    )
