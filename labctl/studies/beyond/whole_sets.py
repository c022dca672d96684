"""Whole data sets by their own split: linear and kernel readouts of the traces beside the same of the pixels."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveInt
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from instruments.units import Seconds
from labctl.analysis.baselines import kernel_of_pixels_accuracy, raw_pixel_accuracy
from labctl.analysis.evaluation import CrossValidation, validate, window_key
from labctl.analysis.intervals import Statistic, interval
from labctl.analysis.kernel import KernelClassifier
from labctl.analysis.splits import Split, own_split
from labctl.datasets import catalogue
from labctl.errors import AnalysisError
from labctl.reports.canvas import Level, Series
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.confusion import confusion_figure
from labctl.reports.figures.window import interval_figure
from labctl.runs.read.records import Records
from labctl.studies.paper.analyses import Analysis, AnalysisSettings, Conclusion
from labctl.studies.paper.twin_runs import TAU_S, TwinRuns, window_features

LABELS = {"linear": "linear readout", "kernel": "kernel readout"}


class SetSettings(BaseModel):
    """One data set: `key` names it in the results, `label` in the figures; `run` shows all of it; names of classes."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str
    label: str
    run: str
    classes: tuple[str, ...]


class Settings(AnalysisSettings):
    """Settings of the analysis.

    Attributes:
        sets: The data sets.
        windows: Acquisition times T_N; the confusion is shown for the last.
        landmarks: Of the kernel readouts, see `KernelClassifier`.
    """

    sets: Annotated[tuple[SetSettings, ...], Field(min_length=1)]
    windows: Annotated[tuple[Seconds, ...], Field(min_length=1)]
    landmarks: PositiveInt = 2000

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return tuple(one.run for one in self.sets)


@dataclass(frozen=True)
class SetFindings:
    """What one twin shows of one data set: accuracies on its test part, by readout, of the traces also by T_N (ns).

    Attributes:
        trained, tested: Images of either part.
        traces: Readout -> T_N -> accuracy.
        pixels: Readout -> accuracy.
        confusion: Of the linear readout at the last T_N, (k, k) test images.
    """

    trained: int
    tested: int
    traces: dict[str, dict[str, float]]
    pixels: dict[str, float]
    confusion: NDArray[np.int64]


Findings = dict[str, SetFindings]


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """Train every readout on the training part of each set and test it on the test part."""
    return {one.key: _examined(twin, one.run, settings) for one in settings.sets}


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """Put all twins together, set by set."""
    here: dict[str, Any] = {}
    baseline: dict[str, Any] = {}
    figures: list[ExperimentFigure] = []
    for one in settings.sets:
        found = [twin[one.key] for twin in findings]
        tested = found[0].tested
        here[one.key] = {
            name: {window: _statistic((twin.traces[name][window] for twin in found), tested) for window in windows}
            for name, windows in found[0].traces.items()
        } | {"trained": found[0].trained, "tested": tested}
        baseline[one.key] = {
            name: _statistic((twin.pixels[name] for twin in found), tested) for name in found[0].pixels
        }
        figures += [_accuracy(one, here[one.key], baseline[one.key]), _confusion(one, found, settings)]
    note = (
        "low and high are Wilson's interval of 95 % over the test images; other benches are tested on the same images "
        "and do not make it narrower. The kernel readouts are kernel ridge regression on "
        f"{settings.landmarks} training shots as landmarks, fitted on all; width and penalty are chosen inside the "
        "training part."
    )
    return Conclusion(here, baseline, tuple(figures), (note,))


ANALYSIS = Analysis(Settings, examine, conclude)


def _examined(twin: TwinRuns, run: str, settings: Settings) -> SetFindings:
    records = twin.records(run)
    labels, rows, split = records.labels, records.groups, _split(twin, run, records)
    traces, confusion = _of_traces(records, split, settings, twin.seed)
    del records  # what the pixels need comes on top of nothing
    images = twin.images_at(run, rows)
    kernel = kernel_of_pixels_accuracy(images, labels, [split], landmarks=settings.landmarks, seed=twin.seed)
    pixels = {"linear": float(raw_pixel_accuracy(images, labels, [split])[0]), "kernel": float(kernel[0])}
    return SetFindings(split[0].size, split[1].size, traces, pixels, confusion)


def _of_traces(
    records: Records, split: Split, settings: Settings, seed: int
) -> tuple[dict[str, dict[str, float]], NDArray[np.int64]]:
    accuracy: dict[str, dict[str, float]] = {name: {} for name in LABELS}
    for window_s in settings.windows:
        judged = _of_window(records, window_s, split, settings, seed)
        for name, found in judged.items():
            accuracy[name][window_key(window_s)] = float(found.scores[0])
    return accuracy, judged["linear"].confusion


def _of_window(
    records: Records, window_s: float, split: Split, settings: Settings, seed: int
) -> dict[str, CrossValidation]:
    features = window_features(records, window_s)
    kernel = make_pipeline(StandardScaler(), KernelClassifier(settings.landmarks, seed=seed))
    return {
        "linear": validate(features, records.labels, [split]),
        "kernel": validate(features, records.labels, [split], readout=kernel),
    }


def _split(twin: TwinRuns, run: str, records: Records) -> Split:
    name = getattr(twin.protocols[run], "dataset", None)
    first_test = next((card.first_test for card in catalogue() if card.name == name), None)
    if first_test is None:
        raise AnalysisError(f"runs.{run}: data set {name!r} has no test part of its own: show one that has")
    return own_split(records.groups, first_test)


def _statistic(by_bench: Iterable[float], tested: int) -> Statistic:
    """As `pooled` gives it, but with the interval over test images, which a single bench has too."""
    scores = np.array(list(by_bench))
    mean = float(scores.mean())
    low, high = interval(round(mean * tested), tested)
    spread = float(scores.std(ddof=1)) if scores.size > 1 else 0.0
    return {"mean": mean, "sd": spread, "se": None, "low": low, "high": high, "by_bench": scores.tolist(), "splits": 1}


def _accuracy(one: SetSettings, here: dict[str, Any], baseline: dict[str, Any]) -> ExperimentFigure:
    figure = interval_figure(
        [Series.with_intervals(f"{label}, traces", here[name], unit=1e-9) for name, label in LABELS.items()],
        tau_s=TAU_S,
        quantity="accuracy on the test part (%)",
        levels=[Level(f"{name}, pixels", baseline[name]["mean"]) for name in LABELS],
    )
    caption = f"{one.label}: accuracy on {here['tested']} test images after training on {here['trained']}."
    return ExperimentFigure(f"accuracy-{one.key}", figure, caption)


def _confusion(one: SetSettings, found: Sequence[SetFindings], settings: Settings) -> ExperimentFigure:
    title = f"{LABELS['linear']}, {settings.windows[-1] * 1e9:g} ns"
    figure = confusion_figure([(title, np.sum([twin.confusion for twin in found], axis=0))], one.classes)
    caption = f"{one.label}: test images, true class by row, share of each predicted class in per cent."
    return ExperimentFigure(f"confusion-{one.key}", figure, caption)
