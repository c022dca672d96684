from pathlib import Path

import numpy as np
import pytest

from labctl.engine.inputs import images_for
from labctl.errors import AnalysisError
from labctl.studies.beyond.analogue_readout import Settings, conclude, examine
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.base import ShotKind
from protocols.image_readout import ImageReadout
from tests.labctl.studies.paper.conftest import write

PORTS, SAMPLES = (2, 3), 10
NOISE_CODES = 0.5
"""Rms of every record's own noise, in front of its rounding; the mean of the light is about 1500."""
SETTINGS = Settings(
    run="chip",
    bright="bright",
    windows=("0.2 ns", "0.4 ns"),
    bits=(1, 6),
    counted_window="0.4 ns",
    counted_bits=6,
    photons=(1, 1000, 100000),
)


@pytest.fixture
def twin(tmp_path: Path) -> TwinRuns:
    """Each class has speckle of its own, which varies from image to image."""
    protocol = ImageReadout(images=200, ports=PORTS, window=SAMPLES * 40e-12)
    shots = list(protocol.shots(images_for(protocol)))
    generator = np.random.default_rng(1)
    speckle = 1 + generator.exponential(0.5, size=(4, len(PORTS), SAMPLES))
    lit = np.array([shot.kind is not ShotKind.DARK for shot in shots])
    light = speckle[[shot.label for shot in shots]] * lit[:, None, None]
    images = [shot.kind is ShotKind.IMAGE for shot in shots]
    light[images] *= generator.gamma(6, 1 / 6, light[images].shape)
    codes = np.rint(1000 * light + generator.normal(0, NOISE_CODES, light.shape))
    runs = {run: write(tmp_path / run, shots, codes, PORTS, 40e-12) for run in ("chip", "bright")}
    return TwinRuns(runs, dict.fromkeys(runs, protocol), 1, 4)


def test_what_levels_and_shared_photons_cost(twin: TwinRuns) -> None:
    concluded = conclude([examine(twin, SETTINGS)], SETTINGS)
    here, baseline = concluded.here, concluded.baseline
    for window in ("0.2", "0.4"):
        for bits in ("1", "6"):
            lost = baseline["digital"][window]["mean"] - here["trained"][window][bits]["mean"]
            assert here["loss"][window][bits]["mean"] == pytest.approx(lost)
        assert here["loss"][window]["6"]["mean"] < 0.03
    assert list(here["counted"]) == ["1", "1000", "100000"]
    assert here["counted_loss"]["1"]["mean"] > 0.1 > here["counted_loss"]["100000"]["mean"]
    assert [figure.stem for figure in concluded.figures] == ["bits", "photons"]
    assert here["bright_noise_photons"]["mean"] == pytest.approx(1500**2 / (NOISE_CODES**2 + 1 / 12), rel=0.3)


def test_no_more_photons_are_drawn_than_the_bright_run_can_stand_for(twin: TwinRuns) -> None:
    asked = SETTINGS.model_copy(update={"photons": (1, 10_000_000)})
    with pytest.raises(AnalysisError, match=r"runs\.bright has as much noise as .* not 1e\+07: .* more averages"):
        examine(twin, asked)
