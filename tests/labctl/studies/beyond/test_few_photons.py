from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.engine.inputs import images_for
from labctl.errors import AnalysisError
from labctl.studies.beyond.few_photons import Settings, conclude, examine
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.base import ShotKind
from protocols.image_readout import ImageReadout
from tests.labctl.studies.paper.conftest import write

PORTS, SAMPLES = (2, 3), 10
CODES, DARK_CODES = {"dim": 300, "better": 60, "bright": 1, "nothing": 0}, 40
"""Of a photon, and without light."""
PHOTONS = {"dim": 2.0, "better": 20.0, "bright": 4000.0, "nothing": 0.0}
SETTINGS = Settings(
    levels=("dim", "better"), bright="bright", photons=(0.5, 4.0, 200.0), windows=("0.4 ns",), wanted=0.8
)


@pytest.fixture
def twin(tmp_path: Path) -> TwinRuns:
    """Each class has speckle of its own; every run counts Poisson numbers of the same light."""
    protocol = ImageReadout(images=120, ports=PORTS, reference_every=3, window=SAMPLES * 40e-12)
    shots = list(protocol.shots(images_for(protocol)))
    speckle = np.random.default_rng(1).exponential(size=(4, len(PORTS), SAMPLES))
    lit = np.array([shot.kind is not ShotKind.DARK for shot in shots])
    light = speckle[[shot.label for shot in shots]] * lit[:, None, None]

    def codes(run: str) -> NDArray[np.int64]:
        counted = np.random.default_rng((2, CODES[run])).poisson(PHOTONS[run] * light)
        return np.asarray(DARK_CODES + CODES[run] * counted)

    runs = {run: write(tmp_path / run, shots, codes(run), PORTS, 40e-12) for run in CODES}
    return TwinRuns(runs, dict.fromkeys(runs, protocol), 1, 5)


def test_photons_are_measured_and_an_ideal_counter_does_the_same(twin: TwinRuns) -> None:
    findings = examine(twin, SETTINGS)
    mean = float(np.mean(np.random.default_rng(1).exponential(size=(4, len(PORTS), SAMPLES))))
    for level in SETTINGS.levels:
        assert findings.photons[level] == pytest.approx(PHOTONS[level] * mean, rel=0.15)
    concluded = conclude([findings, findings], SETTINGS)
    assert concluded.here["photons"]["better"]["mean"] == pytest.approx(findings.photons["better"])
    assert "80 % at 0.4 ns needs" in concluded.notes[0]
    ideal = {photons: result["mean"] for photons, result in concluded.here["ideal"]["0.4"].items()}
    assert list(ideal) == ["0.5", "4", "200"]
    assert ideal["0.5"] < ideal["200"] == 1.0
    receiver = concluded.here["receiver"]["0.4"]
    assert list(receiver) == ["4"], "as far as there is light"
    assert receiver["4"]["mean"] == pytest.approx(ideal["4"], abs=0.1)
    assert 0.5 <= concluded.here["photons_needed"]["ideal"]["0.4"] < 200
    assert [figure.stem for figure in concluded.figures] == ["photons"]


def test_a_level_whose_photons_cannot_be_counted_is_left_out(twin: TwinRuns) -> None:
    counted = examine(twin, SETTINGS)
    dark = examine(replace(twin, runs={**twin.runs, "dim": twin.runs["nothing"]}), SETTINGS)
    assert list(dark.photons) == list(dark.receiver["0.4"]) == ["better"]
    concluded = conclude([counted, dark], SETTINGS)
    assert concluded.here["photons"]["dim"]["mean"] == pytest.approx(counted.photons["dim"])
    assert concluded.here["benches_not_counted"] == {"dim": 1}
    assert "dim: on 1 of 2 benches the noise of photons cannot be told" in concluded.notes[-1]
    with pytest.raises(AnalysisError, match="at any level of light"):
        examine(replace(twin, runs=dict.fromkeys(twin.runs, twin.runs["nothing"])), SETTINGS)
