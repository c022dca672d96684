"""An experiment of the house by the command, as it is, and what the command refuses."""

import json
from pathlib import Path

import pytest

from labctl.main import main


def reproduce(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict[str, object]]:
    with pytest.raises(SystemExit) as ended:
        main(["reproduce", *words, "--json"])
    shown: dict[str, object] = json.loads(capsys.readouterr().out)
    return int(ended.value.code or 0), shown


def test_traces_differ_between_images_before_and_behind_the_chip(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, entry = reproduce(capsys, "fig2", "--quick", "--out", str(tmp_path / "out"))
    assert status == 0
    assert entry["name"] == "fig2"
    assert entry["passed"] is True
    assert entry.keys() >= {"paper", "here", "baseline", "seeds", "splits", "seconds"}
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "Images become traces" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert json.loads((tmp_path / "out" / "report.json").read_text("utf-8"))["passed"] is True


def test_an_unknown_experiment_is_refused_before_anything_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, shown = reproduce(capsys, "fig99", "--out", str(tmp_path / "out"))
    assert status == 2
    assert "no experiment is called 'fig99'" in str(shown["error"])
    assert not (tmp_path / "out").exists()


def test_what_is_varied_must_be_said_by_the_experiment(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, shown = reproduce(capsys, "fig2", "--sensitivity", "--out", str(tmp_path / "out"))
    assert status == 2
    assert "says nothing to vary" in str(shown["error"])
