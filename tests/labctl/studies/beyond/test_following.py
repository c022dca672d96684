from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.analysis.prequential import READOUTS
from labctl.engine.inputs import images_for
from labctl.errors import AnalysisError
from labctl.studies.beyond.following import Settings, conclude, examine
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.base import Shot
from protocols.image_readout import ImageReadout
from tests.labctl.studies.paper.conftest import write

PORTS, SAMPLES, IMAGES = (2, 3), 10, 600
TURNS = {"still": 0.0, "drifting": 1.0}
"""Quarters of a turn, over the run, from one class's speckle to that of the next."""
SETTINGS = Settings.model_validate(
    {
        "drifts": [{"key": name, "label": name, "run": name} for name in TURNS],
        "windows": ["0.4 ns", "0.2 ns"],
        "first": 100,
        "last": 100,
        "block": 100,
        "chance": 0.25,
    }
)


def codes(shots: list[Shot], turns: float) -> NDArray[np.int64]:
    """Each class has speckle of its own, which turns into that of the next one."""
    generator = np.random.default_rng(1)
    speckle = generator.normal(size=(4, len(PORTS), SAMPLES))
    labels = np.array([shot.label for shot in shots])
    angle = (np.linspace(0, turns, len(shots)) * np.pi / 2)[:, np.newaxis, np.newaxis]
    light = np.cos(angle) * speckle[labels] + np.sin(angle) * speckle[(labels + 1) % 4]
    noisy = light + 0.6 * generator.normal(size=light.shape)
    return np.asarray(1000 * noisy, np.int64)


def twin(folder: Path, repeats: int = 1) -> TwinRuns:
    protocol = ImageReadout(images=IMAGES // repeats, ports=PORTS, window=SAMPLES * 40e-12)
    shots = list(protocol.shots(images_for(protocol))) * repeats
    runs = {name: write(folder / name, shots, codes(shots, turns), PORTS, 40e-12) for name, turns in TURNS.items()}
    return TwinRuns(runs, dict.fromkeys(runs, protocol), 1, 5)


def test_those_that_follow_are_better_where_it_drifts(tmp_path: Path) -> None:
    found = examine(twin(tmp_path), SETTINGS)
    concluded = conclude([found, found], SETTINGS)
    accuracy = {
        drift: {name: concluded.here[drift]["0.4"][name]["mean"] for name in READOUTS}
        for drift in ("still", "drifting")
    }
    assert min(accuracy["still"].values()) > 0.95
    assert min(accuracy["drifting"][name] for name in ("rls", "nlms")) > 0.75
    assert max(accuracy["drifting"][name] for name in ("softmax", "ridge")) < 0.3
    assert concluded.here["still"]["0.2"].keys() == READOUTS.keys()
    assert [figure.stem for figure in concluded.figures] == ["following"]


def test_images_that_are_shown_twice_judge_nothing(tmp_path: Path) -> None:
    with pytest.raises(AnalysisError, match="images are shown for the first time after the first 100: measure more"):
        examine(twin(tmp_path, repeats=2), SETTINGS)
