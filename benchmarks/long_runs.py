"""What a long run costs that is kept in many small shards: files, and the time to open, check and end it.

Five ports in one pass with ten samples each, twenty shots a shard. Nothing is synced while the run is made, since that
is not what is measured. The reference is a run of a fifth of the shots: where a shard of a longer run costs more, the
ratio is above 1. Each step is measured once, and no goal is set.
"""

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks.rows import Row, Timing, timed
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
LONG, SHORT = 100_000, 20_000


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


def steps(directory: Path) -> Iterator[tuple[str, Timing]]:
    """What can be done with a run in `directory` that is stored and has no data.h5, and what each takes."""
    yield "open", timed(lambda: open_run(directory).done)
    yield "open and read 1000 frames", timed(lambda: open_run(directory).frames[:1000])
    resumed: list[RunWriter] = []
    yield "open to resume", timed(lambda: resumed.append(RunWriter.resume(directory)))
    yield "what is missing", timed(lambda: resumed[0].missing(0))
    yield "make data.h5", timed(resumed[0].finish)
    yield "open, with data.h5", timed(lambda: open_run(directory).done)
    yield "verify", timed(lambda: verify_run(directory))


def measured(shots: int) -> dict[str, float]:
    """Milliseconds of the processor a shard, by step."""
    shards = -(-shots // SHARD_SHOTS)
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder) / "run"
        with mock.patch.object(os, "fsync", return_value=None):
            found = {"make": timed(lambda: make(directory, shots).abandon())}
        found |= dict(steps(directory))
    return {step: 1e3 * timing.processor_s / shards for step, timing in found.items()}


def rows() -> Iterator[Row]:
    """What a shard costs in a long run, beside what it costs in a short one."""
    long, short = measured(LONG), measured(SHORT)
    for step, figure in long.items():
        against = f"{SHORT} shots"
        yield Row(
            f"{step}, {LONG} shots in shards of {SHARD_SHOTS}", figure, "ms a shard", figure, against, short[step]
        )
