"""Which class an image is of: accuracy against acquisition time for any ports, wavelengths and runs, and confusion."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveInt

from instruments.units import Seconds
from labctl.analysis.baselines import numerical_network_accuracy, raw_pixel_accuracy
from labctl.analysis.evaluation import validate, window_key
from labctl.analysis.intervals import SHARE, pooled
from labctl.analysis.learning_curve import learning_curve
from labctl.analysis.splits import Split
from labctl.analysis.windows import sample_count
from labctl.reports.canvas import Level, Series
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.confusion import confusion_figure
from labctl.reports.figures.images import images_figure
from labctl.reports.figures.learning import learning_figure
from labctl.reports.figures.window import PAPER_CLAIM, accuracy_figure
from labctl.runs.read.records import Records
from labctl.studies.paper.analyses import Analysis, AnalysisSettings, Conclusion
from labctl.studies.paper.twin_runs import TAU_S, TEST_PART, TwinRuns, window_features
from protocols.settings import Ports


class CurveSettings(BaseModel):
    """One curve: which records it is learned from.

    Attributes:
        key: Its name in the results.
        label: Its name in the figure.
        run: Name of the run.
        ports: Ports used; None = all of the run.
        wavelengths: How many of the run's wavelengths, the first ones; None = all.
        stretch: Its windows are longer than the named ones by this factor: equal numbers of features on fewer ports.
        windows: Acquisition times of its own.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str
    label: str
    run: str
    ports: Ports | None = None
    wavelengths: PositiveInt | None = None
    stretch: PositiveInt = 1
    windows: tuple[Seconds, ...] | None = None


class Settings(AnalysisSettings):
    """Settings of the analysis.

    Attributes:
        windows: Acquisition times T_N.
        curves: The curves; digital baselines are made from the images of the first one's run, on as many ports.
        confusion_window: T_N of the confusion matrices; None = no matrices.
        confusion: Keys of the curves that have one.
        classes: Names of the classes.
        numerical_windows: T_N for which the paper's numerical network is trained.
        numerical_splits: On how many of the splits.
        learning_window: T_N of the learning curve; None = none.
        learning_sizes: Numbers of training images.
        show_runs: Runs of which the images of each class are shown, by binarisation.
        claim: Whether the paper's claim of 90 % from 0.4 ns on belongs into the figure.
    """

    windows: Annotated[tuple[Seconds, ...], Field(min_length=1)]
    curves: Annotated[tuple[CurveSettings, ...], Field(min_length=1)]
    confusion_window: Seconds | None = None
    confusion: tuple[str, ...] = ()
    classes: tuple[str, ...]
    numerical_windows: tuple[Seconds, ...] = ()
    numerical_splits: PositiveInt = 2
    learning_window: Seconds | None = None
    learning_sizes: tuple[PositiveInt, ...] = ()
    show_runs: tuple[str, ...] = ()
    claim: bool = False

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return (*(curve.run for curve in self.curves), *self.show_runs)


Scores = NDArray[np.float64]


@dataclass(frozen=True)
class Findings:
    """What one twin shows: scores (splits,) of each curve at each T_N (text, ns), and of the baselines."""

    scores: dict[str, dict[str, Scores]]
    confusion: dict[str, NDArray[np.int64]]
    raw_pixels: Scores
    numerical: dict[str, dict[str, Scores]]
    learning: dict[int, Scores]
    shown: dict[str, NDArray[np.bool_]]


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """Train and test every curve of one twin, and the digital baselines on the same splits of the same images."""
    scores: dict[str, dict[str, Scores]] = {}
    confusion: dict[str, NDArray[np.int64]] = {}
    for curve in settings.curves:
        records = _records(twin, curve)
        splits = twin.random_splits(records)
        scores[curve.key] = {}
        for window_s in curve.windows or settings.windows:
            judged = validate(window_features(records, window_s * curve.stretch), records.labels, splits)
            scores[curve.key][window_key(window_s)] = judged.scores
            if curve.key in settings.confusion and window_s == settings.confusion_window:
                confusion[curve.key] = judged.confusion
    first = settings.curves[0]
    records = _records(twin, first)
    images = twin.images_at(first.run, records.groups)
    splits = twin.random_splits(records)
    return Findings(
        scores,
        confusion,
        twin.once("raw pixels", partial(raw_pixel_accuracy, images, records.labels, splits)),
        twin.once(
            "numerical", partial(_numerical, images, records, splits[: settings.numerical_splits], settings, twin.seed)
        ),
        _learning(records, settings, twin),
        {run: _examples(twin, run, len(settings.classes)) for run in settings.show_runs},
    )


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """Pool all twins and splits."""
    here: dict[str, Any] = {
        curve.key: {
            window: pooled((found.scores[curve.key][window] for found in findings), within=SHARE)
            for window in findings[0].scores[curve.key]
        }
        for curve in settings.curves
    }
    raw = pooled((found.raw_pixels for found in findings), within=SHARE)
    baseline: dict[str, Any] = {"raw_pixels": raw} | {
        rows: {
            window: pooled((found.numerical[rows][window] for found in findings), within=SHARE) for window in windows
        }
        for rows, windows in findings[0].numerical.items()
    }
    figures = [_accuracy(here, baseline, settings)]
    if settings.confusion:
        figures.append(_confusion(findings, settings))
    if settings.learning_sizes:
        here["learning"] = {
            str(size): pooled((found.learning[size] for found in findings), within=SHARE)
            for size in findings[0].learning
        }
        figures.append(_learning_curve(here["learning"], raw["mean"], settings))
    figures += [
        ExperimentFigure(
            f"images-{run}", images_figure(images, settings.classes), f"One image of each class as shown in run {run}."
        )
        for run, images in findings[0].shown.items()
    ]
    return Conclusion(here, baseline, tuple(figures))


def confusions(findings: Sequence[Findings], settings: Settings) -> dict[str, NDArray[np.int64]]:
    """Test images of all splits and twins, true class by row and predicted class by column, by curve and T_N."""
    labels = {curve.key: curve.label for curve in settings.curves}
    window_ns = f"{(settings.confusion_window or 0) * 1e9:g} ns"
    return {
        f"{labels[key]}, {window_ns}": np.sum([found.confusion[key] for found in findings], axis=0)
        for key in settings.confusion
    }


ANALYSIS = Analysis(Settings, examine, conclude)


def _records(twin: TwinRuns, curve: CurveSettings) -> Records:
    return twin.records(curve.run, wavelengths=curve.wavelengths, ports=curve.ports)


def _examples(twin: TwinRuns, run: str, classes: int) -> NDArray[np.bool_]:
    shown = twin.images(run)
    return np.stack(
        [shown.images[np.flatnonzero(shown.labels == label)[0]] for label in np.unique(shown.labels)[:classes]]
    )


def _numerical(
    images: NDArray[np.bool_], records: Records, splits: Sequence[Split], settings: Settings, seed: int
) -> dict[str, dict[str, Scores]]:
    """The paper's numerical network: as many neurons as the bench has features; N rows of masks, and M N rows."""
    ports = records.traces.shape[1]
    found: dict[str, dict[str, Scores]] = {}
    for name, per_port in (("numerical_network_n_rows", 1), ("numerical_network_mn_rows", ports)):
        found[name] = {
            window_key(window_s): numerical_network_accuracy(
                images,
                records.labels,
                splits,
                rows=per_port * sample_count(window_s, TAU_S),
                hidden=ports * sample_count(window_s, TAU_S),
                seed=seed,
            )
            for window_s in settings.numerical_windows
        }
    return {name: windows for name, windows in found.items() if windows}


def _learning(records: Records, settings: Settings, twin: TwinRuns) -> dict[int, Scores]:
    if settings.learning_window is None:
        return {}
    points = learning_curve(
        window_features(records, settings.learning_window),
        records.labels,
        records.groups,
        settings.learning_sizes,
        splits=twin.splits,
        test_size=TEST_PART,
        seed=twin.seed,
    )
    return {point.images: point.scores for point in points}


def _accuracy(here: dict[str, Any], baseline: dict[str, Any], settings: Settings) -> ExperimentFigure:
    names = {
        "numerical_network_n_rows": "numerical network, $N$ mask rows",
        "numerical_network_mn_rows": "numerical network, $MN$ mask rows",
    }
    drawn = [(curve.label, here[curve.key]) for curve in settings.curves]
    drawn += [(label, baseline[name]) for name, label in names.items() if name in baseline]
    figure = accuracy_figure(
        [Series.of(label, accuracy, unit=1e-9) for label, accuracy in drawn],
        tau_s=TAU_S,
        chance=1 / len(settings.classes),
        claim=PAPER_CLAIM if settings.claim else None,
        levels=[Level("raw pixels, digital", baseline["raw_pixels"]["mean"])],
    )
    return ExperimentFigure(
        "accuracy",
        figure,
        "Accuracy on test images against acquisition time; mean and standard deviation over twins and splits.",
    )


def _confusion(findings: Sequence[Findings], settings: Settings) -> ExperimentFigure:
    return ExperimentFigure(
        "confusion",
        confusion_figure(list(confusions(findings, settings).items()), settings.classes),
        "Test images of all splits and twins: true class by row, share of each predicted class in per cent.",
    )


def _learning_curve(learning: dict[str, Any], raw: float, settings: Settings) -> ExperimentFigure:
    series = Series.of(f"with the chip, {(settings.learning_window or 0) * 1e9:g} ns", learning)
    figure = learning_figure(series, chance=1 / len(settings.classes), levels=[Level("raw pixels, 900 images", raw)])
    return ExperimentFigure("learning", figure, "Accuracy against the number of training images, same test images.")
