from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from labctl.engine.inputs import sequences_for
from labctl.errors import AnalysisError
from labctl.studies.paper.forecasting import Findings, Settings, chosen_ports, conclude, examine, stretch_and_next
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.sequence_readout import SequenceReadout
from tests.data_sets import require

WriteRun = Callable[..., Path]
PORTS = (1, 2, 3)
SMALL = Settings(train=200, test=90, washout=10, held_out=50, nodes=30)


@pytest.fixture
def played(tmp_path: Path, write_run: WriteRun) -> TwinRuns:
    """Port 1 shows noise, port 2 the value played, port 3 the one before; four samples a symbol."""
    require("santa-fe")
    protocol = SequenceReadout(symbols=300, ports=PORTS)
    inputs = sequences_for(protocol)
    values = inputs.values[0]
    noise = np.random.default_rng(1).normal(0, 50, values.size)
    codes = np.repeat(np.stack([noise, values, np.roll(values, 1)]), 4, axis=1)[np.newaxis]
    run = write_run(tmp_path / "run", list(protocol.shots(inputs)), np.round(codes), PORTS, 20e-12)
    return TwinRuns({"series": run}, {"series": protocol}, 1, 1)


def test_the_next_value_is_that_of_the_data_set(played: TwinRuns) -> None:
    series = stretch_and_next(played)
    values = sequences_for(played.protocols["series"]).values[0]
    np.testing.assert_array_equal(series[:-1], values)
    assert series.size == 301


def test_prediction_uses_what_the_ports_know(played: TwinRuns) -> None:
    findings = examine(played, SMALL)
    assert findings.ports == PORTS
    assert findings.chosen[:2] == (2, 3)
    assert findings.in_order.shape == findings.by_choice.shape == (3,)
    assert findings.in_order[0] == pytest.approx(1.0, abs=0.1), "noise predicts no better than the mean"
    assert findings.by_choice[1] < findings.by_choice[0] < findings.in_order[0]
    assert findings.by_choice[-1] == pytest.approx(findings.in_order[-1])
    assert findings.target.shape == findings.predicted.shape == (90,)
    concluded = conclude([findings, findings], SMALL)
    assert concluded.here["by_choice"]["3"]["mean"] == pytest.approx(findings.by_choice[2])
    assert set(concluded.baseline) == {"AR(10)", "echo-state network of 30 nodes"}
    assert [figure.stem for figure in concluded.figures] == ["responses", "prediction", "ports"]


def test_a_run_that_is_too_short_or_of_another_stretch_is_refused(
    played: TwinRuns, tmp_path: Path, write_run: WriteRun
) -> None:
    with pytest.raises(AnalysisError, match="need one sequence of as many symbols"):
        examine(played, Settings())
    with pytest.raises(AnalysisError, match="is not the one its protocol plays"):
        stretch_and_next(TwinRuns(played.runs, {"series": SequenceReadout(symbols=300, ports=PORTS, seed=2)}, 1, 1))
    with pytest.raises(AnalysisError, match="no value follows the last one"):
        stretch_and_next(TwinRuns(played.runs, {"series": SequenceReadout(ports=PORTS)}, 1, 1))


def test_ports_are_chosen_by_what_they_add() -> None:
    generator = np.random.default_rng(1)
    strong, weak, noise = generator.standard_normal((3, 400))
    features = np.stack([noise, weak, strong], axis=1)[:, :, np.newaxis]
    assert chosen_ports(features, 2 * strong + weak, held_out=100) == [2, 1, 0]
    with pytest.raises(AnalysisError, match="hold out fewer"):
        chosen_ports(features, strong, held_out=400)


def test_twins_are_pooled() -> None:
    def finding(error: float) -> Findings:
        curve = np.array([2 * error, error])
        wave = np.sin(np.arange(40.0))
        return Findings((1, 2), (2, 1), curve, curve, wave, wave + error, wave[:10], np.ones((2, 40)), 20e-12, 0.2, 0.1)

    concluded = conclude([finding(0.1), finding(0.3)], Settings())
    assert concluded.here["in_order"]["2"]["by_bench"] == [0.1, 0.3]
    assert concluded.here["in_order"]["2"]["sd"] == pytest.approx(np.sqrt(0.02))
    assert concluded.baseline["AR(10)"]["mean"] == pytest.approx(0.2)
