"""SIGKILL at every single step towards the disk."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from labctl.errors import RunError
from labctl.runs.format.shape import RunShape
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.runs.write.writer import RunWriter
from tests.checkout import ROOT

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


@pytest.mark.parametrize(
    "shots", [4, pytest.param(1, marks=pytest.mark.full), pytest.param(20, marks=pytest.mark.full)]
)
def test_a_killed_writer_loses_at_most_what_the_durability_allows(
    tmp_path: Path,
    small: RunShape,
    write_whole: Callable[..., Path],
    measure_missing: Callable[[RunWriter], None],
    shots: int,
) -> None:
    whole = open_run(write_whole(tmp_path / "whole", small, shots)).digest()
    script = Path(__file__).with_name("killed_writer.py")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    killed = subprocess.run(
        [sys.executable, str(script), str(tmp_path), str(shots)],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    runs = [json.loads(line) for line in killed.stdout.splitlines()]
    assert len(runs) > 30
    all_done = [small.shots] * len(small.passes)
    for number, last in enumerate(runs):
        if last and last[0][2] == all_done and number % 4:
            continue  # data.h5 alone is written in dozens of small steps
        directory = tmp_path / str(number)
        if not (directory / "manifest.json").exists():
            assert not last
            with pytest.raises(RunError):
                open_run(directory)
            write_whole(directory, small, shots)  # what it left is no run, and is not in the way of one
            assert verify_run(directory).complete, number
            continue
        with open_run(directory) as run:
            done = run.done
        if last:
            pass_index, appended, told = last[0]
            assert all(stored >= said for stored, said in zip(done, told, strict=True)), number
            assert done[pass_index] > appended - shots, number
            assert not pass_index or done[0] == small.shots
        assert not verify_run(directory).problems, number
        with RunWriter.resume(directory) as writer:
            measure_missing(writer)
        report = verify_run(directory)
        assert (report.complete, report.data_file, report.problems) == (True, "current", ()), number
        assert all("set aside as suspect" in note for note in report.notes), number  # what the journal did not name yet
        with open_run(directory) as run:
            assert run.digest() == whole, number
