"""Cracks found as what differs from normal concrete: scores learnt from normal images, and shares of dark pixels."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveInt

from instruments.units import Seconds
from labctl.analysis.anomaly import CovarianceScore, NormalityScore, Roc, roc
from labctl.analysis.baselines import dark_pixels, dark_share
from labctl.analysis.intervals import SHARE, Statistic, pooled
from labctl.analysis.threads import one_thread
from labctl.errors import AnalysisError
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.images import ImageRow, image_rows_figure
from labctl.reports.figures.roc import RocCurve, roc_figure
from labctl.reports.figures.scores import scores_figure
from labctl.runs.read.records import Records
from labctl.studies.paper.analyses import Analysis, AnalysisSettings, Conclusion
from labctl.studies.paper.twin_runs import TwinRuns, window_features

NORMAL, CRACK = 0, 1
GRID = np.linspace(0, 1, 1001)
"""False positive rates at which the curves of all twins and splits are averaged."""
NAMES = {
    "normality": "readout $y$ → 1",
    "covariance": "covariance score",
    "dark_pixels": "unusual share of dark pixels, digital",
}
SYMBOLS = {"normality": "anomaly score $(y - 1)^2$", "covariance": "Mahalanobis distance"}


class RuleSettings(BaseModel):
    """A run by one binarisation rule; `key` names it in the results, `label` in the figures."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str
    label: str
    run: str


class Settings(AnalysisSettings):
    """Settings of the analysis.

    Attributes:
        rules: The runs, by binarisation rule; the figures are drawn of the first.
        window: Acquisition time T_N.
        train: How many normal images the scores are learnt from; all others test, with all cracks.
        alpha: Penalty of the readout that answers 1, as `NormalityScore` takes it.
        false_alarms: Share of the normal training images above the threshold.
        examples: How many images of each kind are shown.
        paper: Area under the curve in the paper, for the figure.
    """

    rules: Annotated[tuple[RuleSettings, ...], Field(min_length=1)]
    window: Seconds
    train: PositiveInt
    alpha: Annotated[float, Field(gt=0)]
    false_alarms: Annotated[float, Field(gt=0, lt=1)] = 0.03
    examples: PositiveInt = 6
    paper: float | None = None

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return tuple(rule.run for rule in self.rules)


@dataclass(frozen=True)
class ScoredSplit:
    """What one score does on one split.

    Attributes:
        curve: Its receiver operating characteristic on the test images.
        normal, crack: Scores of the test images of either kind.
        threshold: Score that the stated share of the normal training images exceeds.
    """

    curve: Roc
    normal: NDArray[np.float64]
    crack: NDArray[np.float64]
    threshold: float


@dataclass(frozen=True)
class RuleFindings:
    """One twin by one rule: the splits of each score, the share of dark pixels on the same, examples of either kind."""

    scores: dict[str, list[ScoredSplit]]
    dark_pixels: list[Roc]
    normal: NDArray[np.bool_]
    crack: NDArray[np.bool_]


Findings = dict[str, RuleFindings]


@dataclass(frozen=True)
class _Pictures:
    """The images of a rule without their pixels: share of dark ones (shots,), and examples of either kind."""

    dark: NDArray[np.float64]
    normal: NDArray[np.bool_]
    crack: NDArray[np.bool_]


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """Learn the scores from normal images of one twin and test them on the others, for every rule and split."""
    return {rule.key: _by_rule(twin, rule, settings) for rule in settings.rules}


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """Pool all twins and splits; the figures are of the first rule."""
    here: dict[str, Any] = {}
    baseline: dict[str, Any] = {}
    for rule in settings.rules:
        twins = [found[rule.key] for found in findings]
        names = list(twins[0].scores)
        here[rule.key] = {
            name: pooled(([split.curve.auc for split in twin.scores[name]] for twin in twins), within=SHARE)
            for name in names
        } | {
            "found": {
                name: pooled(([_found(split) for split in twin.scores[name]] for twin in twins), within=SHARE)
                for name in names
            }
        }
        areas = ([curve.auc for curve in twin.dark_pixels] for twin in twins)
        baseline[rule.key] = {"dark_pixels": pooled(areas, within=SHARE)}
    first = settings.rules[0]
    shown = [found[first.key] for found in findings]
    figures = [_histogram(shown[0], name, first.label) for name in NAMES if name in shown[0].scores]
    figures += [
        _characteristics(shown, first.label, {**here[first.key], **baseline[first.key]}, settings.paper),
        _examples(findings[0], settings),
    ]
    notes = (
        f"`found` is the share of the test cracks above the threshold that {100 * settings.false_alarms:g} % of the "
        "normal training images exceed.",
        "`dark_pixels`, digital: how far the share of dark pixels of an image is from the mean of the normal training "
        "images, either way, since by Otsu's rule cracks have fewer of them.",
    )
    return Conclusion(here, baseline, tuple(figures), notes)


ANALYSIS = Analysis(Settings, examine, conclude)


def _by_rule(twin: TwinRuns, rule: RuleSettings, settings: Settings) -> RuleFindings:
    records = twin.records(rule.run)
    features = window_features(records, settings.window)
    pictures = twin.once(f"pictures of {rule.run}", partial(_pictures, twin, rule.run, records, settings))
    makers: Mapping[str, Callable[[], Any]] = {
        "normality": partial(NormalityScore, settings.alpha),
        "covariance": CovarianceScore,
    }
    scores: dict[str, list[ScoredSplit]] = {name: [] for name in makers}
    counted = []
    cracks = np.flatnonzero(records.labels == CRACK)
    with one_thread():
        for train, test in _splits(records, settings.train, twin):
            tested = np.concatenate([test, cracks])
            for name, make in makers.items():
                score = make().fit(features[train])
                threshold = float(np.quantile(score.score_samples(features[train]), 1 - settings.false_alarms))
                values = score.score_samples(features[tested])
                curve = roc(values, np.arange(tested.size) >= test.size)
                scores[name].append(ScoredSplit(curve, values[: test.size], values[test.size :], threshold))
            abnormal = np.arange(tested.size) >= test.size
            counted.append(dark_pixels(pictures.dark[tested], abnormal, normal=pictures.dark[train]))
    return RuleFindings(scores, counted, pictures.normal, pictures.crack)


def _pictures(twin: TwinRuns, run: str, records: Records, settings: Settings) -> _Pictures:
    """What is needed of the photographs of a run: all of them by themselves are a hundred megabytes."""
    images = twin.images_at(run, records.groups)
    examples = (images[records.labels == label][: settings.examples] for label in (NORMAL, CRACK))
    return _Pictures(dark_share(images), *examples)


def _splits(records: Records, train: int, twin: TwinRuns) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Which normal shots are learnt from and which are left to test, for every split."""
    normal = np.flatnonzero(records.labels == NORMAL)
    if train >= normal.size or np.unique(records.groups).size != records.groups.size:
        raise AnalysisError(
            f"{normal.size} normal shots, {train} to train on: measure more of them, and each image once, so that some "
            "are left to test"
        )
    generator = np.random.default_rng((twin.seed, 5))
    drawn = [generator.permutation(normal) for _ in range(twin.splits)]
    return [(np.sort(order[:train]), np.sort(order[train:])) for order in drawn]


def _found(split: ScoredSplit) -> float:
    return float(np.mean(split.crack >= split.threshold))


def _histogram(shown: RuleFindings, name: str, rule: str) -> ExperimentFigure:
    split = shown.scores[name][0]
    figure = scores_figure(split.normal, split.crack, threshold=split.threshold, score=SYMBOLS[name])
    return ExperimentFigure(
        f"scores-{name}",
        figure,
        f"Scores of normal images and cracks that were not learnt from: {NAMES[name]}, {rule}, first twin and split. "
        "The threshold comes from the training images.",
    )


def _characteristics(
    twins: Sequence[RuleFindings], rule: str, areas: Mapping[str, Statistic], paper: float | None
) -> ExperimentFigure:
    curves = {name: [split.curve for twin in twins for split in twin.scores[name]] for name in twins[0].scores}
    curves["dark_pixels"] = [curve for twin in twins for curve in twin.dark_pixels]
    drawn = []
    for name, every in curves.items():
        mean = np.mean([np.interp(GRID, curve.false_positive, curve.true_positive) for curve in every], axis=0)
        drawn.append(RocCurve(NAMES[name], [0.0, *GRID], [0.0, *mean], areas[name]["mean"], areas[name]["sd"]))
    return ExperimentFigure(
        "roc",
        roc_figure(drawn, paper=paper),
        f"Cracks found against normal images taken for cracks, {rule}; mean over twins and splits.",
    )


def _examples(found: Findings, settings: Settings) -> ExperimentFigure:
    rows = []
    for rule in settings.rules:
        shown = found[rule.key]
        rows += [
            ImageRow(f"normal\n{rule.label}", shown.normal),
            ImageRow(f"crack\n{rule.label}", shown.crack),
        ]
    return ExperimentFigure(
        "examples", image_rows_figure(rows), "Images as the mirrors showed them: normal concrete and cracks, by rule."
    )
