from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from labctl.engine.inputs import images_for
from labctl.errors import AnalysisError
from labctl.studies.paper.cracks import Settings, conclude, examine
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.image_readout import ImageReadout
from tests.labctl.reports.figures.drawn import visible_words

WriteRun = Callable[..., Path]
NORMAL, CRACKS, SIDE = 60, 20, 16


def settings(**changes: object) -> Settings:
    rules = [{"key": "own", "label": "own rule", "run": "own"}]
    return Settings.model_validate(
        {"rules": rules, "window": "0.4 ns", "train": 40, "alpha": 0.01, "examples": 3, "paper": 0.978} | changes
    )


def twin_runs(folder: Path, write_run: WriteRun, *, averages: int = 1) -> TwinRuns:
    """Bright images with some dark dots or a dark stripe, through random positive masks."""
    generator = np.random.default_rng(3)
    images = generator.random((NORMAL + CRACKS, SIDE, SIDE)) > 0.05
    images[NORMAL:, :, 4:8] = False
    np.savez(folder / "walls.npz", images=images, labels=np.repeat([0, 1], [NORMAL, CRACKS]))
    protocol = ImageReadout(dataset=str(folder / "walls.npz"), images=(NORMAL, CRACKS), ports=(2, 3))
    inputs = images_for(protocol)
    shots = list(protocol.shots(inputs)) * averages
    masks = generator.exponential(size=(SIDE * SIDE, 20))
    shown = np.stack([images[shot.dataset_index] * (shot.dataset_index >= 0) for shot in shots])
    codes = shown.reshape(len(shots), -1) @ masks + generator.normal(0, 1, (len(shots), 20))
    run = write_run(folder / "own", shots, codes.reshape(-1, 2, 10), (2, 3), 40e-12)
    return TwinRuns({"own": run}, {"own": protocol}, 1, 3)


def test_cracks_differ_from_what_was_learnt(tmp_path: Path, write_run: WriteRun) -> None:
    found = examine(twin_runs(tmp_path, write_run), settings())
    twin = found["own"]
    assert {name: len(splits) for name, splits in twin.scores.items()} == {"normality": 3, "covariance": 3}
    for split in (split for splits in twin.scores.values() for split in splits):
        assert (split.normal.size, split.crack.size) == (NORMAL - 40, CRACKS)
    assert twin.normal.shape == twin.crack.shape == (3, SIDE, SIDE)
    assert twin.normal.mean() > twin.crack.mean()
    concluded = conclude([found, found], settings())
    assert concluded.here["own"]["normality"]["mean"] > 0.95
    assert concluded.here["own"]["covariance"]["mean"] > 0.95
    assert concluded.here["own"]["found"]["covariance"]["mean"] > 0.9
    assert concluded.baseline["own"]["dark_pixels"]["mean"] == pytest.approx(1.0)
    stems = [figure.stem for figure in concluded.figures]
    assert stems == ["scores-normality", "scores-covariance", "roc", "examples"]
    assert "3 %" in concluded.notes[0]
    assert any("unusual share of dark pixels" in words for words in visible_words(concluded.figures[2].figure))
    assert "by Otsu's rule cracks have fewer of them" in concluded.notes[1]


def test_splits_differ_and_follow_from_the_seed(tmp_path: Path, write_run: WriteRun) -> None:
    given = twin_runs(tmp_path, write_run)
    first, again = (examine(given, settings())["own"].scores["covariance"] for _ in range(2))
    assert [split.threshold for split in first] == [split.threshold for split in again]
    assert len({split.threshold for split in first}) == 3


def test_every_normal_image_in_training_leaves_none_to_test(tmp_path: Path, write_run: WriteRun) -> None:
    with pytest.raises(AnalysisError, match="60 normal shots, 60 to train on"):
        examine(twin_runs(tmp_path, write_run), settings(train=NORMAL))


def test_repeats_of_an_image_are_refused(tmp_path: Path, write_run: WriteRun) -> None:
    with pytest.raises(AnalysisError, match="each image once"):
        examine(twin_runs(tmp_path, write_run, averages=2), settings())


@pytest.mark.parametrize("wrong", [{"train": 0}, {"alpha": 0}, {"false_alarms": 1}, {"rules": []}, {"strange": 1}])
def test_settings_that_make_no_sense(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        settings(**wrong)
