"""A run in a process of its own that is paused, let go on and stopped from another one."""

import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from labctl.runs.live.events import EventReader
from labctl.runs.read.run import open_run
from tests.command_line import as_json

Served = tuple[dict[str, Any], Path]
LONG = ("--set", "images=1000", "--set", "window=0.8 ns")
LOOK_EVERY_S = 0.02


@pytest.fixture
def running(
    served: Served, labctl_command: tuple[str, ...], emitting: Callable[[], bool], tmp_path: Path
) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    directory = tmp_path / "run"
    command = [*labctl_command, "run", "image-readout", *LONG, "--station", str(served[1]), "--out", str(directory)]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as process:
        until(directory, "progress", process)
        yield process, directory
        process.kill()


def until(directory: Path, event: str, process: subprocess.Popen[bytes], after: str = "run started") -> None:
    """Read the events until that one came after another; the process must not end before."""
    reader, names = EventReader(directory / "events.jsonl"), list[str]()
    while after not in names or event not in names[names.index(after) :]:
        names += [found.name for found in reader.read()]
        with suppress(subprocess.TimeoutExpired):
            process.wait(LOOK_EVERY_S)
            raise AssertionError(f"the run ended before {event}")


@pytest.mark.full
def test_pause_go_on_and_stop_now(
    running: tuple[subprocess.Popen[bytes], Path],
    emitting: Callable[[], bool],
    capsys: pytest.CaptureFixture[str],
) -> None:
    process, directory = running
    assert emitting()
    assert as_json(capsys, "pause", directory)[0] == 0
    until(directory, "paused", process)
    assert not emitting()
    assert as_json(capsys, "go-on", directory)[0] == 0
    until(directory, "progress", process, after="going on")
    process.send_signal(signal.SIGSTOP)  # as if it were waiting for an instrument: it looks at no file
    status, told = as_json(capsys, "stop", directory, "--now")
    assert (status, told) == (0, {"run": str(directory), "asked": "stop now", "process": process.pid})
    process.send_signal(signal.SIGCONT)
    assert process.wait(30) == 130
    assert not emitting()
    with open_run(directory) as run:
        assert 0 < run.done[0] < run.shape.shots
    status, told = as_json(capsys, "stop", directory)
    assert status == 2
    assert "no process of this machine is writing this run: nothing to stop" in told["error"]
