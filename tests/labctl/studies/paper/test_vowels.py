from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.analysis.intervals import pooled
from labctl.engine.inputs import sequences_for
from labctl.errors import AnalysisError
from labctl.studies.paper.twin_runs import TwinRuns
from labctl.studies.paper.vowels import WAYS, Findings, Settings, conclude, examine
from protocols.base import Sequences
from protocols.sequence_readout import SequenceReadout
from tests.data_sets import require

WriteRun = Callable[..., Path]
Record = Callable[[Callable[[Sequences], NDArray[np.float64]]], TwinRuns]
PORTS = (1, 2)
CLASSES = (0, 2, 4, 6)


@pytest.fixture
def record(tmp_path: Path, write_run: WriteRun) -> Record:
    """A run in which the ports show what a function makes, (n, ports, samples), of the n sequences that are played."""
    require("vowels")
    protocol = SequenceReadout(dataset="vowels", classes=CLASSES, ports=PORTS)
    inputs = sequences_for(protocol)
    shots = list(protocol.shots(inputs))
    place = {index: row for row, index in enumerate(inputs.indices.tolist())}
    order = [place[shot.dataset_index] for shot in shots]

    def recorded(shown: Callable[[Sequences], NDArray[np.float64]]) -> TwinRuns:
        run = write_run(tmp_path / "run", shots, np.round(shown(inputs)[order]), PORTS, 20e-12)
        return TwinRuns({"vowels": run}, {"vowels": protocol}, 1, 2)

    return recorded


@pytest.fixture
def played(record: Record) -> TwinRuns:
    """Port 1 shows noise, port 2 the numbers themselves."""

    def shown(inputs: Sequences) -> NDArray[np.float64]:
        noise = np.random.default_rng(1).normal(0, 100, inputs.values.shape)
        return np.repeat(np.stack([noise, 100 * inputs.values], axis=1), 4, axis=2)

    return record(shown)


def test_numbers_on_a_port_are_worth_as_much_as_the_numbers(played: TwinRuns) -> None:
    findings = examine(played, Settings(hidden=10))
    assert findings.classes == ("hid", "hEd", "hYd", "hOd")
    for way in WAYS:
        assert findings.accuracy[way].shape == (2, 2)
        assert findings.accuracy[way][0].mean() < 0.45, "noise is chance"
        assert findings.accuracy[way][1].mean() == pytest.approx(findings.regression[way].mean(), abs=0.1)
        assert findings.network[way].shape == (2,)
    assert findings.confusion["by_utterance"].sum() == findings.confusion["by_window"].sum() == 2 * 180
    assert findings.confusion["by_speaker"].sum() == 2 * 7 * 24


def test_an_utterance_that_is_found_again_is_no_vowel_recognised(record: Record) -> None:
    """Both ports show noise that is another for every utterance, the same for all of its six windows."""

    def shown(inputs: Sequences) -> NDArray[np.float64]:
        noise = np.random.default_rng(1).normal(0, 100, (inputs.groups.max() + 1, inputs.labels.max() + 1, 2, 40))
        found: NDArray[np.float64] = noise[inputs.groups, inputs.labels]
        return found

    accuracy = examine(record(shown), Settings(hidden=10)).accuracy
    assert accuracy["by_window"][-1].mean() > 0.9
    assert max(accuracy[way][-1].mean() for way in ("by_utterance", "by_speaker")) < 0.45, "chance is 0.25"


def test_utterances_that_were_not_played_are_refused(played: TwinRuns) -> None:
    other = SequenceReadout(dataset="vowels", classes=(1, 3), ports=PORTS)
    with pytest.raises(AnalysisError, match="not what its protocol plays"):
        examine(TwinRuns(played.runs, {"vowels": other}, 1, 2), Settings())


def finding(scores: list[list[float]], speakers: list[float]) -> Findings:
    """The same of every way: `scores` (ports, splits), and with either number of ports `speakers`."""
    return Findings(
        ("hid", "hEd"),
        {way: np.array(scores) for way in WAYS},
        {way: np.array([speakers, speakers]) for way in WAYS},
        {way: np.full((2, 2), 5) for way in WAYS},
        {way: np.array([0.8]) for way in WAYS},
        {way: np.array([0.9]) for way in WAYS},
    )


def test_twins_and_splits_are_pooled() -> None:
    one, other = ([[0.5, 0.6], [0.9, 1.0]], [[0.7, 0.8], [0.9, 1.0]])
    concluded = conclude([finding(one, [0.6, 0.7]), finding(other, [0.6, 0.7])], Settings())
    assert concluded.here["by_utterance"]["1"]["mean"] == pytest.approx(0.65)
    assert concluded.here["by_speaker"]["2"]["mean"] == pytest.approx(0.95)
    assert concluded.baseline["network of 100 neurons"]["by_utterance"]["mean"] == pytest.approx(0.9)
    assert [figure.stem for figure in concluded.figures] == ["confusion", "ports"]


def test_the_interval_is_as_wide_as_the_speakers_differ() -> None:
    """All benches are tested with the same speakers; one whom no split of a bench tested says nothing there."""
    scores = [[0.79, 0.81], [0.8, 0.8]]
    benches = [finding(scores, [0.6, 0.8, 1.0, np.nan]), finding(scores, [0.7, np.nan, 0.9, np.nan])]
    found = conclude(benches, Settings()).here["by_speaker"]["1"]
    speakers = pooled([0.65, 0.8, 0.95])
    assert (found["mean"], found["by_bench"]) == (pytest.approx(0.8), pytest.approx([0.8, 0.8]))
    assert (found["low"], found["high"]) == (pytest.approx(speakers["low"]), 1.0)
    assert conclude(benches[:1], Settings()).here["by_speaker"]["1"]["low"] is None, "one bench decides nothing"
