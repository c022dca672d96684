"""The report of an image recognition: accuracy against acquisition time, confusion, traces, where it came from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from instruments.ports import port_name
from labctl.reports.canvas import Series
from labctl.reports.figures.confusion import confusion_figure
from labctl.reports.figures.traces import traces_figure
from labctl.reports.figures.window import Claim, accuracy_figure
from labctl.reports.page import CarryOut, Result, embedded, write_report
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.origin import Origin
from labctl.runs.read.run import Run, open_run, volts

Accuracy = Mapping[str, Mapping[str, float]]
"""Acquisition time in ns as text -> {"mean", "sd"} of the accuracy."""


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
    chance: float,
    tau_s: float,
    claim: Claim | None,
    carried_out: CarryOut[str],
) -> Path:
    """Write `figures/` and `report.html` of the run in `directory` and return the path of the report.

    Args:
        directory: Run directory; its traces and its manifest are shown.
        title: Headline.
        summary: What was done and what came out, one paragraph.
        accuracies: One curve for each name; without any neither they nor `confusions` are drawn.
        results: Paper against here.
        confusions: One matrix each.
        classes: Names of the classes, in the order of the matrices.
        chance: What guessing reaches, 0..1.
        tau_s: Interval of the features, s.
        claim: What the figure of the accuracy marks; None = nothing.
        carried_out: Who lets the figures be drawn.
    """
    paths = RunPaths(directory)
    curves = [Series.of(name, accuracy, unit=1e-9) for name, accuracy in accuracies.items()]
    with open_run(directory) as run:
        manifest = run.manifest
        traces = _traces(run, classes)
    figures = {"traces": traces}
    if curves:
        figures |= {
            "accuracy": accuracy_figure(curves, tau_s=tau_s, chance=chance, claim=claim),
            "confusion": confusion_figure([(confusion.title, confusion.counts) for confusion in confusions], classes),
        }
    write_report(
        paths.report,
        "recognition.html",
        title=title,
        summary=summary,
        results=results,
        names=list(accuracies),
        rows=_rows(accuracies) if accuracies else [],
        manifest=manifest,
        pictures=carried_out(
            {
                name: partial(embedded, figure, paths.figures / name, Origin.of(manifest))
                for name, figure in figures.items()
            }
        ),
    )
    return paths.report


def _rows(accuracies: Mapping[str, Accuracy]) -> list[list[str]]:
    """Mean and spread by acquisition time, a column for each name."""
    windows = next(iter(accuracies.values()))
    return [
        [
            window,
            *(f"{accuracy[window]['mean']:.3f} ± {accuracy[window]['sd']:.3f}" for accuracy in accuracies.values()),
        ]
        for window in windows
    ]


def _traces(run: Run, classes: Sequence[str]) -> Figure:
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
        ports=[port_name(port) for port in run.ports],
    )
