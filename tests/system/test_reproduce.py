"""What `labctl reproduce` refuses of the experiments of the house, and when it ends in 1."""

import json
from functools import partial
from pathlib import Path

import pytest

from labctl.runs.read.run import open_run
from labctl.studies.paper.experiments import experiments
from tests.command_line import as_json, labctl

pytestmark = pytest.mark.usefixtures("one_core")


def test_an_unknown_experiment_is_refused_before_anything_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, shown = as_json(capsys, "reproduce", "fig99", "--out", str(tmp_path / "out"))
    assert status == 2
    assert "no experiment is called 'fig99'" in str(shown["error"])
    assert not (tmp_path / "out").exists()


def test_what_is_varied_must_be_said_by_the_experiment(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, shown = as_json(capsys, "reproduce", "fig2", "--sensitivity", "--out", str(tmp_path / "out"))
    assert status == 2
    assert "says nothing to vary" in str(shown["error"])


def test_two_studies_at_once_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--fit", "--sensitivity", "--out", str(tmp_path / "out"))
    status, shown = as_json(capsys, "reproduce", "fig3", *options)
    assert (status, shown["error"]) == (2, "--sensitivity and --fit are two studies: ask for one of them")


FEW = """
title = "Few images"
paper = ""
statement = ""
analysis = "traces"
averages = [1, 2]
splits = 1

[runs.input]
protocol = "image-readout"
settings = { images = 4, ports = "0", window = "0.4 ns", reference_every = 1 }

[runs.chip]
protocol = "image-readout"
settings = { images = 4, ports = "2", window = "0.4 ns", reference_every = 1 }

[[must]]
what = "difference over noise"
path = ["chip"]
at_least = 1e9
averaged_at_least = -1e9
"""


def test_one_bench_of_any_seed_decides_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, found = as_json(
        capsys, "reproduce", "fig2", "--seeds", 1, "--quick", "--first-seed", 3, "--out", tmp_path / "out"
    )
    assert (status, found["passed"], found["open"]) == (0, True, 2)
    assert (found["seeds"], found["first_seed"], found["benches"]) == (1, 3, 1)
    for must in found["must"]:
        assert (must["verdict"], must["averaged"]["verdict"]) == (None, "open")
        assert must["averaged"]["here"] > must["here"], "noise is averaged away"
    carried_out = []
    for directory in found["runs"]:
        with open_run(directory) as run:
            protocol, sim = run.manifest["protocol"]["settings"], run.manifest["station"]["sim"]
        assert (protocol["seed"], sim["twin_seed"]) == (3, 3)
        carried_out.append((protocol["averages"], protocol["timing"]))
    assert carried_out == [(1, "burst"), (1, "burst"), (16, "burst"), (16, "burst")]
    assert "Seeds 3;" in (tmp_path / "out" / "report.html").read_text("utf-8")


@pytest.fixture
def few(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """There is no other experiment."""
    (tmp_path / "few.toml").write_text(FEW, encoding="utf-8")
    monkeypatch.setattr("labctl.commands.reproduce.experiments", partial(experiments, folder=tmp_path))


@pytest.mark.usefixtures("few")
def test_a_figure_that_is_surely_short_ends_in_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = labctl(capsys, "reproduce", "few", "--seeds", 2, "--out", tmp_path / "out")
    assert status == 1
    assert "NOT REACHED" in out
    assert "seeds share part of their data" in out, "its interval knows little of other data"
    assert "2 figures: 1 reached, 1 NOT REACHED, 0 open" in out
    (found,) = json.loads((tmp_path / "out" / "report.json").read_text("utf-8"))["experiments"]
    (must,) = found["must"]
    assert (must["verdict"], must["averaged"]["verdict"]) == ("not reached", "reached")
    assert must["low"] < must["here"] < must["high"]


@pytest.mark.usefixtures("few")
def test_one_seed_is_not_said_to_have_an_interval(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = labctl(capsys, "reproduce", "few", "--seeds", 1, "--out", tmp_path / "out")
    assert status == 0
    assert "Figures of one seed have no interval" in out
    assert "brackets" not in out
    assert "2 figures: 0 reached, 0 NOT REACHED, 2 open" in out
