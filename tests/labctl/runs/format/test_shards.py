from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from instruments.values import Frames
from labctl.errors import RunError
from labctl.runs.format.shards import Shard
from labctl.runs.format.shots import RunShape

Measure = Callable[[RunShape, int, int], Frames]


@pytest.fixture
def shard(small: RunShape, measure: Measure) -> Shard:
    frames = Frames.joined([measure(small, 0, shot) for shot in range(2, 5)])
    return Shard.of(0, 2, frames, 1, np.full(4, 1e-3), np.zeros(4))


def test_plain_h5py_reads_a_shard(tmp_path: Path, shard: Shard, small: RunShape) -> None:
    (tmp_path / "shard.h5").write_bytes(shard.encode(small))
    with h5py.File(tmp_path / "shard.h5") as file:
        assert file["frames"].shape == (3, 4, 16)
        assert file["rows"]["shot"].tolist() == [2, 3, 4]
        assert file.attrs["ports"].tolist() == [2, 3, 4, 5]
        np.testing.assert_array_equal(file["frames"][:], shard.frames)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"samples": 17}, "frames are not of this run's shape"),
        ({"code_type": "int16"}, "frames are not of this run's shape"),
        ({"shots": 4}, "its shots are not a range of this run's"),
    ],
)
def test_a_shard_of_another_run_is_refused(
    shard: Shard, small: RunShape, other: dict[str, object], message: str
) -> None:
    with pytest.raises(RunError, match=message):
        Shard.decode(shard.encode(small), replace(small, **other), "a shard")  # type: ignore[arg-type]


def test_a_shard_of_an_unknown_pass_is_refused(shard: Shard, small: RunShape) -> None:
    image = replace(shard, pass_index=1).encode(small)
    with pytest.raises(RunError, match="a shard: pass 1 is not one of this run"):
        Shard.decode(image, replace(small, passes=((2, 3, 4, 5),)), "a shard")
