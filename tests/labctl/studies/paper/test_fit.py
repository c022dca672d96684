"""The fitted number: where the paper's crossing is met, or missed least, and which values are not told from it."""

from dataclasses import replace
from pathlib import Path

import pytest

from labctl.analysis.intervals import pooled
from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION
from labctl.errors import ExperimentError
from labctl.studies.paper.experiments import experiments
from labctl.studies.paper.fit import Tried, as_json, concluded, figure_of, fit, fit_of, in_words
from labctl.studies.paper.reproduction import Plan
from tests.command_line import answer
from tests.labctl.reports.figures.drawn import legend

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
    figure = figure_of(fit_of(experiment), found)
    drawn = figure.figure.axes
    assert [" ".join(axes.get_xlabel().split()) for axes in drawn] == [
        "speckle grain; 0.32 ns, paper below 90 %",
        "speckle grain; 0.4 ns, paper above 90 %",
    ]
    assert set(legend(figure.figure)) == {"fitted", "what the paper crosses", "mean ± standard error"}
    assert figure.figure.legends[0].get_title().get_text() == ""
    assert f"{found.interval[1]:g} cannot be distinguished from it; nothing beyond" in figure.caption


def test_values_that_are_all_lost_are_told() -> None:
    with pytest.raises(ExperimentError, match="no value is left to choose from"):
        concluded(0.9, [])


def test_an_interval_that_ends_within_what_was_tried_says_nothing_of_beyond() -> None:
    far, near = tried(1, 0.5, 0.6, 0.3, 0.31), tried(2, 0.8, 0.85, 0.02, 0.03)
    (experiment,) = experiments(["fig3"])
    assert in_words(fit_of(experiment), concluded(0.9, [far, near, replace(far, value=3)])).endswith(
        ": 2, 2 to 2 cannot be distinguished from it"
    )
    assert in_words(fit_of(experiment), concluded(0.9, [far, near])).endswith("; nothing beyond 2 was tried")


def test_seeds_of_another_study_are_refused() -> None:
    status, found, _ = answer("reproduce", "fig3", "--fit", "--first-seed", "1", "--json")
    assert status == 2
    assert "--first-seed: --fit has seeds of its own" in found["error"]


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
