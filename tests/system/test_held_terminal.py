"""A terminal that takes nothing: held by Ctrl-S, or read by nobody. Whoever measures does not wait for it."""

import json
import os
import signal
import subprocess
import termios
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from labctl.runs.live.sight import LIVE
from tests.command_line import LABCTL
from tests.system.waiting import until, until_stored

PATIENCE_S = 60.0
RUN = ("run", "image-readout", "--set", "window=0.8 ns")


@pytest.fixture
def station(served: tuple[dict[str, Any], Path]) -> Path:
    return served[1]


@pytest.fixture
def held() -> Iterator[int]:
    """A terminal that is held, and that nobody reads."""
    ours, its = os.openpty()
    termios.tcflow(its, termios.TCOOFF)
    yield its
    os.close(its)
    os.close(ours)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        pytest.param((*RUN, "--set", "images=40", "--out={}/run"), ("complete", True), id="run"),
        pytest.param(("live", "--for=1 s", "--runs={}"), ("unwatched", False), id="live"),
        pytest.param(("align", "--out={}/aligned"), ("good", True), id="align", marks=pytest.mark.full),
    ],
)
def test_what_is_measured_is_measured_to_its_end_and_the_result_printed(
    words: tuple[str, ...],
    says: tuple[str, bool],
    station: Path,
    held: int,
    tmp_path: Path,
    emitting: Callable[[], bool],
) -> None:
    command = [*LABCTL, *(word.format(tmp_path) for word in words), f"--station={station}", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=held) as process:
        out, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    key, value = says
    assert json.loads(out)[key] is value
    assert not emitting()


@pytest.mark.parametrize(
    "words", [(*RUN, "--set", "images=2000", "--out={}/run"), ("live", "--runs={}")], ids=["run", "live"]
)
def test_one_ctrl_c_makes_it_dark(
    words: tuple[str, ...], station: Path, held: int, tmp_path: Path, emitting: Callable[[], bool]
) -> None:
    command = [*LABCTL, *(word.format(tmp_path) for word in words), f"--station={station}"]
    with subprocess.Popen(command, stdout=held, stderr=held) as process:
        if words[0] == "run":
            until_stored(process, tmp_path / "run")
        else:
            until(lambda: process.poll() is not None or list((tmp_path / LIVE).glob("*/sight")))
        until(emitting)
        process.send_signal(signal.SIGINT)
        until(lambda: not emitting())
        process.kill()
