"""Experiment files: every one is whole, a wrong one says what is wrong, and figures are judged as they say."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from labctl.analysis.intervals import Bound, pooled
from labctl.errors import ExperimentError
from labctl.studies.paper.analyses import analysis_of
from labctl.studies.paper.experiments import Experiment, Requirement, experiments
from sim_backends.parameters import Parameters

HERE = {"accuracy": {"0.4": pooled([0.90, 0.92]), "1.0": pooled([0.94, 0.97])}, "ratio": 7.5}


@pytest.mark.parametrize(
    "experiment", [*experiments(), *experiments(["demonstration"])], ids=lambda experiment: experiment.name
)
def test_every_experiment_of_the_house_is_whole(experiment: Experiment) -> None:
    analysis_of(experiment)
    assert experiment.must
    assert experiment.averages == (1, 16), "no parameter differs between experiments"
    assert experiment.twins == (5 if experiment.part_of else 10)


def test_an_unknown_experiment_is_told_with_those_there_are() -> None:
    with pytest.raises(
        ExperimentError, match=r"no experiment is called 'fig99': choose 'all', 'beyond' or from .*fig2, fig3"
    ):
        experiments(["fig99"])


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("title = 1", "title"),
        ("title = [", "is not TOML"),
        ('title = "a"\npaper = ""\nstatement = ""\nanalysis = "recognition"\nruns = {}', "runs"),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path: Path, content: str, complaint: str) -> None:
    (tmp_path / "mine.toml").write_text(content)
    with pytest.raises(ExperimentError, match=complaint) as raised:
        experiments(folder=tmp_path)
    assert "\n" not in str(raised.value)


def test_another_file_is_another_experiment(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        'title = "a"\npaper = "b"\nstatement = "c"\nanalysis = "nothing"\n[runs.a]\nprotocol = "image-readout"\n'
    )
    (mine,) = experiments(folder=tmp_path)
    assert mine.name == "mine"
    with pytest.raises(ExperimentError, match="no analysis is called 'nothing'"):
        analysis_of(mine)


MINIMAL = """
title = "a"
paper = "b"
statement = "c"
analysis = "traces"
{more}
[runs.a]
protocol = "image-readout"
{of_the_run}
"""


def write(folder: Path, name: str, more: str = "", of_the_run: str = "") -> None:
    (folder / f"{name}.toml").write_text(MINIMAL.format(more=more, of_the_run=of_the_run), encoding="utf-8")


class TestSeries:
    """What 'all' and 'beyond' stand for, and what only experiments beyond the paper may do."""

    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        write(tmp_path, "b1", 'series = "beyond"')
        write(tmp_path, "fig1")
        write(tmp_path, "half", 'part_of = "fig1"')
        return tmp_path

    @pytest.mark.parametrize(
        ("names", "found"),
        [
            (("all",), ["fig1"]),
            (("beyond",), ["b1"]),
            (("beyond", "all"), ["b1", "fig1"]),
            (("b1", "all"), ["b1", "fig1"]),
            (("half", "beyond"), ["b1", "half"]),
        ],
    )
    def test_a_series_is_named_as_a_whole_and_each_by_itself(
        self, names: tuple[str, ...], found: list[str], folder: Path
    ) -> None:
        assert [one.name for one in experiments(names, folder=folder)] == found

    def test_a_series_without_experiments_is_told(self, tmp_path: Path) -> None:
        write(tmp_path, "fig1")
        with pytest.raises(ExperimentError, match="holds no experiment of series beyond"):
            experiments(("beyond",), folder=tmp_path)

    def test_the_twin_of_the_paper_is_not_changed_for_a_run(self, tmp_path: Path) -> None:
        write(tmp_path, "fig1", of_the_run="parameters = { enob = 4.0 }")
        with pytest.raises(ExperimentError, match=r"runs\.a\.parameters: all experiments of the paper share") as raised:
            experiments(folder=tmp_path)
        assert "\n" not in str(raised.value)

    def test_beyond_the_paper_it_is(self, tmp_path: Path) -> None:
        write(tmp_path, "b1", 'series = "beyond"', "parameters = { enob = 4.0 }")
        (found,) = experiments(("beyond",), folder=tmp_path)
        assert found.runs["a"].parameters == {"enob": 4.0}


class TestMust:
    def test_the_bound_of_single_triggers_holds_for_their_mean_unless_it_has_one(self) -> None:
        same = Requirement(what="", path=("a",), at_least=0.9)
        assert same.bound == same.averaged_bound == Bound(">=", 0.9)
        own = Requirement(what="", path=("a",), at_most=0.2, averaged_at_most=0.1)
        assert (own.bound, own.averaged_bound) == (Bound("<=", 0.2), Bound("<=", 0.1))
        averaged = Requirement(what="", path=("a",), averaged_at_least=0.9)
        assert (averaged.bound, averaged.averaged_bound) == (None, Bound(">=", 0.9))

    def test_a_difference_is_compared_bench_by_bench(self) -> None:
        must = Requirement(what="", path=("accuracy", "1.0"), minus=("accuracy", "0.4"), at_least=0.03)
        assert must.figure(HERE)["by_bench"] == pytest.approx([0.04, 0.05])

    def test_a_figure_that_is_not_there_is_told(self) -> None:
        with pytest.raises(ExperimentError, match=r"no figure accuracy\.9"):
            Requirement(what="", path=("accuracy", "9")).figure(HERE)

    @pytest.mark.parametrize("path", [("accuracy",), ("ratio",)])
    def test_what_is_no_mean_over_benches_is_told(self, path: tuple[str, ...]) -> None:
        with pytest.raises(ExperimentError, match=f"no figure over benches {path[0]}: correct"):
            Requirement(what="", path=path, at_least=0).figure(HERE)

    @pytest.mark.parametrize("prefix", ["", "averaged_"])
    def test_two_bounds_are_refused(self, prefix: str) -> None:
        with pytest.raises(ValidationError, match=f"needs one bound: give {prefix}at_least or {prefix}at_most"):
            Requirement(what="", path=("ratio",), **{f"{prefix}at_least": 0.0, f"{prefix}at_most": 1.0})


class TestAverages:
    """Single triggers, and the mean of several beside them."""

    def test_they_are_said_in_one_place(self, tmp_path: Path) -> None:
        write(tmp_path, "fig1", "averages = [1, 16]", "settings = { averages = 4 }")
        with pytest.raises(ExperimentError, match=r"runs\.a\.settings\.averages: the experiment's own averages say it"):
            experiments(folder=tmp_path)

    def test_a_bound_of_a_mean_needs_a_mean(self, tmp_path: Path) -> None:
        write(tmp_path, "fig1", of_the_run='[[must]]\nwhat = "x"\npath = ["y"]\naveraged_at_least = 1.0')
        with pytest.raises(
            ExperimentError, match=r"'x': averaged_at_least, averaged_at_most need averages = \[1, 16\]"
        ):
            experiments(folder=tmp_path)


def test_images_of_each_class_are_written_without_a_complaint() -> None:
    for experiment in experiments(["fig5"]):
        assert '"images":[2000,500]' in experiment.protocols["median"].model_dump_json()


def test_what_is_varied_starts_from_what_all_experiments_use() -> None:
    """Values stand rounded in the file: to three digits."""
    for experiment in experiments():
        for varied in experiment.sensitivity.parameters if experiment.sensitivity else ():
            used = getattr(Parameters(), varied.parameter)
            assert varied.parameter_at(varied.default) == pytest.approx(used, rel=0.005)
            assert varied.default in varied.values
