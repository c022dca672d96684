from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from labctl.engine.inputs import images_for
from labctl.errors import AnalysisError
from labctl.studies.beyond.whole_sets import Settings, conclude, examine
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.base import ShotKind
from protocols.image_readout import ImageReadout
from tests.data_sets import require
from tests.labctl.studies.paper.conftest import write

CLASSES = tuple("0123456789")


def settings() -> Settings:
    sets = [{"key": "digits", "label": "digits", "run": "all", "classes": CLASSES}]
    return Settings.model_validate({"sets": sets, "windows": ["0.4 ns", "0.8 ns"], "landmarks": 100})


def twin_runs(folder: Path, dataset: str, images: int) -> TwinRuns:
    """Images through random positive masks, with noise; every twentieth shot is none of an image."""
    protocol = ImageReadout(dataset=dataset, images=images, ports=(2, 3))
    inputs = images_for(protocol)
    shots = protocol.shots(inputs)
    generator = np.random.default_rng(3)
    masks = generator.exponential(size=(28 * 28, 40))
    places = {int(index): place for place, index in enumerate(inputs.indices)}
    shown = np.stack(
        [
            inputs.images[places[shot.dataset_index]] if shot.kind is ShotKind.IMAGE else np.zeros((28, 28))
            for shot in shots
        ]
    )
    codes = shown.reshape(len(shots), -1) @ masks * 10 + generator.normal(0, 20, (len(shots), 40))
    run = write(folder / "all", list(shots), codes.reshape(-1, 2, 20).astype(np.int16), (2, 3), 40e-12)
    return TwinRuns({"all": run}, {"all": protocol}, 1, 1)


def test_readouts_of_traces_and_of_pixels_are_judged_on_the_sets_own_test_part(tmp_path: Path) -> None:
    require("mnist")
    twin = twin_runs(tmp_path, "mnist", 1000)
    found = examine(twin, settings())
    digits = found["digits"]
    rows = images_for(ImageReadout(dataset="mnist", images=1000)).indices
    assert [digits.trained, digits.tested] == [int(np.sum(rows < 60_000)), int(np.sum(rows >= 60_000))]
    assert digits.confusion.sum() == digits.tested
    for name in ("linear", "kernel"):
        assert list(digits.traces[name]) == ["0.4", "0.8"]
        assert digits.traces[name]["0.8"] > 0.4, "guessing reaches 0.1"
        assert digits.pixels[name] > 0.75

    concluded = conclude([found], settings())
    linear = concluded.here["digits"]["linear"]["0.8"]
    assert linear["low"] < linear["mean"] == digits.traces["linear"]["0.8"] < linear["high"]
    assert concluded.baseline["digits"]["kernel"]["mean"] == digits.pixels["kernel"]
    assert [figure.stem for figure in concluded.figures] == ["accuracy-digits", "confusion-digits"]
    assert all(isinstance(figure.figure, Figure) for figure in concluded.figures)


def test_a_set_without_a_test_part_of_its_own_is_refused(tmp_path: Path) -> None:
    twin = twin_runs(tmp_path, "mnist-0-3", 40)
    with pytest.raises(AnalysisError, match=r"^runs.all: data set 'mnist-0-3' has no test part of its own"):
        examine(twin, settings())
