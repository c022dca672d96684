"""A run stopped from outside, in a process of its own: the finished shots are kept and the bench is dark."""

import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from labctl.runs import open_run

Served = tuple[dict[str, Any], Path]


@pytest.fixture
def running(served: Served, labctl_command: tuple[str, ...], tmp_path: Path) -> Iterator[tuple[Any, Path]]:
    """A long run that has measured its first shots."""
    directory = tmp_path / "run"
    command = [*labctl_command, "run", "image-readout", "--station", str(served[1]), "--out", str(directory)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        journal = directory / "journal.jsonl"
        while process.poll() is None and not (journal.exists() and journal.stat().st_size):
            pass
        yield process, directory
        process.kill()


def is_dark(served: Served) -> bool:
    import pyvisa

    laser: Any = pyvisa.ResourceManager("@py").open_resource(served[0]["laser"]["socket"], read_termination="\n")
    try:
        return str(laser.query("OUTPUT?")) == "0"
    finally:
        laser.close()


@pytest.mark.parametrize("signals", [[signal.SIGINT], [signal.SIGTERM], [signal.SIGINT, signal.SIGINT]])
def test_finished_shots_are_kept_and_it_is_dark(
    served: Served, running: tuple[Any, Path], signals: list[signal.Signals]
) -> None:
    process, directory = running
    for number in signals:
        process.send_signal(number)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert is_dark(served)
    with open_run(directory) as run:
        assert not run.complete
        assert max(run.done) >= 20
