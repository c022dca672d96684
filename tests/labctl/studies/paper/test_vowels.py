from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from labctl.engine.inputs import sequences_for
from labctl.errors import AnalysisError
from labctl.studies.paper.twin_runs import TwinRuns
from labctl.studies.paper.vowels import WAYS, Findings, Settings, conclude, examine
from protocols.sequence_readout import SequenceReadout
from tests.data_sets import require

WriteRun = Callable[..., Path]
PORTS = (1, 2)
CLASSES = (0, 2, 4, 6)


@pytest.fixture
def played(tmp_path: Path, write_run: WriteRun) -> TwinRuns:
    """Port 1 shows noise, port 2 the numbers themselves."""
    require("vowels")
    protocol = SequenceReadout(dataset="vowels", classes=CLASSES, ports=PORTS)
    inputs = sequences_for(protocol)
    shots = list(protocol.shots(inputs))
    rows = {index: row for row, index in enumerate(inputs.indices.tolist())}
    numbers = inputs.values[[rows[shot.dataset_index] for shot in shots]]
    noise = np.random.default_rng(1).normal(0, 100, numbers.shape)
    codes = np.repeat(np.stack([noise, 100 * numbers], axis=1), 4, axis=2)
    run = write_run(tmp_path / "run", shots, np.round(codes), PORTS, 20e-12)
    return TwinRuns({"vowels": run}, {"vowels": protocol}, 1, 2)


def test_numbers_on_a_port_are_worth_as_much_as_the_numbers(played: TwinRuns) -> None:
    findings = examine(played, Settings(hidden=10))
    assert findings.classes == ("hid", "hEd", "hYd", "hOd")
    for way in WAYS:
        assert findings.accuracy[way].shape == (2, 2)
        assert findings.accuracy[way][0].mean() < 0.45, "noise is chance"
        assert findings.accuracy[way][1].mean() == pytest.approx(findings.regression[way].mean(), abs=0.1)
        assert findings.network[way].shape == (2,)
    assert findings.confusion["random"].sum() == 2 * 180
    assert findings.confusion["by_speaker"].sum() == 2 * 7 * 24


def test_utterances_that_were_not_played_are_refused(played: TwinRuns) -> None:
    other = SequenceReadout(dataset="vowels", classes=(1, 3), ports=PORTS)
    with pytest.raises(AnalysisError, match="not what its protocol plays"):
        examine(TwinRuns(played.runs, {"vowels": other}, 1, 2), Settings())


def test_twins_and_splits_are_pooled() -> None:
    def finding(scores: list[list[float]]) -> Findings:
        each = {way: np.array(scores) for way in WAYS}
        counts = {way: np.full((2, 2), 5) for way in WAYS}
        return Findings(
            ("hid", "hEd"), each, counts, {way: np.array([0.8]) for way in WAYS}, {way: np.array([0.9]) for way in WAYS}
        )

    concluded = conclude([finding([[0.5, 0.6], [0.9, 1.0]]), finding([[0.7, 0.8], [0.9, 1.0]])], Settings())
    assert concluded.here["random"]["1"]["mean"] == pytest.approx(0.65)
    assert concluded.here["by_speaker"]["2"]["mean"] == pytest.approx(0.95)
    assert concluded.baseline["network of 100 neurons"]["random"]["mean"] == pytest.approx(0.9)
    assert [figure.stem for figure in concluded.figures] == ["confusion", "ports"]
