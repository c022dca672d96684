"""A run put into its place: whole or not at all, and never over another."""

import subprocess
import sys
from pathlib import Path

import pytest

from labctl.errors import RunError
from labctl.runs.index import run_directories
from labctl.runs.write.placing import put_whole

KILLED = """
import os, sys
from pathlib import Path
from labctl.runs.write.placing import put_whole

sys.addaudithook(lambda event, _: os._exit(9) if event == "os.rename" else None)
put_whole(Path(sys.argv[1]), Path(sys.argv[2]))
"""
"""Ends when everything is copied, and nothing has its name yet."""


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "scratch" / "run"
    (folder / "shards").mkdir(parents=True)
    (folder / "manifest.json").write_text("mine", encoding="utf-8")
    (folder / "shards" / "000000.h5").write_text("frames", encoding="utf-8")
    return folder


def test_it_is_there_whole(run: Path, tmp_path: Path) -> None:
    assert put_whole(run, tmp_path / "lab" / "run")
    assert [one.name for one in (tmp_path / "lab").iterdir()] == ["run"]
    assert (tmp_path / "lab" / "run" / "shards" / "000000.h5").read_text(encoding="utf-8") == "frames"


def test_one_that_is_there_stays(run: Path, tmp_path: Path) -> None:
    there = tmp_path / "lab" / "run"
    there.mkdir(parents=True)
    (there / "manifest.json").write_text("theirs", encoding="utf-8")
    assert not put_whole(run, there)
    assert [one.read_text(encoding="utf-8") for one in there.iterdir()] == ["theirs"]


def test_what_is_no_run_is_not_replaced(run: Path, tmp_path: Path) -> None:
    there = tmp_path / "lab" / "run"
    there.mkdir(parents=True)
    (there / "thesis.txt").write_text("kept", encoding="utf-8")
    with pytest.raises(RunError, match="cannot be written"):
        put_whole(run, there)
    assert [one.name for one in (tmp_path / "lab").rglob("*")] == ["run", "thesis.txt"]


def test_what_a_killed_process_leaves_is_no_run(run: Path, tmp_path: Path) -> None:
    killed = subprocess.run([sys.executable, "-c", KILLED, run, tmp_path / "lab" / "run"], check=False)
    assert killed.returncode == 9
    assert [one.read_text(encoding="utf-8") for one in tmp_path.glob("lab/**/manifest.json")] == ["mine"]
    assert run_directories(tmp_path / "lab") == []
