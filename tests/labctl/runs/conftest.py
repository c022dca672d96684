"""A small run whose every byte follows from its shape, so that any two ways of writing it can be compared."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from instruments.values import Drive, Frames
from labctl.runs.format.columns import shot_table
from labctl.runs.format.shape import RunShape
from labctl.runs.write.durability import Durability
from labctl.runs.write.writer import RunWriter

MANIFEST = {
    "protocol": "image-readout",
    "started": "2026-11-21T09:15:00Z",
    "seed": 7,
    "twin_seed": 3,
    "instruments": {"awg": {"identity": {"serial": "SIM0001"}}},
}
SMALL = RunShape(shots=7, passes=((2, 3, 4, 5), (6,)), samples=16, sample_interval_s=20e-12, start_s=-40e-12)


def plan_for(shape: RunShape) -> NDArray[Any]:
    index = np.arange(shape.shots)
    kind = np.array(["reference", "dark", "image"])[np.minimum(index % 20, 2)]
    return shot_table(
        kind=kind,
        dataset_index=np.where(kind == "image", index, -1),
        label=index % 10,
        wavelength_nm=np.full(index.size, 1550.0),
        group=index // 2,
    )


def measure(shape: RunShape, pass_index: int, shot: int) -> Frames:
    generator = np.random.default_rng((pass_index, shot))
    ports = len(shape.passes[pass_index])
    limits = np.iinfo(shape.dtype)
    return Frames(
        codes=generator.integers(limits.min, limits.max + 1, (1, ports, shape.samples), shape.dtype),
        trigger_offset_s=generator.uniform(0, shape.sample_interval_s, (1, ports)),
        time_s=np.array([10.0 * pass_index + 0.01 * shot]),
        clipped=generator.random((1, ports)) < 0.1,
    )


def begin(directory: Path, shape: RunShape = SMALL, shots: int = 3, **options: Callable[..., object]) -> RunWriter:
    drive = Drive("ramp", np.linspace(-1, 1, 50, dtype=np.float32), 25e9, 0.4)
    durability = Durability(shots=shots, seconds=3600)
    return RunWriter.create(directory, MANIFEST, shape, plan_for(shape), drive, durability, **options)  # type: ignore[arg-type]


def measure_missing(writer: RunWriter, shape: RunShape = SMALL) -> None:
    for pass_index in range(len(shape.passes)):
        writer.scales(pass_index, 1e-3 * (pass_index + 1), 0.05)
        for shot in writer.missing(pass_index):
            writer.append(pass_index, int(shot), measure(shape, pass_index, int(shot)), pass_index + 1)


def measure_until(writer: RunWriter, last: int) -> None:
    """All shots of the first pass, and of the second those before `last`."""
    for pass_index, stop in ((0, SMALL.shots), (1, last)):
        writer.scales(pass_index, 1e-3 * (pass_index + 1), 0.05)
        for shot in range(stop):
            writer.append(pass_index, shot, measure(SMALL, pass_index, shot), pass_index + 1)


def write_whole(directory: Path, shape: RunShape = SMALL, shots: int = 3) -> Path:
    with begin(directory, shape, shots) as writer:
        measure_missing(writer, shape)
    return directory


@pytest.fixture(scope="session", name="small")
def small_shape() -> RunShape:
    return SMALL


@pytest.fixture(scope="session", name="plan_for")
def plan_for_fixture() -> Callable[[RunShape], NDArray[Any]]:
    return plan_for


@pytest.fixture(scope="session", name="measure")
def measure_fixture() -> Callable[[RunShape, int, int], Frames]:
    return measure


@pytest.fixture(scope="session", name="begin")
def begin_fixture() -> Callable[..., RunWriter]:
    return begin


@pytest.fixture(scope="session", name="measure_missing")
def measure_missing_fixture() -> Callable[..., None]:
    return measure_missing


@pytest.fixture(scope="session", name="measure_until")
def measure_until_fixture() -> Callable[[RunWriter, int], None]:
    return measure_until


@pytest.fixture(scope="session", name="write_whole")
def write_whole_fixture() -> Callable[..., Path]:
    return write_whole


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    """A finished run."""
    return write_whole(tmp_path / "whole")


@pytest.fixture
def cut(tmp_path: Path) -> Path:
    """A run whose process died after 5 shots of the second pass, 2 of them only in memory."""
    writer = begin(tmp_path / "cut")
    measure_until(writer, 5)
    writer.abandon()
    return tmp_path / "cut"
