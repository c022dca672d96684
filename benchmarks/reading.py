"""What `open_run` costs beside plain h5py: a data.h5 of 100 MB read whole, at once and block by block.

    python benchmarks/reading.py [folder]

The file is made in `folder`, or where temporary files go, and is in the page cache when it is read. Opening it counts,
and so does what `open_run` looks at before it trusts a file. Both are read in turns; a ratio is that of the medians.
Exit 1 if one of them is above 1.1.
"""

import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

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
TURNS = 41
ALLOWED = 1.1


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


def taken(read: Callable[[Path], None], path: Path) -> float:
    """Seconds by the clock."""
    began = time.perf_counter()
    read(path)
    return time.perf_counter() - began


def compare(path: Path, read: Callable[[Path], None], plain: Callable[[Path], None]) -> dict[str, float]:
    """Both ways in turns; the first turn warms up and does not count."""
    times = [(taken(read, path), taken(plain, path)) for _ in range(TURNS)][1:]
    ours, reference = (statistics.median(column) for column in zip(*times, strict=True))
    return {
        "open_run_ms": round(1e3 * ours, 2),
        "h5py_ms": round(1e3 * reference, 2),
        "ratio": round(ours / reference, 3),
    }


def main() -> int:
    """Measure and print one JSON object."""
    with tempfile.TemporaryDirectory(dir=sys.argv[1] if len(sys.argv) > 1 else None) as folder:
        path = make(Path(folder) / "run")
        megabytes = round(path.stat().st_size / 1e6, 1)
        found = {
            "at_once": compare(path, at_once, plain_at_once),
            "block_by_block": compare(path, blocks, plain_blocks),
        }
    sys.stdout.write(json.dumps({"megabytes": megabytes} | found, indent=2) + "\n")
    return 0 if all(one["ratio"] <= ALLOWED for one in found.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
