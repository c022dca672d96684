"""What a bench, a machine or a file is not up to is said in one line, before anything is made, asked or lit."""

import json
import os
from collections.abc import Callable
from functools import partial
from importlib.resources import files
from pathlib import Path

import pytest

from labctl.commands.main import main
from labctl.studies.paper.experiments import experiments

NOBODY = "TCPIP0::127.0.0.1::9::SOCKET"
"""An address where nothing listens: an instrument that was asked would end it otherwise."""
INSTRUMENTS = ("awg", "scope", "laser", "dmd", "patch_panel")

EXPERIMENT = """
title = "{title}"
paper = ""
statement = ""
analysis = "{analysis}"
splits = 1

[runs.input]
protocol = "image-readout"
settings = {{ dataset = "{dataset}", images = 4, ports = "0", window = "0.4 ns", reference_every = 1 }}

[runs.chip]
protocol = "image-readout"
settings = {{ dataset = "{dataset}", images = 4, ports = "2", window = "0.4 ns", reference_every = 1 }}
"""

Refusal = Callable[..., str]


def station_file(folder: Path, *, without: str = "", **sections: str) -> Path:
    """A station whose instruments are at addresses where nobody answers, with more lines in some sections."""
    path = folder / "bench.toml"
    tables = dict.fromkeys(INSTRUMENTS, f'address = "{NOBODY}"\n')
    tables["laser"] += 'commands = "simulated"\n' if "commands" not in sections.get("laser", "") else ""
    tables["laser"] += "armed = true\n"
    tables.pop(without, None)
    for name, lines in sections.items():
        tables[name] = tables.get(name, "") + lines + "\n"
    path.write_text(
        "mixed = true\n" + "".join(f"[{name}]\n{lines}" for name, lines in tables.items()), encoding="utf-8"
    )
    return path


def write_experiment(folder: Path, name: str, *, analysis: str = "traces", dataset: str = "mnist-0-3") -> None:
    text = EXPERIMENT.format(title=name, analysis=analysis, dataset=dataset)
    (folder / f"{name}.toml").write_text(text, encoding="utf-8")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for experiment files, in place of the house's own."""
    path = tmp_path / "experiments"
    path.mkdir()
    monkeypatch.setattr("labctl.commands.reproduce.experiments", partial(experiments, folder=path))
    return path


@pytest.fixture
def refusal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Refusal:
    """The command, refused: one line on standard error, and nothing was started."""
    monkeypatch.chdir(tmp_path)

    def carry_out(*words: object, status: int = 2) -> str:
        before = set(tmp_path.iterdir())
        with pytest.raises(SystemExit) as ended:
            main(["reproduce", *map(str, words)])
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.count("\n") == 1
        assert ended.value.code == status
        assert set(tmp_path.iterdir()) == before
        return captured.err

    return carry_out


@pytest.mark.parametrize(
    ("experiment", "sections", "message"),
    [
        ("fig3", {"wiring": "projector = false"}, "set wiring.projector = true"),
        ("fig3", {"patch_panel": 'ports = "0,2-4"'}, "port 5 is not patched"),
        ("fig3", {"patch_panel": "bypass = true"}, "set patch_panel.bypass = false"),
        ("fig3", {"laser": 'driver = "manual-laser"'}, "its key switch is the only interlock"),
        ("s5", {"laser": 'driver = "manual-laser"'}, "repeat with --attended"),
        (
            "fig3",
            {"laser": 'power = "50 mW"', "limits": 'optical_power = "60 mW"'},
            "laser.power = 50 mW is 16.9897 dBm",
        ),
        ("fig3", {"awg": 'driver = "pulse-generator"'}, "driver = 'pulse-generator' is not installed"),
    ],
)
def test_a_bench_that_cannot_do_it(
    experiment: str, sections: dict[str, str], message: str, tmp_path: Path, refusal: Refusal
) -> None:
    station = station_file(tmp_path, **sections)
    said = refusal(experiment, "--station", station)
    assert message in said
    assert "bench.toml" in said


@pytest.fixture
def fixed_laser(tmp_path: Path) -> Path:
    """A station with a laser that stays at 1550 nm."""
    table = (files("sim_backends.virtual.tlg220") / "commands.toml").read_text("utf-8")
    fixed = table.replace("min = 1528.0\nmax = 1566.0", "min = 1550.0\nmax = 1550.0")
    (tmp_path / "fixed.toml").write_text(fixed, encoding="utf-8")
    return station_file(tmp_path, laser='commands = "fixed.toml"')


def test_a_laser_that_does_not_tune_is_not_for_several_wavelengths(fixed_laser: Path, refusal: Refusal) -> None:
    said = refusal("s5", "--station", fixed_laser)
    assert f"1551 nm are asked for, but the laser of {fixed_laser.with_name('fixed.toml')} stays at 1550 nm" in said
    assert "choose other wavelengths (laser.wavelength where a protocol sets none)" in said
    assert "laser.commands" in said
    assert "cannot be reached" in refusal("fig3", "--station", fixed_laser, status=1)


def test_a_scan_with_a_laser_that_does_not_tune(
    fixed_laser: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["run", "wavelength-scan", "--station", str(fixed_laser), "--out", "scan"])
    assert ended.value.code == 2
    assert "1550 nm: choose other wavelengths" in capsys.readouterr().err
    assert not (tmp_path / "scan").exists()


def test_a_bench_without_dmd_shows_no_images(tmp_path: Path, refusal: Refusal) -> None:
    said = refusal("fig3", "--station", station_file(tmp_path, without="dmd"))
    assert "dmd.address = 'simulated', but image-readout needs dmd on the bench of awg, scope" in said


def test_a_scene_needs_the_burst_cables(tmp_path: Path, refusal: Refusal) -> None:
    station = tmp_path / "bench.toml"
    station.write_text("[wiring]\nburst = false\n", encoding="utf-8")
    assert "needs wiring.burst = true" in refusal("fig4", "--station", station)


def test_a_simulated_bench_is_cabled_as_its_file_says(tmp_path: Path, refusal: Refusal) -> None:
    station = tmp_path / "bench.toml"
    station.write_text("[wiring]\nprojector = false\n", encoding="utf-8")
    assert "set wiring.projector = true" in refusal("fig3", "--station", station)


def test_a_bench_that_does_not_answer(tmp_path: Path, refusal: Refusal) -> None:
    assert NOBODY in refusal("all", "--station", station_file(tmp_path), status=1)


def test_a_folder_that_holds_something(tmp_path: Path, refusal: Refusal) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").touch()
    assert "is not empty: name a new folder" in refusal("fig2", "--out", tmp_path / "out")


@pytest.mark.parametrize("name", ["fig6", "s6"])
def test_torch_that_is_missing(name: str, refusal: Refusal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("labctl.studies.paper.analyses.find_spec", lambda _name: None)
    said = refusal(name)
    assert f"{name} needs torch" in said
    assert "photonic-labctl[imaging]" in said


def test_data_that_is_missing(tmp_path: Path, refusal: Refusal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LABCTL_DATA", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert "cracks" in refusal("fig5")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("title = [", "mine.toml: is not TOML"),
        ('title = "x"', "mine.toml: paper is missing"),
        (EXPERIMENT.format(title="", analysis="nothing", dataset="mnist-0-3"), "no analysis is called 'nothing'"),
        (EXPERIMENT.format(title="", analysis="traces", dataset="nothing"), "nothing"),
        (
            EXPERIMENT.format(title="", analysis="traces", dataset="mnist-0-3").replace("ports", "potrs"),
            "experiment mine, runs.input: potrs: image-readout has no such setting",
        ),
        (
            EXPERIMENT.format(title="", analysis="traces", dataset="mnist-0-3").replace("image-readout", "readout"),
            "protocol 'readout' is not installed",
        ),
        (
            EXPERIMENT.format(title="", analysis="traces", dataset="mnist-0-3") + "[settings]\ncolour = 1\n",
            "experiment mine: settings: colour = 1: unknown key",
        ),
    ],
)
def test_an_experiment_file_that_is_wrong(content: str, message: str, folder: Path, refusal: Refusal) -> None:
    (folder / "mine.toml").write_text(content, encoding="utf-8")
    assert message in refusal("mine")


def test_all_that_is_possible_is_done(
    tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("LABCTL_DATA", str(folder))
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    monkeypatch.setattr("labctl.studies.paper.analyses.find_spec", lambda _name: None)
    write_experiment(folder, "digits")
    write_experiment(folder, "pictures", analysis="imaging")
    write_experiment(folder, "walls", dataset="cracks")
    with pytest.raises(SystemExit) as ended:
        main(["reproduce", "--seeds", "1", "--out", str(tmp_path / "out"), "--json"])
    assert ended.value.code == 1
    captured = capsys.readouterr()
    said = captured.err.splitlines()
    assert [line.split(":")[0] for line in said] == ["pictures is skipped", "walls is skipped"]
    assert "torch" in said[0]
    assert "cracks" in said[1]
    found = {entry["name"]: entry for entry in json.loads(captured.out)["experiments"]}
    assert list(found) == ["digits", "pictures", "walls"]
    assert found["digits"]["passed"]
    assert "torch" in found["pictures"]["skipped"]
