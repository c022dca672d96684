"""A run is running while a process holds its lock, and at no other time."""

import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from labctl.commands.main import main
from labctl.runs.catalogue import Catalogue
from labctl.runs.format.layout import RunPaths
from labctl.runs.live import owner
from labctl.runs.live.logs import EventLog
from labctl.runs.live.owner import writer_of
from labctl.runs.write.writer import RunWriter
from tests.checkout import ROOT


def states(capsys: pytest.CaptureFixture[str], folder: Path, *options: str) -> dict[str, str]:
    """By name, as `labctl runs` lists them."""
    with pytest.raises(SystemExit) as ended:
        main(["runs", str(folder), *options, "--json"])
    assert ended.value.code == 0
    return {Path(row["run"]).name: row["state"] for row in json.loads(capsys.readouterr().out)["runs"]}


def claim(directory: Path, process: int) -> None:
    """Events that name a process."""
    with EventLog() as events:
        events.event("run started", process=process, host=platform.node(), heeds_signals=True)
        events.keep_in(RunPaths(directory).events)


@pytest.fixture(params=[True, False], ids=["Linux", "elsewhere"])
def _shown(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Whether the system shows which process has a lock."""
    if not request.param:
        monkeypatch.setattr(owner, "_PROCESSES", tmp_path / "no processes")
    elif not Path("/proc").is_dir():
        pytest.skip("only Linux tells who holds a lock")


@pytest.mark.usefixtures("_shown")
def test_a_run_is_running_as_long_as_its_writer_lives(
    cut: Path, whole: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, live = cut.parent, cut.parent / "live"
    command = [sys.executable, str(Path(__file__).with_name("running_writer.py")), str(live)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    talk = partial(subprocess.Popen[str], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    with talk(command, env=environment) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "writing\n"
        claim(whole, process.pid)
        claim(cut, process.pid)
        assert states(capsys, folder) == {"cut": "incomplete", "live": "running", "whole": "complete"}
        assert states(capsys, folder, "--state", "running") == {"live": "running"}
        found = writer_of(RunPaths(live))
        assert found is not None
        assert (found.process, found.heeds_signals) == (process.pid, True)
    assert states(capsys, folder)["live"] == "incomplete"


@pytest.mark.usefixtures("_shown")
def test_whoever_reads_a_run_does_not_write_it(cut: Path, measure_missing: Callable[[RunWriter], None]) -> None:
    claim(cut, os.getpid())
    with RunPaths(cut).journal.open("rb"), RunPaths(cut).events.open("ab"):
        assert writer_of(RunPaths(cut)) is None
        assert [one.row.state for one in Catalogue(cut.parent).find()] == ["incomplete"]
    with RunWriter.resume(cut) as writer:
        assert [one.row.state for one in Catalogue(cut.parent).find()] == ["running"]
        measure_missing(writer)
    assert [one.row.state for one in Catalogue(cut.parent).find()] == ["complete"]


@pytest.mark.usefixtures("_shown")
def test_a_live_view_or_sweep_has_an_owner_as_long_as_its_folder_is_held(tmp_path: Path) -> None:
    claim(tmp_path, os.getpid())
    assert writer_of(RunPaths(tmp_path)) is None
    with owner.owned(tmp_path):
        assert writer_of(RunPaths(tmp_path)) is not None
        with pytest.raises(BlockingIOError), owner.owned(tmp_path):
            pass
    assert writer_of(RunPaths(tmp_path)) is None
