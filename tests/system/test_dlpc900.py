"""A bench whose DMD is a DLPC900, through the wire: what it sees is what the bench with an ALP sees."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.runs.read.run import open_run
from tests.command_line import as_json

WIRED = "[wiring]\nburst = true\n"
STATIONS = {"alp": WIRED, "dlpc900": f"[dmd]\ndriver = 'ti-dlpc900'\naddress = 'simulated'\n{WIRED}"}
SMALL = ("--set", "images=30", "--set", "reference_every=10", "--set", "ports=2,3", "--set", "window=0.4 ns")


@pytest.fixture
def stations(tmp_path: Path) -> dict[str, Path]:
    """Two benches that differ in their DMD alone."""
    paths = {name: tmp_path / f"{name}.toml" for name in STATIONS}
    for name, path in paths.items():
        path.write_text(STATIONS[name])
    return paths


def volts(run: Path) -> tuple[NDArray[np.float64], NDArray[np.str_]]:
    """Every trace of a run, and of which kind each shot is."""
    with open_run(run) as found:
        return found.volts(), found.shots["kind"]


def test_a_check_finds_it_well(stations: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    status, found = as_json(capsys, "check", "--station", stations["dlpc900"])
    assert status == 0
    dmd = found["instruments"]["dmd"]
    assert dmd["ok"]
    assert dmd["identity"] == "Texas Instruments DLPC900 1920x1080 LCR6500 simulated 6.0.0"


def test_the_same_pictures_give_the_same_light(
    stations: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Shot by shot and in bursts: two benches differ by no more noise than the two timings of one."""
    found = {}
    for name, station in stations.items():
        for timing in ("software", "burst"):
            run = tmp_path / f"{name}-{timing}"
            asked = ("run", "image-readout", *SMALL, "--set", f"timing={timing}", "--station", station, "--out", run)
            status, _ = as_json(capsys, *asked)
            assert status == 0
            found[name, timing], kinds = volts(run)
    images = {which: traces[kinds == "image"] for which, traces in found.items()}
    noise = np.std(images["alp", "software"] - images["alp", "burst"])
    assert np.std(images["alp", "software"]) > 4 * noise
    for timing in ("software", "burst"):
        assert np.std(images["dlpc900", timing] - images["alp", timing]) < 1.25 * noise
