import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from instruments.values import Frames
from labctl.errors import RunError
from labctl.runs.format.global_heaps import HEAP
from labctl.runs.format.shape import RunShape
from labctl.runs.format.shard import Shard, encode

Measure = Callable[[RunShape, int, int], Frames]


@pytest.fixture
def parts(small: RunShape, measure: Measure) -> list[Frames]:
    return [measure(small, 0, shot) for shot in range(2, 5)]


@pytest.fixture
def image(small: RunShape, parts: list[Frames]) -> bytes:
    return bytes(encode(small, 0, 2, parts, 1, np.full(4, 1e-3), np.zeros(4)))


def test_plain_h5py_reads_a_shard(tmp_path: Path, image: bytes, parts: list[Frames]) -> None:
    (tmp_path / "shard.h5").write_bytes(image)
    with h5py.File(tmp_path / "shard.h5") as file:
        assert file["rows"]["shot"].tolist() == [2, 3, 4]
        assert file.attrs["ports"].tolist() == [2, 3, 4, 5]
        np.testing.assert_array_equal(file["frames"][:], np.concatenate([part.codes for part in parts]))
    assert HEAP not in image, "texts have a fixed length"


def test_codes_are_copied_once_on_the_way_in_and_not_at_all_on_the_way_out() -> None:
    shape = RunShape(100, ((2, 3),), 20_000, 20e-12, "int16")
    codes = np.random.default_rng(1).integers(-(2**15), 2**15, (100, 2, 20_000), np.int16)
    burst = Frames(codes, np.zeros((100, 2)), np.arange(100.0), np.zeros((100, 2), np.bool_))
    for parts in ([burst], [burst.part(shot, shot + 1) for shot in range(100)]):
        tracemalloc.start()
        try:
            image = encode(shape, 0, 0, parts, 0, np.ones(2), np.zeros(2))
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak < 1.2 * codes.nbytes
        stored = bytes(image)
        shard = Shard.decode(stored, shape, "a shard")
        np.testing.assert_array_equal(shard.frames, codes)
        assert np.shares_memory(shard.frames, np.frombuffer(stored, np.uint8))


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"samples": 17}, "frames are not of this run's shape"),
        ({"code_type": "int16"}, "frames are not of this run's shape"),
        ({"shots": 4}, "its shots are not a range of this run's"),
    ],
)
def test_a_shard_of_another_run_is_refused(
    image: bytes, small: RunShape, other: dict[str, object], message: str
) -> None:
    with pytest.raises(RunError, match=message):
        Shard.decode(image, replace(small, **other), "a shard")  # type: ignore[arg-type]


def test_a_shard_of_an_unknown_pass_is_refused(small: RunShape, measure: Measure) -> None:
    image = bytes(encode(small, 1, 2, [measure(small, 1, 2)], 1, np.ones(1), np.zeros(1)))
    with pytest.raises(RunError, match="a shard: pass 1 is not one of this run"):
        Shard.decode(image, replace(small, passes=((2, 3, 4, 5),)), "a shard")
