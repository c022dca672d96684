"""What `labctl reproduce` refuses of the experiments of the house."""

import json
from pathlib import Path

import pytest

from labctl.main import main


def reproduce(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict[str, object]]:
    with pytest.raises(SystemExit) as ended:
        main(["reproduce", *words, "--json"])
    shown: dict[str, object] = json.loads(capsys.readouterr().out)
    return int(ended.value.code or 0), shown


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
