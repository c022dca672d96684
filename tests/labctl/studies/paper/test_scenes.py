from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from labctl.engine.inputs import images_for
from labctl.errors import AnalysisError
from labctl.studies.paper.scenes import Findings, Settings, conclude, examine
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.dynamic_scene import DynamicScene
from protocols.image_readout import ImageReadout

WriteRun = Callable[..., Path]
PERIOD, SAMPLES, WINDOW = 2500, 250_000, 14
LEVELS = 500 * np.random.default_rng(1).standard_normal((4, 2, WINDOW))
"""What a window of each class looks like, in codes."""


def twin_runs(folder: Path, write_run: WriteRun, *, new: int = 2, wrong_at_rest: int | None = None) -> TwinRuns:
    """Class 1 until the mirrors are half-way, then class `new`; one scene's first image may be wrong at rest."""
    still, moving = ImageReadout(images=40, ports=(2, 3)), DynamicScene(images=40, scenes=2, ports=(2, 3))
    inputs = images_for(still)
    shots, scenes = list(still.shots(inputs)), list(moving.shots(inputs))
    generator = np.random.default_rng(2)
    labels = np.array([shot.label for shot in shots])
    if wrong_at_rest is not None:
        hidden = [number for number, shot in enumerate(shots) if shot.dataset_index == scenes[wrong_at_rest].group]
        labels[hidden] = 3
    codes = LEVELS[labels] + generator.normal(0, 20, (len(shots), 2, WINDOW))
    records = np.zeros((len(scenes), 2, SAMPLES), np.int16)
    for start in range(0, SAMPLES, PERIOD):
        label = 1 if start * 40e-12 < 5.6e-6 else new
        records[:, :, start : start + WINDOW] = LEVELS[label] + generator.normal(0, 20, (len(scenes), 2, WINDOW))
    runs = {
        "static": write_run(folder / "static", shots, codes, (2, 3), 40e-12),
        "scenes": write_run(folder / "scenes", scenes, records, (2, 3), 40e-12),
    }
    return TwinRuns(runs, {"static": still, "scenes": moving}, 1, 1)


def test_the_switch_is_seen_when_the_mirrors_move(tmp_path: Path, write_run: WriteRun) -> None:
    findings = examine(twin_runs(tmp_path, write_run), Settings())
    scene = findings.scenes[0]
    assert scene.labels == (1, 2)
    assert scene.transit_s == pytest.approx((5.1e-6, 6.1e-6))
    assert (int(scene.old.sum()), int(scene.new.sum())) == (51, 38)
    assert scene.time_s[scene.old].max() < 5.1e-6
    assert scene.time_s[scene.new].min() > 6.1e-6
    assert scene.stays_s == scene.crossing_s == pytest.approx(5.6e-6)
    here = conclude([findings], Settings()).here
    assert here["scenes_judged"] == here["fewest_judged_of_a_twin"] == here["scenes_certain_at_rest"] == 2
    assert here["judged_of_a_twin"]["mean"] == 2
    for name in ("scenes_right", "scenes_right_of_certain", "single_windows_right"):
        assert here[name]["by_bench"] == [1.0]
    for name in ("switch_by_class", "switch_by_correlation"):
        assert here[name]["share_within_1_us"]["mean"] == 1.0
    assert here["switch_by_class"]["furthest_off_us"] == 0.0


def test_a_scene_with_an_image_that_is_wrong_at_rest_is_not_judged(tmp_path: Path, write_run: WriteRun) -> None:
    findings = examine(twin_runs(tmp_path, write_run, wrong_at_rest=0), Settings())
    assert [scene.at_rest for scene in findings.scenes] == [(False, True), (True, True)]
    assert conclude([findings], Settings()).here["scenes_judged"] == 1


def test_scenes_are_counted_over_benches(tmp_path: Path, write_run: WriteRun) -> None:
    findings = examine(twin_runs(tmp_path, write_run, wrong_at_rest=0), Settings())
    none = Findings(findings.classes, findings.scenes[:1])
    here = conclude([findings, findings, none], Settings()).here
    for counts in (here["scenes_right"], here["switch_by_correlation"]["share_within_1_us"]):
        assert (counts["right"], counts["counted"], counts["mean"]) == (2, 2, 1.0)
        assert counts["low"] < 0.4, "two scenes show little"
    assert (here["twins_judged"]["right"], here["twins_judged"]["counted"]) == (2, 3)
    judged = here["judged_of_a_twin"]
    assert 0 <= judged["low"] < judged["high"] <= 2, "of a twin's two scenes"


def test_an_image_that_never_comes_is_reported(tmp_path: Path, write_run: WriteRun) -> None:
    findings = examine(twin_runs(tmp_path, write_run, new=3), Settings())
    concluded = conclude([findings], Settings())
    assert concluded.here["before_right"]["mean"] == 1.0
    assert concluded.here["after_right"]["mean"] == concluded.here["scenes_right"]["mean"] == 0.0
    assert concluded.here["switch_by_class"]["share_within_1_us"]["mean"] == 0.0
    assert concluded.here["switch_by_class"]["time_us"] is None
    assert [figure.stem for figure in concluded.figures] == ["switch"]


def test_scenes_and_images_at_rest_must_be_of_one_seed(tmp_path: Path, write_run: WriteRun) -> None:
    found = twin_runs(tmp_path, write_run)
    other = DynamicScene(images=40, scenes=2, ports=(2, 3), seed=2)
    shots = list(other.shots(images_for(other)))
    run = write_run(tmp_path / "other", shots, np.zeros((2, 2, 20_000)), (2, 3), 40e-12)
    with pytest.raises(AnalysisError, match="were not measured at rest: give both runs one seed"):
        examine(TwinRuns({**found.runs, "scenes": run}, found.protocols, 1, 1), Settings())


def test_a_record_that_ends_before_the_switch_is_refused(tmp_path: Path, write_run: WriteRun) -> None:
    found = twin_runs(tmp_path, write_run)
    moving = found.protocols["scenes"]
    shots = list(moving.shots(images_for(found.protocols["static"])))
    run = write_run(tmp_path / "short", shots, np.zeros((2, 2, 20_000)), (2, 3), 40e-12)
    with pytest.raises(AnalysisError, match="no window lies wholly before or behind the switch"):
        examine(TwinRuns({**found.runs, "scenes": run}, found.protocols, 1, 1), Settings())


def test_a_run_that_switches_nothing_is_refused(tmp_path: Path, write_run: WriteRun) -> None:
    found = twin_runs(tmp_path, write_run)
    with pytest.raises(AnalysisError, match="image-readout switches no images"):
        examine(TwinRuns(found.runs, {**found.protocols, "scenes": found.protocols["static"]}, 1, 1), Settings())


def test_nothing_to_judge_is_an_error(tmp_path: Path, write_run: WriteRun) -> None:
    findings = examine(twin_runs(tmp_path, write_run, wrong_at_rest=0), Settings())
    with pytest.raises(AnalysisError, match="measure more scenes"):
        conclude([type(findings)(findings.classes, findings.scenes[:1])], Settings())
