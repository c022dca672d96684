"""The fitted number: where the paper's crossing is met, or missed least, and which values are not told from it."""

from pathlib import Path

import pytest

from labctl.analysis.intervals import pooled
from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION
from labctl.errors import ExperimentError
from labctl.studies.paper.experiments import experiments
from labctl.studies.paper.fit import Tried, as_json, concluded, figure_of, fit, fit_of
from labctl.studies.paper.reproduction import Plan

pytestmark = pytest.mark.usefixtures("one_core")

FILE = """
title = "Few images"
paper = ""
statement = ""
analysis = "recognition"
splits = 2
[runs.chip]
protocol = "image-readout"
settings = { images = 40, ports = "2,3", window = "2 ns" }
[fit]
run = "chip"
accuracy = 0.9
windows = ["0.32 ns", "0.4 ns"]
first_seed = 1001
twins = 1
[fit.variation]
name = "speckle grain"
parameter = "image_side"
values = [2.0, 4.0]
unit = 0.8
exponent = -1
default = 4.0
"""


def tried(value: float, shorter: float, longer: float, *misfits: float) -> Tried:
    return Tried(value, pooled([shorter]), pooled([longer]), pooled(misfits))


def test_values_that_chance_does_not_tell_apart_make_the_interval() -> None:
    values = [tried(1, 0.5, 0.6, 0.3, 0.31, 0.3), tried(2, 0.8, 0.85, 0.02, 0.1, 0.03)]
    found = concluded(0.9, [*values, tried(3, 0.8, 0.86, 0.05, 0.03, 0.04)])
    assert (found.fitted, found.interval) == (3, (2, 3))
    assert not found.reached


def test_a_value_on_the_right_side_of_the_bound_at_both_times_reaches_the_curve() -> None:
    assert concluded(0.9, [tried(1, 0.89, 0.91, 0.01, 0.0), tried(2, 0.8, 0.8, 0.1, 0.2)]).reached


def test_every_value_is_measured_on_seeds_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "few.toml").write_text(FILE, encoding="utf-8")
    (experiment,) = experiments(folder=tmp_path)
    plan = Plan((experiment,), SIMULATED_STATION, tmp_path / "out")
    found = fit(plan, experiment, interruption=Interruption(), progress=lambda *_: None)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["seed-1001", "seed-1001-image_side-0.4"]
    shown = as_json(fit_of(experiment), found)
    assert shown["fitted"] in (2.0, 4.0)
    assert len(shown["tried"]) == 2
    assert figure_of(fit_of(experiment), found).figure.axes


def test_a_quick_one_takes_one_twin(tmp_path: Path) -> None:
    (tmp_path / "few.toml").write_text(FILE.replace("twins = 1", "twins = 2"), encoding="utf-8")
    (experiment,) = experiments(folder=tmp_path)
    plan = Plan((experiment,), SIMULATED_STATION, tmp_path / "out", quick=True)
    found = fit(plan, experiment, interruption=Interruption(), progress=lambda *_: None)
    assert [len(one.misfit["by_bench"]) for one in found.tried] == [1, 1]


def test_what_has_nothing_to_fit_says_so() -> None:
    (experiment,) = experiments(["fig2"])
    with pytest.raises(ExperimentError, match="says nothing to fit"):
        fit_of(experiment)
