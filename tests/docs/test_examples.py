"""The packages that the how-to guides show plug in and work."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from labctl.runs.read.run import open_run

EXAMPLES = Path(__file__).parents[2] / "docs" / "how-to" / "examples"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the example package as pip installs it."""
    folder = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*pip, *offline, "--target", str(folder), str(EXAMPLES)], check=True)
    return folder


def test_a_driver_and_a_protocol_of_ones_own_measure_a_run(installed: Path, tmp_path: Path) -> None:
    station, directory = tmp_path / "station.toml", tmp_path / "run"
    station.write_text('[patch_panel]\ndriver = "list-switch"\n', encoding="utf-8")
    command = ["run", "repeatability", "--set", "repeats=5", "--station", str(station), "--out", str(directory)]
    paths = [str(installed), str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    subprocess.run(
        [sys.executable, "-m", "labctl", *command],
        check=True,
        capture_output=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
    )
    with open_run(directory) as run:
        assert run.frames.shape[:2] == (5, 4)
    assert "> patch_panel ROUTe:CLOSe (@1!2,2!3,3!4,4!5)" in (directory / "commands.log").read_text()
