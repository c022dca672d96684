"""What stays of a run when a file cannot grow any more."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from labctl.runs.format.shape import RunShape
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.runs.write.writer import RunWriter
from tests.checkout import ROOT

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs setrlimit")


@pytest.mark.parametrize(
    ("limit", "samples", "shots", "failing", "complete"),
    [
        (60_000, 500, 5, "data.h5", 60),  # all shots are stored, their common file does not fit
        (-1, 16, 20, "data.h5", 60),  # the last byte of it does not, which HDF5 writes when it closes the file
        (12_000, 500, 20, "shards/000000.h5", 0),  # not even a shard fits
        (9_000, 16, 1, "journal.jsonl", 0),  # the journal is full during the first pass
        (15_000, 16, 1, "journal.jsonl", 27),  # and during the second
        (2_000, 16, 1, "plan.h5", -1),
    ],
)
def test_a_full_disk_takes_nothing_that_was_stored(
    tmp_path: Path,
    small: RunShape,
    measure_missing: Callable[[RunWriter, RunShape], None],
    write_whole: Callable[[Path, RunShape, int], Path],
    limit: int,
    samples: int,
    shots: int,
    failing: str,
    complete: int,
) -> None:
    directory = tmp_path / "run"
    shape = replace(small, shots=60, samples=samples)
    whole = write_whole(tmp_path / "whole", shape, shots)
    if limit < 0:
        limit += (whole / "data.h5").stat().st_size
    ended = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("limited_writer.py")), str(directory)]
        + [str(number) for number in (limit, samples, shots)]
        + ["at once" if complete < 0 else "begun"],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        check=True,
        capture_output=True,
        text=True,
    )
    assert ended.stdout.startswith(f"{directory / failing}: cannot be written: File too large; ")
    assert ended.stdout.count("\n") == 1
    assert not ended.stderr
    assert not list(directory.rglob("*.tmp"))
    if complete < 0:
        assert [path.name for path in directory.glob("*.*")] == ["journal.jsonl"]
        assert verify_run(write_whole(directory, shape, shots)).complete  # there is room now
        return
    assert (directory / "journal.jsonl").read_bytes()[-1:] in (b"", b"\n")
    report = verify_run(directory)
    assert (report.problems, report.data_file, report.shots) == ((), "missing", complete)
    with RunWriter.resume(directory) as writer:
        measure_missing(writer, shape)
    assert verify_run(directory).data_file == "current"
    with open_run(directory) as run, open_run(whole) as expected:
        assert run.digest() == expected.digest()
