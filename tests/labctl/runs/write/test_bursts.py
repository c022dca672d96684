"""Shots that come together are stored as if they had come one by one."""

from pathlib import Path

import numpy as np
import pytest

from instruments.values import Frames
from labctl.runs.format.columns import shot_table
from labctl.runs.format.shape import RunShape
from labctl.runs.read.run import open_run
from labctl.runs.write.durability import Durability
from labctl.runs.write.writer import RunWriter

SHOTS = 50
SHAPE = RunShape(shots=SHOTS, passes=((2, 3), (6,)), samples=8, sample_interval_s=40e-12)


def create(directory: Path, durability: Durability | None = None) -> RunWriter:
    plan = shot_table(
        kind=np.full(SHOTS, "image"),
        dataset_index=np.arange(SHOTS),
        label=np.arange(SHOTS) % 4,
        wavelength_nm=np.full(SHOTS, 1550.0),
        group=np.arange(SHOTS),
    )
    return RunWriter.create(directory, {"protocol": "test"}, SHAPE, plan, durability=durability)


def burst(pass_index: int) -> Frames:
    ports = len(SHAPE.passes[pass_index])
    codes = np.random.default_rng(pass_index).integers(-128, 128, (SHOTS, ports, 8), dtype=np.int8)
    return Frames(codes, np.zeros((SHOTS, ports)), np.linspace(0.0, 1.0, SHOTS), codes.max(axis=2) > 126)


def test_in_bursts_or_one_by_one_the_run_is_the_same(tmp_path: Path) -> None:
    with create(tmp_path / "together", Durability(shard_bytes=200)) as writer:
        for index in (0, 1):
            writer.scales(index, 1e-3, 0.0)
            whole = burst(index)
            writer.append(index, 0, whole.part(0, 30), index)
            assert writer.done[index] == 30
            writer.append(index, 30, whole.part(30, SHOTS), index)
    with create(tmp_path / "single") as writer:
        for index in (0, 1):
            writer.scales(index, 1e-3, 0.0)
            for place in range(SHOTS):
                writer.append(index, place, burst(index).part(place, place + 1), index)
    with open_run(tmp_path / "together") as together, open_run(tmp_path / "single") as single:
        assert together.complete
        assert together.digest() == single.digest()
        assert together.shots.tobytes() == single.shots.tobytes()
        assert np.array_equal(together.clipped, single.clipped)


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    with create(tmp_path / "run") as writer:
        whole = burst(0)
        with pytest.raises(ValueError, match="scales of pass 0 are not set"):
            writer.append(0, 0, whole)
        writer.scales(0, 1e-3, 0.0)
        writer.append(0, 0, whole.part(0, 10))
        with pytest.raises(ValueError, match="in the run already"):
            writer.append(0, 5, whole.part(5, 20))
        with pytest.raises(ValueError, match="are not those of a run"):
            writer.append(1, 0, whole)
