"""What durability costs: shots per second with the default, beside runs that write late and sync nothing.

Runs go where temporary files go: it is that disk which is measured. The reference closes no shard by shots or
age, and its `os.fsync` does nothing. Both are acquired in turn, so that they meet whatever else the machine does alike.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks.rows import REPETITIONS, Goal, Row
from labctl.bench.station import SIMULATED_STATION, DurabilitySection
from labctl.engine.session import Acquisition, acquire
from protocols.image_readout import ImageReadout

PROTOCOLS = {
    "software-timed": ImageReadout(images=400),
    "burst": ImageReadout(images=4000, window=0.4e-9, timing="burst"),
}
LATE = SIMULATED_STATION.model_copy(update={"durability": DurabilitySection(shots=10**9, seconds=86400)})


def safe(protocol: ImageReadout, directory: Path) -> float:
    """Shots per second with the default durability."""
    return acquire(Acquisition(protocol, SIMULATED_STATION, directory)).outcome.shots_per_second


def careless(protocol: ImageReadout, directory: Path) -> float:
    """Shots per second with nothing synced, and no shard closed by its shots or its age."""
    with mock.patch.object(os, "fsync", return_value=None):
        return acquire(Acquisition(protocol, LATE, directory)).outcome.shots_per_second


def rows() -> Iterator[Row]:
    """A row for each timing; the first pair warms up and does not count."""
    with tempfile.TemporaryDirectory() as place:
        directory = Path(place) / "run"
        for name, protocol in PROTOCOLS.items():
            rates = np.empty((REPETITIONS + 1, 2))
            for pair in rates:
                for column, measured in enumerate((safe, careless)):
                    pair[column] = measured(protocol, directory)
                    shutil.rmtree(directory)
            durable, reference = np.median(rates[1:], axis=0)
            yield Row(
                f"durable acquisition, {name}",
                float(durable),
                "shots/s",
                against="nothing synced",
                reference=float(reference),
                goal=Goal(least=0.7),
            )
