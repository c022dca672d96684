"""How short a look at an image may be before a computer with all its pixels does better."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from matplotlib.figure import Figure

from labctl.analysis.intervals import Statistic, difference
from labctl.reports.canvas import Level, Series
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.window import interval_figure
from labctl.studies.paper import recognition
from labctl.studies.paper.analyses import Analysis, Conclusion
from labctl.studies.paper.recognition import Findings, Settings
from labctl.studies.paper.twin_runs import TAU_S

CAPTION = "Accuracy less that of logistic regression on all pixels of the same images and splits; over benches."
ROUNDING = 1e-9


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """The curves of the recognition, each less raw pixels bench by bench, and the first T_N at which that is no loss.

    `shortest_ns` is the shortest T_N whose mean reaches that of raw pixels, `surely_ns` the shortest whose interval
    over benches lies above it as a whole; None where no T_N does.
    """
    recognised = recognition.conclude(findings, settings)
    raw = recognised.baseline["raw_pixels"]
    less = {
        curve.key: {window: difference(found, raw) for window, found in recognised.here[curve.key].items()}
        for curve in settings.curves
    }
    here: dict[str, Any] = recognised.here | {
        "raw_pixels": raw,
        "less_raw_pixels": less,
        "shortest_ns": {key: _first(windows, "mean") for key, windows in less.items()},
        "surely_ns": {key: _first(windows, "low") for key, windows in less.items()},
    }
    notes = tuple(
        f"{curve.label}: raw pixels are reached at {_text(here['shortest_ns'][curve.key])}, by the whole interval over "
        f"benches at {_text(here['surely_ns'][curve.key])}."
        for curve in settings.curves
    )
    figure = ExperimentFigure("less-raw-pixels", _figure(less, settings), CAPTION)
    return replace(recognised, here=here, figures=(*recognised.figures, figure), notes=notes)


ANALYSIS = Analysis(Settings, recognition.examine, conclude)


def _first(windows: dict[str, Statistic], end: str) -> float | None:
    """The shortest T_N, ns, whose `end` is not below zero by more than rounding."""
    kept = (float(window) for window, less in windows.items() if less[end] is not None and less[end] > -ROUNDING)
    return min(kept, default=None)


def _text(shortest_ns: float | None) -> str:
    return "no time measured" if shortest_ns is None else f"{shortest_ns:g} ns"


def _figure(less: dict[str, dict[str, Statistic]], settings: Settings) -> Figure:
    return interval_figure(
        [Series.with_intervals(curve.label, less[curve.key], unit=1e-9) for curve in settings.curves],
        tau_s=TAU_S,
        quantity="accuracy less raw pixels (points)",
        levels=[Level("raw pixels", 0.0)],
    )
