"""What a run needs of the disk, against what runs really take, and what is said when there is less."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from instruments.values import Drive, Frames
from labctl.errors import RunError
from labctl.runs.format.shape import RunShape
from labctl.runs.verification import verify_run
from labctl.runs.write.durability import Durability
from labctl.runs.write.room import (
    LOG_OF_A_PASS,
    LOG_OF_A_SHOT,
    MANIFEST,
    PAGE,
    data_file,
    measured,
    needed,
    shots_a_shard,
)
from labctl.runs.write.writer import RunWriter

Begin = Callable[..., RunWriter]
Plan = Callable[[RunShape], NDArray[Any]]


def taken(*folders: Path) -> int:
    """Bytes of all files, as the file system counts them."""
    files = [path.stat() for folder in folders for path in folder.rglob("*") if path.is_file()]
    return sum(max(file.st_size, 512 * file.st_blocks) for file in files)


def zeros(shape: RunShape, pass_index: int, count: int) -> Frames:
    ports = len(shape.passes[pass_index])
    return Frames(
        np.zeros((count, ports, shape.samples), shape.dtype),
        np.zeros((count, ports)),
        np.arange(count, dtype=np.float64),
        np.zeros((count, ports), np.bool_),
    )


@pytest.mark.parametrize(
    ("shots", "passes", "samples", "code_type", "a_shard", "drive_samples"),
    [
        (7, ((2, 3, 4, 5), (6,)), 16, "int8", 3, 50),
        (300, ((2, 3, 4, 5), (6,)), 10, "int8", 1, 2500),
        (1000, ((2, 3),), 50, "int16", 20, 100_000),
        (90, ((1, 2, 3, 4), (5, 6, 7, 8), (9,)), 20_000, "int8", 45, 50),
        (2, ((1,),), 400_000, "int16", 1, 0),
        pytest.param(200_000, ((1, 2), (3,)), 10, "int8", 5000, 50, marks=pytest.mark.full),
    ],
)
def test_the_estimate_is_enough_and_little_more(
    tmp_path: Path,
    plan_for: Plan,
    shots: int,
    passes: tuple[tuple[int, ...], ...],
    samples: int,
    code_type: Any,
    a_shard: int,
    drive_samples: int,
) -> None:
    """Beside what is allowed for manifest and commands.log: at most 2 % and 12 pages a pass, file or shard too much."""
    shape = RunShape(shots, passes, samples, 40e-12, code_type=code_type)
    drive = Drive("drive", np.zeros(drive_samples, np.float32), 25e9, 0.5) if drive_samples else None
    durability, plan = Durability(a_shard, 3600), plan_for(shape)
    estimate = needed(shape, drive, shots_a_shard(shape, durability))
    with RunWriter.create(tmp_path / "run", {}, shape, plan, drive, durability) as writer:
        for index in range(len(passes)):
            writer.scales(index, 1.0, 0.0)
            for first in range(0, shots, a_shard):
                writer.append(index, first, zeros(shape, index, min(a_shard, shots - first)))
    real = taken(tmp_path / "run")
    allowed = 2 * MANIFEST + len(passes) * (LOG_OF_A_PASS + shots * LOG_OF_A_SHOT)
    shards = len(list((tmp_path / "run" / "shards").iterdir()))
    assert real <= estimate - allowed + 2 * PAGE  # the manifest's own two
    assert estimate - allowed <= 1.02 * real + (12 * len(passes) + shards) * PAGE


def test_shards_close_by_number_size_or_age_and_with_a_burst(small: RunShape) -> None:
    durability = Durability(shots=20, seconds=1.0, shard_bytes=10 * 4 * small.samples)
    assert shots_a_shard(small, replace(durability, shard_bytes=10**9), 0.0) == 20
    assert shots_a_shard(small, durability, 0.0) == 10
    assert shots_a_shard(small, durability, 0.25) == 4
    assert shots_a_shard(small, durability, 3.0) == 1
    assert shots_a_shard(small, durability, 0.25, together=2) == 2


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Says how much of the disk is free."""

    def leave(size: int) -> None:
        monkeypatch.setattr("labctl.runs.write.room.shutil.disk_usage", lambda _path: usage._replace(free=size))

    usage = shutil.disk_usage(".")
    return leave


def test_a_run_begins_where_there_is_room_for_all_of_it_and_leaves_no_trace_where_there_is_not(
    tmp_path: Path, begin: Begin, small: RunShape, free: Callable[[int], None]
) -> None:
    drive = Drive("drive", np.zeros(50, np.float32), 25e9, 0.5)
    size = needed(small, drive, shots_a_shard(small, Durability(3, 3600)))
    free(size - 1)
    with pytest.raises(RunError, match=r"run: up to .* kB are needed and the disk has .* kB free: make room"):
        begin(tmp_path / "deep" / "run")
    assert not list(tmp_path.iterdir())
    free(size)
    begin(tmp_path / "deep" / "run").abandon()


def test_a_resumed_run_needs_room_for_the_rest_alone(
    cut: Path, small: RunShape, measure_missing: Callable[[RunWriter], None], free: Callable[[int], None]
) -> None:
    drive = Drive("drive", np.zeros(50, np.float32), 25e9, 0.5)
    rest = measured(small, (0, 4), 10 / 4) + data_file(small, drive)
    free(rest - 1)
    with pytest.raises(RunError, match="are needed and the disk has"):
        RunWriter.resume(cut)
    free(rest)
    with RunWriter.resume(cut) as writer:
        measure_missing(writer)
    free(0)
    with RunWriter.resume(cut) as writer:
        assert writer.finish(), "a run that lacks nothing needs nothing"


def test_too_little_for_the_rest_is_told_once_and_the_run_goes_on(
    tmp_path: Path,
    begin: Begin,
    measure_missing: Callable[[RunWriter], None],
    free: Callable[[int], None],
    caplog: pytest.LogCaptureFixture,
) -> None:
    told: list[str] = []
    with begin(tmp_path / "run", on_warning=told.append) as writer:
        free(100_000)
        measure_missing(writer)
    (line,) = told
    assert line.startswith(f"{tmp_path / 'run'}: the disk has 100 kB free and up to ")
    assert "are still to come: make room while the run goes on" in line
    assert caplog.messages == told
    assert verify_run(tmp_path / "run").complete


def test_a_shard_that_does_not_fit_ends_the_run_as_a_full_disk_does(
    tmp_path: Path, begin: Begin, measure_missing: Callable[[RunWriter], None], free: Callable[[int], None]
) -> None:
    writer = begin(tmp_path / "run")
    free(2 * PAGE - 1)
    with pytest.raises(
        RunError, match=r"shards/000000.h5: cannot be written: No space left on device \(8.19 kB needed"
    ):
        measure_missing(writer)
    with pytest.raises(RunError, match="make room, then `labctl resume` the run"):
        writer.finish()
    assert not list((tmp_path / "run" / "shards").iterdir())
    free(10**9)
    with RunWriter.resume(tmp_path / "run") as writer:
        measure_missing(writer)
    assert verify_run(tmp_path / "run").complete


def test_a_file_system_that_does_not_say_is_told_in_one_line(
    tmp_path: Path, begin: Begin, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_path: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("labctl.runs.write.room.shutil.disk_usage", fail)
    with pytest.raises(RunError, match="run: cannot be written: Permission denied"):
        begin(tmp_path / "run")
