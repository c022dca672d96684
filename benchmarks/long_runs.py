"""What a long run costs that is kept in many small shards: files, and the time to open, check and end it.

    python benchmarks/long_runs.py [shots ...]

40,000 and 200,000 shots unless an argument says otherwise, on five ports in one pass with ten samples each, twenty
shots a shard. Nothing is synced while the run is made, since that is not what is measured. Times are of the processor
and by the wall.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np

from instruments.values import Frames
from labctl.runs.format.columns import shot_table
from labctl.runs.format.shape import RunShape
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.runs.write.durability import Durability
from labctl.runs.write.writer import RunWriter

SHARD_SHOTS = 20
PORTS = (2, 3, 4, 5, 6)
SAMPLES = 10
HEADINGS = ("step", "processor (s)", "wall (s)", "processor, ms a shard")


def make(directory: Path, shots: int) -> RunWriter:
    """A run of which everything is stored and data.h5 is not made."""
    shape = RunShape(shots, (PORTS,), SAMPLES, 40e-12)
    index = np.arange(shots)
    plan = shot_table(
        kind=np.full(shots, "image"),
        dataset_index=index,
        label=index % 10,
        wavelength_nm=np.full(shots, 1550.0),
        group=index,
    )
    writer = RunWriter.create(directory, {}, shape, plan, durability=Durability(shots=SHARD_SHOTS))
    writer.scales(0, 1e-3, 0.0)
    generator = np.random.default_rng(1)
    for first in range(0, shots, SHARD_SHOTS):
        count = min(SHARD_SHOTS, shots - first)
        codes = generator.integers(-128, 128, (count, len(PORTS), SAMPLES), np.int8)
        clipped = np.zeros((count, len(PORTS)), np.bool_)
        writer.append(0, first, Frames(codes, np.zeros(clipped.shape), np.arange(count, dtype=np.float64), clipped))
    return writer


def say(*columns: object) -> None:
    """Print one row."""
    sys.stdout.write("".join(f"{column!s:>24}" if place else f"{column!s:34}" for place, column in enumerate(columns)))
    sys.stdout.write("\n")
    sys.stdout.flush()


def timed(name: str, shards: int, action: Callable[[], object]) -> None:
    """Carry out `action` and print what it took."""
    wall, processor = time.perf_counter(), time.process_time()
    action()
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    say(name, f"{processor:.2f}", f"{wall:.2f}", f"{1e3 * processor / shards:.3f}")


def measure(directory: Path, shots: int) -> None:
    """Make a run and print what can be done with it."""
    shards = -(-shots // SHARD_SHOTS)
    say(f"{shots} shots, {shards} shards", *HEADINGS[1:])
    with mock.patch.object(os, "fsync", return_value=None):
        timed("make", shards, lambda: make(directory, shots).abandon())
    sizes = [path.stat().st_size for path in (directory / "shards").iterdir()]
    say("files, and their size in MB", len(sizes), f"{sum(sizes) / 1e6:.1f}")
    timed("open", shards, lambda: open_run(directory).done)
    timed("open and read 1000 frames", shards, lambda: open_run(directory).frames[:1000])
    resumed: list[RunWriter] = []
    timed("open to resume", shards, lambda: resumed.append(RunWriter.resume(directory)))
    timed("what is missing", shards, lambda: resumed[0].missing(0))
    timed("make data.h5", shards, resumed[0].finish)
    timed("open, with data.h5", shards, lambda: open_run(directory).done)
    timed("verify", shards, lambda: verify_run(directory))


def main() -> None:
    """Measure and print a table for each length."""
    for shots in [int(text) for text in sys.argv[1:]] or [40_000, 200_000]:
        with tempfile.TemporaryDirectory() as folder:
            measure(Path(folder) / "run", shots)


if __name__ == "__main__":
    main()
