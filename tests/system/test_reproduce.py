"""What `labctl reproduce` refuses of the experiments of the house."""

from pathlib import Path

import pytest

from tests.command_line import as_json


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
