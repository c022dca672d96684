"""Figure S3: vowels, ten numbers in series as phases of the light, recognised from the samples of every port."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import PositiveInt

from labctl.analysis.baselines import vowel_network_accuracy
from labctl.analysis.evaluation import validate
from labctl.analysis.intervals import SHARE, Statistic, pooled, wider
from labctl.analysis.splits import Split, random_splits
from labctl.datasets.cards import card
from labctl.datasets.sequences import group_splits
from labctl.errors import AnalysisError
from labctl.reports.canvas import Level, Series
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.confusion import confusion_figure
from labctl.reports.figures.ports import port_accuracy_figure
from labctl.runs.read.run import open_run
from labctl.studies.paper.analyses import Analysis, AnalysisSettings, Conclusion
from labctl.studies.paper.twin_runs import TwinRuns

DATA_SET = "vowels"
WAYS = {
    "by_utterance": "utterances kept together",
    "by_speaker": "unknown speakers",
    "by_window": "windows of an utterance on both sides",
}
"""What a split keeps on one side, and what to call it."""


class Settings(AnalysisSettings):
    """What is tested on the run `vowels`.

    Attributes:
        test: Windows of the test part of a split by utterance or by window.
        test_speakers: Speakers of the test part of a split by speaker.
        hidden: Neurons of the digital network.
    """

    test: PositiveInt = 180
    test_speakers: PositiveInt = 7
    hidden: PositiveInt = 100

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return ("vowels",)


@dataclass(frozen=True)
class Findings:
    """What one twin shows; the keys of the mappings are those of `WAYS`.

    Attributes:
        classes: Names of the vowels.
        accuracy: (M, splits) with the first 1..M ports.
        speakers: (M, speakers) on the windows of each speaker that any split tests; NaN where none does.
        confusion: (classes, classes) with all ports, counts over all splits.
        regression: (splits,) accuracy of logistic regression on the numbers themselves.
        network: (splits,) accuracy of the digital network on them.
    """

    classes: tuple[str, ...]
    accuracy: dict[str, NDArray[np.float64]]
    speakers: dict[str, NDArray[np.float64]]
    confusion: dict[str, NDArray[np.int64]]
    regression: dict[str, NDArray[np.float64]]
    network: dict[str, NDArray[np.float64]]


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """Accuracy against the number of ports, and of digital methods on the same windows and splits.

    Raises:
        AnalysisError: The run holds windows of speech that its protocol does not play.
    """
    played = twin.sequences("vowels")
    with open_run(twin.runs["vowels"]) as run:
        frames, ports, shots = run.volts(), len(run.ports), run.shots
    if strange := set(shots["dataset_index"].tolist()) - set(played.places):
        raise AnalysisError(f"sequences {sorted(strange)} of the run are not what its protocol plays: measure it again")
    rows = np.array([played.places[index] for index in shots["dataset_index"].tolist()])
    labels, speakers, numbers = played.labels[rows], played.groups[rows], played.values[rows]
    splits = _splits(labels, speakers, twin, settings)
    tables = {
        way: [validate(_features(frames, count), labels, chosen) for count in range(1, ports + 1)]
        for way, chosen in splits.items()
    }
    names = card(DATA_SET).classes
    network = partial(vowel_network_accuracy, numbers, labels, hidden=settings.hidden, seed=twin.seed)
    return Findings(
        classes=tuple(names[label] for label in np.unique(labels)),
        accuracy={way: np.stack([one.scores for one in table]) for way, table in tables.items()},
        speakers={way: np.stack([_by_speaker(one.right, speakers) for one in table]) for way, table in tables.items()},
        confusion={way: table[-1].confusion for way, table in tables.items()},
        regression={way: validate(numbers, labels, chosen).scores for way, chosen in splits.items()},
        network={way: twin.once(f"network, {way}", partial(network, chosen)) for way, chosen in splits.items()},
    )


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """Accuracy against the number of ports over all twins and splits, confusion with all ports."""
    first = findings[0]
    counts = list(range(1, 1 + len(first.accuracy["by_utterance"])))
    accuracy = {way: np.concatenate([one.accuracy[way] for one in findings], axis=1) for way in WAYS}
    here: dict[str, Any] = {
        way: {
            str(count): _over_benches_and_speakers(
                [one.accuracy[way][count - 1] for one in findings], [one.speakers[way][count - 1] for one in findings]
            )
            for count in counts
        }
        for way in WAYS
    }
    baseline = {
        name: {way: pooled((getattr(one, key)[way] for one in findings), within=SHARE) for way in WAYS}
        for name, key in (
            ("logistic regression on the numbers", "regression"),
            (f"network of {settings.hidden} neurons", "network"),
        )
    }
    curves = [
        Series(name, counts, accuracy[way].mean(axis=1).tolist(), accuracy[way].std(axis=1, ddof=1).tolist())
        for way, name in WAYS.items()
    ]
    panels = [(name, np.sum([one.confusion[way] for one in findings], axis=0)) for way, name in WAYS.items()]
    network = [Level("network", next(reversed(baseline.values()))["by_utterance"]["mean"])]
    return Conclusion(
        here,
        baseline,
        figures=(
            ExperimentFigure(
                "confusion",
                confusion_figure(panels, first.classes),
                f"Confusion of the vowels with {len(counts)} ports, all twins and splits together, for each split.",
            ),
            ExperimentFigure(
                "ports",
                port_accuracy_figure(curves, levels=network, chance=1 / len(first.classes)),
                "Accuracy against the number of ports, in the order of the waveguides; the line is the digital network "
                "on the numbers themselves, utterances kept together.",
            ),
        ),
        notes=(
            "The data set has 15 speakers who said each vowel once; its rows are six windows of each utterance. Kept "
            "together, an utterance is trained on or tested, and its speaker may be known by other vowels. Unknown "
            f"speakers are {settings.test_speakers} who were not trained on. Where windows of an utterance are on both "
            "sides, a readout need only find the utterance again.",
            "Every bench is tested with the same 15 speakers: intervals are as wide as benches or speakers make them.",
        ),
    )


def _features(frames: NDArray[Any], ports: int) -> NDArray[Any]:
    return frames[:, :ports].reshape(len(frames), -1)


def _by_speaker(right: NDArray[np.float64], speakers: NDArray[np.int64]) -> NDArray[np.float64]:
    """Accuracy on each speaker's windows, from that on each window: NaN stands for what was not tested in either."""
    _, place = np.unique(speakers, return_inverse=True)
    recognised, tested = np.bincount(place, np.nan_to_num(right)), np.bincount(place, ~np.isnan(right))
    shares: NDArray[np.float64] = np.full(tested.size, np.nan)
    return np.divide(recognised, tested, out=shares, where=tested > 0)


def _over_benches_and_speakers(
    scores: Sequence[NDArray[np.float64]], speakers: Sequence[NDArray[np.float64]]
) -> Statistic:
    """The mean over benches, with an interval for other benches and for other speakers: these are the same on all."""
    on_benches = np.stack(speakers)
    tested = ~np.isnan(on_benches).all(axis=0)
    over_speakers = pooled(np.nanmean(on_benches[:, tested], axis=0), within=SHARE)
    return wider(pooled(scores, within=SHARE), over_speakers["low"], over_speakers["high"])


def _splits(
    labels: NDArray[np.int64], speakers: NDArray[np.int64], twin: TwinRuns, settings: Settings
) -> dict[str, list[Split]]:
    utterances, windows = speakers * (labels.max() + 1) + labels, np.arange(labels.size)
    drawn = partial(random_splits, labels, splits=twin.splits, test_size=settings.test, seed=twin.seed)
    unknown = group_splits(speakers, splits=twin.splits, test_groups=settings.test_speakers, seed=twin.seed)
    return {"by_utterance": list(drawn(utterances)), "by_speaker": list(unknown), "by_window": list(drawn(windows))}


ANALYSIS = Analysis(Settings, examine, conclude)
