"""What `open_run` costs beside plain h5py: a data.h5 of 100 MB read whole, at once and block by block.

The file is made where temporary files go, and is in the page cache when it is read. Opening it counts, and so does what
`open_run` looks at before it trusts a file.
"""

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from benchmarks.rows import Goal, Row, interleaved
from instruments.values import Drive, Frames
from labctl.runs.format.columns import shot_table
from labctl.runs.format.shape import RunShape
from labctl.runs.read.run import open_run
from labctl.runs.write.durability import Durability
from labctl.runs.write.writer import RunWriter

SHAPE = RunShape(20_000, ((2, 3, 4, 5, 6),), 1000, 40e-12)
ROWS = (1 << 20) // SHAPE.shot_bytes
"""Shots of a chunk."""
BURST = 1000
TURNS = 40


def make(directory: Path) -> Path:
    """A finished run of noise; returns its data.h5."""
    index = np.arange(SHAPE.shots)
    plan = shot_table(
        kind=np.full(SHAPE.shots, "image"),
        dataset_index=index,
        label=index % 10,
        wavelength_nm=np.full(SHAPE.shots, 1550.0),
        group=index,
    )
    drive = Drive("noise", np.zeros(2500, np.float32), 25e9, 0.5)
    generator = np.random.default_rng(1)
    with RunWriter.create(directory, {}, SHAPE, plan, drive, Durability()) as writer:
        writer.scales(0, 1e-3, 0.0)
        for first in range(0, SHAPE.shots, BURST):
            codes = generator.integers(-128, 128, (BURST, len(SHAPE.ports), SHAPE.samples), np.int8)
            clipped = np.zeros(codes.shape[:2], np.bool_)
            writer.append(0, first, Frames(codes, np.zeros(clipped.shape), np.arange(float(BURST)), clipped))
        return writer.paths.data


def plain_at_once(path: Path) -> None:
    """All frames in one array, by h5py alone."""
    with h5py.File(path) as file:
        file["frames"][:]


def at_once(path: Path) -> None:
    """All frames in one array."""
    with open_run(path) as run:
        run.frames[:]


def plain_blocks(path: Path) -> None:
    """All frames, a chunk at a time, by h5py alone."""
    with h5py.File(path) as file:
        frames = file["frames"]
        for start in range(0, len(frames), ROWS):
            frames[start : start + ROWS]


def blocks(path: Path) -> None:
    """All frames, a chunk at a time."""
    with open_run(path) as run:
        for start in range(0, len(run.frames), ROWS):
            run.frames[start : start + ROWS]


def rows() -> Iterator[Row]:
    """Both ways of reading beside plain h5py."""
    with tempfile.TemporaryDirectory() as folder:
        path = make(Path(folder) / "run")
        megabytes = path.stat().st_size / 1e6
        for how, read, plain in (("at once", at_once, plain_at_once), ("block by block", blocks, plain_blocks)):
            ours, reference = interleaved(partial(read, path), partial(plain, path), repetitions=TURNS)
            yield Row(
                f"data.h5 of {megabytes:.0f} MB read {how}, opening included",
                1e3 * ours.wall_s,
                "ms",
                1e3 * ours.processor_s,
                "h5py alone",
                1e3 * reference.wall_s,
                Goal(most=1.1),
            )
