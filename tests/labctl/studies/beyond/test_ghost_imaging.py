"""Imaging without training images, on small runs of the simulated bench."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION
from labctl.errors import AnalysisError
from labctl.studies.beyond.ghost_imaging import ANALYSIS, Findings, Settings
from labctl.studies.paper.experiments import Experiment, experiments
from labctl.studies.paper.reproduction import Plan, Reproduced, reproduce
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.base import Measurement
from tests.data_sets import require

pytestmark = pytest.mark.usefixtures("one_core")

SMALLER = {"images": 20, "wavelengths": "1550 nm", "ports": "2-5"}


def small() -> Experiment:
    """The experiment of the house with one wavelength, fewer pictures and a single kind of image."""
    (whole,) = experiments(("b1",))
    runs = {name: whole.runs[name] for name in ("digits-finer", "scenes")}
    runs = {name: run.model_copy(update={"settings": run.settings | SMALLER}) for name, run in runs.items()}
    runs["digits-finer"].settings["patterns"] = 300
    settings = whole.settings | {"sets": whole.settings["sets"][2:3], "wavelengths": [1], "windows": ["2 ns", "10 ns"]}
    return whole.model_copy(update={"runs": runs, "settings": settings, "must": whole.must[2:3]})


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory: pytest.TempPathFactory) -> Reproduced:
    require("mnist")
    plan = Plan((small(),), SIMULATED_STATION, tmp_path_factory.mktemp("runs"), seeds=1, first_seed=101)
    (found,), failed = reproduce(plan, interruption=Interruption())
    assert not failed
    return found


@pytest.mark.timeout(600)
def test_unseen_digits_come_back_by_masks_of_random_patterns(reproduced: Reproduced) -> None:
    conclusion = reproduced.columns[0].conclusion
    here, baseline = conclusion.here["digits-finer"], conclusion.baseline["digits-finer"]
    for reading in ("one_frame", "two_frames"):
        errors = here[reading]["1"]
        assert errors["10.0"]["mean"] < errors["2.0"]["mean"]
        assert errors["10.0"]["mean"] < baseline["constant"]["mean"]
        assert here["patterns"][reading]["1"]["10.0"]["mean"] < 0.5, "0.5 is what a grey image has"
    assert [figure.stem for figure in conclusion.figures] == ["images-digits-finer", "rmse-digits-finer", "film"]


def test_the_film_has_100_million_frames_a_second_and_sees_the_switch(reproduced: Reproduced) -> None:
    film = reproduced.columns[0].conclusion.here["film"]
    assert film["frames_per_second"] == pytest.approx(100e6)
    assert film["mirrors_move_us"] == pytest.approx([1, 2])
    found: Findings = reproduced.columns[0].findings[0]
    assert found.film is not None
    assert np.diff(found.film.time_s) == pytest.approx(10e-9)
    assert found.film.time_s.size == 300
    frames, (first, second) = found.film.frames["one_frame"], found.film.pair
    for mean, here, gone in (
        (frames[found.film.old].mean(axis=0), first, second),
        (frames[found.film.new].mean(axis=0), second, first),
    ):
        likeness = np.corrcoef([image.ravel() for image in (mean, here, gone)])[0]
        assert likeness[1] > likeness[2]


def test_runs_of_another_kind_are_named(reproduced: Reproduced) -> None:
    directories = dict(zip(("digits-finer", "scenes"), reproduced.runs, strict=True))
    protocols = small().protocols
    settings = Settings.model_validate(small().settings)
    swapped = {"digits-finer": protocols["scenes"], "scenes": protocols["scenes"]}
    with pytest.raises(AnalysisError, match="dynamic-scene shows no random patterns"):
        ANALYSIS.examine(TwinRuns(directories, swapped, 101, 1), settings)
    longer = settings.model_copy(update={"windows": (20e-9,), "film": None})
    with pytest.raises(AnalysisError, match="500 samples do not fit into a record of 250"):
        ANALYSIS.examine(TwinRuns(directories, _seeded(protocols), 101, 1), longer)
    late = settings.film and settings.film.model_copy(update={"arrives": 3e-6})
    with pytest.raises(AnalysisError, match="no window lies wholly before or behind the switch"):
        ANALYSIS.examine(TwinRuns(directories, _seeded(protocols), 101, 1), settings.model_copy(update={"film": late}))


def _seeded(protocols: Mapping[str, Measurement[Any]]) -> dict[str, Measurement[Any]]:
    return {name: protocol.model_copy(update={"seed": 101}) for name, protocol in protocols.items()}
