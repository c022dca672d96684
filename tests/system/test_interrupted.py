"""A run stopped from outside, in a process of its own: the finished shots are kept and the bench is dark."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from labctl.runs.format.journal import read_journal
from labctl.runs.format.layout import RunPaths
from labctl.runs.read.run import open_run
from tests.system.waiting import until_stored

Served = tuple[dict[str, Any], Path]
Labctl = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def running(served: Served, labctl_command: tuple[str, ...], tmp_path: Path) -> Iterator[tuple[Any, Path]]:
    """A long run that has measured its first shots."""
    directory = tmp_path / "run"
    command = [*labctl_command, "run", "image-readout", "--station", str(served[1]), "--out", str(directory)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        until_stored(process, directory)
        yield process, directory
        process.kill()


def is_dark(served: Served) -> bool:
    import pyvisa

    laser: Any = pyvisa.ResourceManager("@py").open_resource(served[0]["laser"]["socket"], read_termination="\n")
    try:
        return str(laser.query("OUTPUT?")) == "0"
    finally:
        laser.close()


@pytest.mark.parametrize(
    "signals", [[signal.SIGINT], [signal.SIGTERM], [signal.SIGHUP], [signal.SIGINT, signal.SIGINT]]
)
def test_finished_shots_are_kept_and_it_is_dark(
    served: Served, running: tuple[Any, Path], signals: list[signal.Signals]
) -> None:
    process, directory = running
    # A shard has a second line once it is sure.
    stored = sum({entry.shard: entry.count for entry in read_journal(RunPaths(directory).journal).entries}.values())
    for number in signals:
        process.send_signal(number)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert is_dark(served)
    with open_run(directory) as run:
        assert not run.complete
        assert max(run.done) >= stored > 0, (err, run.manifest.get("suspect"))


IN_A_TERMINAL = """
import fcntl, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
from labctl.commands.main import main
main(sys.argv[1:])
"""


def test_a_closed_terminal_ends_it_dark(served: Served, tmp_path: Path) -> None:
    directory, journal = tmp_path / "run", tmp_path / "run" / "journal.jsonl"
    ours, theirs = os.openpty()
    arguments = ("run", "image-readout", "--station", str(served[1]), "--out", str(directory))
    with subprocess.Popen(
        [sys.executable, "-c", IN_A_TERMINAL, *arguments],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        start_new_session=True,
    ) as process:
        os.close(theirs)
        while process.poll() is None and not (journal.exists() and journal.stat().st_size):
            os.read(ours, 65536)  # the progress line, whose terminal would be full otherwise
        os.close(ours)
        assert process.wait(30) == 130
    assert is_dark(served)
    first = json.loads(journal.read_text().splitlines()[0])
    with open_run(directory) as run:
        assert not run.complete
        assert max(run.done) >= first["count"] > 0
    assert " ! run ended without" not in (directory / "commands.log").read_text(), "it needed no supervisor"


def _copied(directory: Path) -> None:
    journal = directory / "journal.jsonl"
    copy = journal.with_name("copy")
    copy.write_bytes(journal.read_bytes())
    copy.replace(journal)


@pytest.mark.parametrize(
    "touch",
    [
        lambda directory: (directory / "journal.jsonl").unlink(),
        lambda directory: (directory / "journal.jsonl").write_bytes(b""),
        lambda directory: (directory / "journal.jsonl").write_text("something else\n" * 1000, encoding="utf-8"),
        _copied,
    ],
    ids=["removed", "emptied", "overwritten", "replaced by its copy"],
)
def test_a_journal_that_somebody_touches_is_written_anew_and_ends_the_run_dark(
    served: Served, running: tuple[Any, Path], touch: Callable[[Path], object], labctl: Labctl
) -> None:
    process, directory = running
    touch(directory)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 2
    first, second = [line for line in err.splitlines() if line.startswith("labctl: ")][-2:]
    assert first.startswith(f"labctl: {directory}/journal.jsonl: was removed or changed while the run went on; ")
    assert second == f"labctl: the run can go on: labctl resume {directory}"
    assert "Traceback" not in err
    assert is_dark(served)
    status, report = labctl("verify", directory)
    assert status == 0
    assert report["shards"] == len(list((directory / "shards").iterdir()))
    assert max(report["passes"]) + report["suspect"] >= 20


@pytest.mark.parametrize("replaced", [False, True])
@pytest.mark.parametrize("what", ["shards", "."])
def test_a_folder_that_somebody_takes_away_ends_the_run_dark_and_what_is_in_it_stays(
    served: Served, running: tuple[Any, Path], what: str, replaced: bool, labctl: Labctl, tmp_path: Path
) -> None:
    process, directory = running
    folder, elsewhere = (directory / what).resolve(), tmp_path / "elsewhere"
    folder.rename(elsewhere)
    if replaced:
        folder.mkdir()
    _, err = process.communicate(timeout=30)
    assert process.returncode == 2
    told = [line for line in err.splitlines() if line.startswith("labctl: ")]
    assert any(line.startswith((f"labctl: {directory}/", f"labctl: {directory}: is gone")) for line in told), err
    assert any("put it back" in line or "put its folder back" in line for line in told), err
    assert "Traceback" not in err
    assert is_dark(served)
    if folder.exists():
        shutil.rmtree(folder)
    elsewhere.rename(folder)
    status, report = labctl("verify", directory)
    assert status == 0
    assert max(report["passes"]) + report["suspect"] >= 20
