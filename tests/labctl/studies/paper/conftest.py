"""Small runs with given frames, and what an analysis is given to examine."""

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
from protocols.base import Shot

SCALE_V = 1e-3
MANIFEST = {"protocol": "synthetic", "started": "2026-11-21T09:15:00Z", "seed": 1, "twin_seed": 1}

WriteRun = Callable[..., Path]


def write(
    directory: Path, shots: list[Shot], codes: NDArray[np.integer], ports: tuple[int, ...], interval_s: float
) -> Path:
    """A finished run of `codes` (shots, ports, samples), 1 mV each."""
    shape = RunShape(len(shots), (ports,), codes.shape[-1], interval_s, "int16")
    columns: dict[str, Any] = {
        name: np.array([getattr(shot, name) for shot in shots])
        for name in ("dataset_index", "label", "group", "next_dataset_index", "next_label")
    }
    plan = shot_table(
        kind=np.array([str(shot.kind) for shot in shots]), wavelength_nm=np.full(len(shots), 1550.0), **columns
    )
    drive = Drive("drive", np.zeros(50, np.float32), 25e9, 0.5)
    with RunWriter.create(directory, MANIFEST, shape, plan, drive, Durability(shots=100, seconds=3600)) as writer:
        writer.scales(0, SCALE_V, 0.0)
        none = np.zeros(codes.shape[:2])
        writer.append(
            0, 0, Frames(codes.astype(np.int16), none, np.arange(len(codes), dtype=np.float64), none.astype(bool)), 1
        )
    return directory


@pytest.fixture(name="write_run")
def write_run_fixture() -> WriteRun:
    return write
