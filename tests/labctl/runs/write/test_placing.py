"""A run put into its place: whole or not at all, and never over another."""

from pathlib import Path

import pytest

from labctl.errors import RunError
from labctl.runs.write.placing import put_whole


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "scratch" / "run"
    (folder / "shards").mkdir(parents=True)
    (folder / "manifest.json").write_text("mine", encoding="utf-8")
    (folder / "shards" / "000000.h5").write_text("frames", encoding="utf-8")
    return folder


def test_it_is_there_whole(run: Path, tmp_path: Path) -> None:
    put_whole(run, tmp_path / "lab" / "run")
    assert [one.name for one in (tmp_path / "lab").iterdir()] == ["run"]
    assert (tmp_path / "lab" / "run" / "shards" / "000000.h5").read_text(encoding="utf-8") == "frames"


def test_one_that_is_there_stays(run: Path, tmp_path: Path) -> None:
    there = tmp_path / "lab" / "run"
    there.mkdir(parents=True)
    (there / "manifest.json").write_text("theirs", encoding="utf-8")
    put_whole(run, there)
    assert [one.read_text(encoding="utf-8") for one in there.iterdir()] == ["theirs"]


def test_what_is_no_run_is_not_replaced(run: Path, tmp_path: Path) -> None:
    there = tmp_path / "lab" / "run"
    there.mkdir(parents=True)
    (there / "thesis.txt").write_text("kept", encoding="utf-8")
    with pytest.raises(RunError, match="cannot be written"):
        put_whole(run, there)
    assert [one.name for one in (tmp_path / "lab").rglob("*")] == ["run", "thesis.txt"]
