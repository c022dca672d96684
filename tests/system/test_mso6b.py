"""A bench whose oscilloscope is a 6 Series B, through the wire: it measures what the bench with a DPO72504DX does."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.runs.read.run import open_run
from tests.command_line import as_json
from tests.data_sets import require

WIRED = "[wiring]\nburst = true\n"
STATIONS = {
    "dpo": f"[scope]\ndriver = 'tektronix-dpo72504dx'\nbandwidth = '10 GHz'\n{WIRED}",
    "six": f"[scope]\ndriver = 'tektronix-mso6b'\n{WIRED}",
}
SMALL = ("--set", "images=30", "--set", "reference_every=10", "--set", "ports=2,3", "--set", "window=0.4 ns")
TIMINGS = ("software", "burst")


@pytest.fixture
def stations(tmp_path: Path) -> dict[str, Path]:
    """Two benches that differ in their oscilloscope alone, at one bandwidth."""
    paths = {name: tmp_path / f"{name}.toml" for name in STATIONS}
    for name, path in paths.items():
        path.write_text(STATIONS[name])
    return paths


def measured(run: Path) -> tuple[NDArray[np.float64], np.dtype[np.generic], bool]:
    """Every trace of a run's images in volts, the type of its codes, and whether it is complete."""
    with open_run(run) as found:
        return found.volts()[found.shots["kind"] == "image"], found.frames.dtype, found.complete


def test_a_check_finds_it_well(stations: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    status, found = as_json(capsys, "check", "--station", stations["six"])
    assert status == 0
    scope = found["instruments"]["scope"]
    assert scope["ok"]
    assert scope["identity"].startswith("TEKTRONIX MSO64B ")


def test_the_same_light_gives_the_same_volts(
    stations: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Shot by shot and in bursts, in codes of 16 bits: two benches differ by no more noise than one with itself."""
    volts = {}
    for name, station in stations.items():
        for timing in TIMINGS:
            run = tmp_path / f"{name}-{timing}"
            asked = ("run", "image-readout", *SMALL, "--set", f"timing={timing}", "--station", station, "--out", run)
            status, _ = as_json(capsys, *asked)
            assert status == 0
            volts[name, timing], code_type, complete = measured(run)
            assert code_type == {"dpo": np.int8, "six": np.int16}[name]
            assert complete
    noise = np.std(volts["dpo", "software"] - volts["dpo", "burst"])
    assert np.std(volts["dpo", "software"]) > 4 * noise
    for timing in TIMINGS:
        assert np.std(volts["six", timing] - volts["dpo", timing]) < 1.2 * noise
    assert np.std(volts["six", "software"] - volts["six", "burst"]) < noise


def test_a_mean_of_triggers_is_as_fine(
    stations: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Means have codes of 16 bits as single triggers have, and less noise."""
    volts = {}
    for averages in (1, 16):
        run = tmp_path / str(averages)
        asked = ("run", "image-readout", *SMALL, "--set", f"averages={averages}", "--station", stations["six"])
        status, _ = as_json(capsys, *asked, "--out", run)
        assert status == 0
        volts[averages], code_type, complete = measured(run)
        assert code_type == np.int16
        assert complete
    assert np.mean(volts[1] - volts[16]) == pytest.approx(0, abs=0.1 * float(np.std(volts[1])))


@pytest.mark.parametrize("command", [("run", "sequence-readout", "--set", "symbols=50"), ("align",)])
def test_what_samples_faster_is_refused_before_there_is_light(
    command: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if "sequence-readout" in command:
        require("santa-fe")
    station, out = tmp_path / "bench.toml", tmp_path / "out"
    station.write_text("[scope]\ndriver = 'tektronix-mso6b'\n[wiring]\nprojector = false\n")
    status, found = as_json(capsys, *command, "--station", station, "--out", out)
    assert status == 2
    assert found["error"] == (
        "scope sample rate = 5e+10 S/s is outside 1..2.5e+10 S/s: use one that samples so fast, such as the DPO72504DX"
    )
    assert not out.exists()


def test_playings_of_a_scene_are_averaged_in_its_codes(
    stations: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four records of 16 bits, whose sum would not fit: their mean is the light that one of them shows."""
    volts = {}
    small = ("--set", "images=4", "--set", "scenes=1", "--set", "ports=2", "--set", "window=0.2 us")
    for averages in (1, 4):
        run = tmp_path / str(averages)
        asked = ("run", "dynamic-scene", *small, "--set", f"averages={averages}", "--station", stations["six"])
        status, _ = as_json(capsys, *asked, "--out", run)
        assert status == 0
        with open_run(run) as found:
            assert found.frames.dtype == np.int16
            volts[averages] = found.volts()
    assert np.std(volts[4] - volts[1]) < np.std(volts[1]) / 2
    assert np.mean(volts[4]) == pytest.approx(np.mean(volts[1]), rel=0.05)
