"""A disk that is really full: a file system of two mebibytes, mounted in a name space of its own."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from labctl.commands.main import main
from labctl.runs.read.run import open_run
from tests.checkout import ROOT

PROTOCOL = ("image-readout", "--set", "images=60", "--set", "ports=2", "--set", "window=0.8 ns")
STATION = """
[durability]
shots = 2
[sim]
noise = "by-state"
parameters = { chip_modes = 50 }
"""
APART = ("unshare", "--user", "--map-root-user", "--mount")


@pytest.fixture(scope="module")
def small_disk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where such a file system may be mounted, apart from everybody else's."""
    folder = tmp_path_factory.mktemp("disk")
    if shutil.which("unshare") is None:
        pytest.skip("no `unshare` here: no file system can be mounted for a test")
    tried = subprocess.run(
        [*APART, "mount", "-t", "tmpfs", "none", str(folder)], capture_output=True, text=True, check=False
    )
    if tried.returncode:
        pytest.skip(f"no file system may be mounted here: {tried.stderr.strip()}")
    return folder


@pytest.fixture(scope="module")
def found(small_disk: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    station = tmp_path_factory.mktemp("station") / "station.toml"
    station.write_text(STATION, encoding="utf-8")
    script = Path(__file__).with_name("on_a_small_disk.py")
    ended = subprocess.run(
        [*APART, sys.executable, str(script), str(small_disk), str(station), *PROTOCOL],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    told: dict[str, Any] = json.loads(ended.stdout)
    return told | {"folder": small_disk, "station": station}


def test_a_disk_that_fills_up_ends_the_run_in_one_line_and_keeps_what_was_acknowledged(found: dict[str, Any]) -> None:
    run, directory = found["run"], found["folder"] / "run"
    assert run["status"] == 2
    ended, following = [line for line in run["told"].splitlines() if line.startswith("labctl: ")]
    assert ended.startswith(f"labctl: {directory}/shards/")
    assert "cannot be written: No space left on device" in ended
    assert ended.endswith("what was stored before is safe: make room, then `labctl resume` the run")
    assert following == f"labctl: the run can go on: labctl resume {directory}"
    assert "commands.log cannot be written (No space left on device): it ends here" in run["told"]
    assert "Traceback" not in run["told"]
    assert run["intact"]
    assert run["stored"] >= 2 * run["acknowledged"] > 0


def test_with_room_it_goes_on_to_the_frames_of_a_run_on_a_large_disk(found: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        main(["run", *PROTOCOL, "--station", str(found["station"]), "--out", str(tmp_path / "whole"), "--json"])
    with open_run(tmp_path / "whole") as whole:
        digest = whole.digest()
    resumed = found["run"]["resumed"]
    assert (resumed["complete"], resumed["frames_sha256"]) == (True, digest)


def test_a_disk_that_fills_up_under_the_data_file_takes_nothing_else(found: dict[str, Any]) -> None:
    data = found["data"]
    assert data["told"].startswith(
        f"{found['folder'] / 'whole' / 'data.h5'}: cannot be written: No space left on device;"
    )
    assert (data["intact"], data["complete"], data["left"]) == (True, True, [])
    assert data["data_file"] == "current"


def test_runs_are_listed_as_they_are_where_no_catalogue_can_be_written(found: dict[str, Any]) -> None:
    assert found["listed"] == ["whole", "run", "other", "run"]
