"""The package that the how-to guide shows brings instruments, their drivers, their twins and their own tables."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from labctl.runs.read.run import open_run
from tests.checkout import ROOT

EXAMPLE = ROOT / "docs" / "how-to" / "examples" / "own_instruments"
HERE = "\n".join(line for line in (EXAMPLE / "bench.toml").read_text("utf-8").splitlines() if "address" not in line)
"""The station file of the guide, its instruments simulated."""

LABCTL = (sys.executable, "-m", "labctl")
Labctl = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Of processes that find the package, installed as pip does it."""
    folder = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*pip, *offline, "--target", str(folder), str(EXAMPLE)], check=True)
    paths = os.pathsep.join(filter(None, (os.environ.get("PYTHONPATH", ""), str(folder), str(ROOT))))
    return os.environ | {"PYTHONPATH": paths}


@pytest.fixture(scope="module")
def labctl(environment: dict[str, str]) -> Labctl:
    """The command in a process of its own."""

    def carry_out(*words: object) -> tuple[int, dict[str, Any]]:
        ended = subprocess.run(
            [*LABCTL, *map(str, words), "--json"], check=False, capture_output=True, text=True, env=environment
        )
        return ended.returncode, json.loads(ended.stdout)

    return carry_out


@pytest.fixture
def station(tmp_path: Path) -> Path:
    path = tmp_path / "bench.toml"
    path.write_text(HERE, encoding="utf-8")
    return path


def run(labctl: Labctl, station: Path, directory: Path) -> tuple[int, dict[str, Any]]:
    return labctl("run", "image-readout", "--set", "images=10", "--station", station, "--out", directory)


def test_check_asks_them_and_a_run_keeps_who_they_were_and_how_they_were_set(
    labctl: Labctl, station: Path, tmp_path: Path
) -> None:
    status, found = labctl("check", "--station", station)
    assert (status, found["ok"]) == (0, True)
    assert found["instruments"]["power_meter"]["identity"] == "ACME PM-1 SIM0001 1.0"
    assert found["instruments"]["thermometer"]["self_test"] == "passed"

    status, _ = run(labctl, station, tmp_path / "run")
    assert status == 0
    with open_run(tmp_path / "run") as measured:
        assert measured.manifest["station"]["power_meter"]["averages"] == 10
        assert measured.manifest["instruments"]["power_meter"]["settings"] == {"wavelength_nm": 1550.0, "averages": 10}
        assert measured.manifest["instruments"]["thermometer"]["identity"]["model"] == "T-1"
    commands = (tmp_path / "run" / "commands.log").read_text("utf-8")
    lit = commands.index("> laser OUTPUT ON")
    assert "> power_meter POWer?" in commands[lit:]


def test_a_bench_with_them_measures_the_same_frames_as_one_without(
    labctl: Labctl, station: Path, tmp_path: Path
) -> None:
    plain = tmp_path / "plain.toml"
    plain.write_text("", encoding="utf-8")
    (_, with_them), (_, without) = (run(labctl, path, tmp_path / path.stem) for path in (station, plain))
    assert with_them["frames_sha256"] == without["frames_sha256"]


def test_they_are_served_beside_the_others(
    labctl: Labctl, environment: dict[str, str], station: Path, tmp_path: Path
) -> None:
    served = tmp_path / "lab.toml"
    command = [*LABCTL, "sim", "serve", "--station", str(station), "--save-station", str(served), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as server:
        assert server.stdout is not None
        resources = json.loads(server.stdout.readline())["resources"]
        assert list(resources)[5:] == ["power_meter", "thermometer"]
        status, found = labctl("check", "--station", served)
        assert (status, found["instruments"]["thermometer"]["address"]) == (0, resources["thermometer"]["socket"])
        status, _ = run(labctl, served, tmp_path / "run")
        server.send_signal(signal.SIGTERM)
        server.wait(30)
    assert status == 0
    assert "> power_meter POWer?" in (tmp_path / "run" / "commands.log").read_text("utf-8")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HERE.replace("averages = 10", "averages = 0"), "power_meter.averages = 0: "),
        (HERE.replace("highest_celsius = 25.0", ""), "thermometer.highest_celsius is missing: write it"),
        (HERE.replace('driver = "acme-thermometer"', ""), "thermometer.driver is missing: choose one of acme-thermo"),
        (HERE.replace("[thermometer]", "[hygrometer]"), "hygrometer.driver = 'acme-thermometer' is a driver of thermo"),
        (HERE + "\n[hygrometer]\ncolour = 1", "hygrometer = {'colour': 1}: unknown key"),
        (HERE + '\n[hygrometer]\ndriver = "acme"', "hygrometer.driver = 'acme' is not installed: no installed driver"),
    ],
)
def test_their_tables_are_checked_with_the_rest(labctl: Labctl, tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(text, encoding="utf-8")
    status, found = labctl("check", "--station", path)
    assert status == 2
    assert found["error"].startswith(f"{path}: {message}")


def test_drivers_lists_them_with_their_twins(labctl: Labctl) -> None:
    _, found = labctl("drivers")
    listed = {one["name"]: one for one in found["drivers"]}
    assert listed["acme-pm1"] == {
        "name": "acme-pm1",
        "role": "power_meter",
        "interface": "PowerMeter",
        "package": "acme-instruments",
        "virtual": "acme-instruments",
        "problem": "",
    }
    assert listed["acme-thermometer"]["interface"] == "Instrument"
    assert listed["tektronix-awg70002a"]["virtual"] == "photonic-labctl"
    assert listed["manual-laser"]["virtual"] == ""
