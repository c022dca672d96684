"""A disk that fails at any of the moments at which a run writes to it: one line that says so, and nothing torn."""

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from labctl.runs.format.layout import RunPaths
from labctl.runs.verification import verify_run
from tests import command_line

RUN = ("run", "image-readout", "--set", "images=4", "--set", "ports=2", "--set", "window=0.4 ns", "--json")
ADVICE = {errno.EIO: "the disk fails", errno.ESTALE: "the network share is gone", errno.EXDEV: "one file system"}


def fails_from(moment: int, number: int, call: Callable[..., Any]) -> Callable[..., Any]:
    """`call`, which fails with an error from some time on."""
    calls = 0

    def failing(*arguments: object) -> Any:
        nonlocal calls
        calls += 1
        if calls > moment:
            raise OSError(number, os.strerror(number))
        return call(*arguments)

    return failing


@pytest.mark.parametrize("moment", range(12))
@pytest.mark.parametrize(("name", "number"), [("fsync", errno.EIO), ("fsync", errno.ESTALE), ("replace", errno.EXDEV)])
def test_it_is_told_in_one_line_that_says_what_to_do(
    name: str,
    number: int,
    moment: int,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    directory = tmp_path / "run"
    monkeypatch.setattr(os, name, fails_from(moment, number, getattr(os, name)))
    status, out, err = command_line.labctl(capsys, *RUN, "--out", directory)
    monkeypatch.undo()
    if status == 0:
        return  # it had been written by then
    assert status == 2
    first, *others = [line for line in err.splitlines() if line.startswith("labctl: ")]
    assert os.strerror(number) in first
    assert ADVICE[number] in first
    assert "make room" not in err
    assert "did not expect" not in err
    assert json.loads(out)["error"] == first.removeprefix("labctl: ")
    assert all("labctl resume" in line for line in others)
    if RunPaths(directory).manifest.exists():
        assert verify_run(directory).intact
