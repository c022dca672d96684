"""One run through a served bench, and the same run in-process."""

from pathlib import Path
from typing import Any

import pytest

from tests.command_line import as_json

Served = tuple[dict[str, Any], Path]

SETTINGS = ["--set", "images=20", "--set", "window=0.8 ns"]


def test_every_instrument_has_two_addresses(served: Served) -> None:
    resources, _ = served
    assert list(resources) == ["awg", "scope", "laser", "dmd", "patch_panel"]
    assert all(found["socket"].endswith("::SOCKET") for found in resources.values())
    assert all(found["hislip"].endswith("::INSTR") for found in resources.values())


def test_check_finds_them_well(served: Served, capsys: pytest.CaptureFixture[str]) -> None:
    status, found = as_json(capsys, "check", "--station", str(served[1]))
    assert status == 0
    assert found["ok"]
    assert "AWG70002A" in found["instruments"]["awg"]["identity"]


def test_served_or_in_process_the_frames_are_the_same(
    served: Served, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = ("run", "image-readout", *SETTINGS)
    status, far = as_json(capsys, *run, "--station", str(served[1]), "--out", str(tmp_path / "far"))
    assert status == 0
    _, near = as_json(capsys, *run, "--out", str(tmp_path / "near"))
    _, again = as_json(capsys, *run, "--out", str(tmp_path / "again"))
    _, other = as_json(capsys, *run, "--set", "seed=2", "--out", str(tmp_path / "other"))
    assert far["frames_sha256"] == near["frames_sha256"] == again["frames_sha256"]
    assert other["frames_sha256"] != near["frames_sha256"]


def test_another_twin_gives_other_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    station = tmp_path / "twin.toml"
    station.write_text("[sim]\ntwin_seed = 2\n", encoding="utf-8")
    run = ("run", "image-readout", *SETTINGS)
    _, first = as_json(capsys, *run, "--out", str(tmp_path / "one"))
    _, second = as_json(capsys, *run, "--station", str(station), "--out", str(tmp_path / "two"))
    assert first["frames_sha256"] != second["frames_sha256"]
