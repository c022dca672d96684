"""What durability costs: shots per second with the default, beside runs that write late and sync nothing.

    python benchmarks/durability.py [folder]

Runs go into `folder`, or where temporary files go: it is that disk which is measured. The reference closes no shard
by shots or age, and its `os.fsync` does nothing. Both are acquired in turn, so that they meet whatever else the machine
does alike. Exit 1 if the default is slower than 0.7 of the reference.
"""

import json
import os
import shutil
import sys
import tempfile
from pathlib import Path
from unittest import mock

import numpy as np

from labctl.bench.station import SIMULATED_STATION, DurabilitySection
from labctl.engine.session import Acquisition, acquire
from protocols.image_readout import ImageReadout

REPETITIONS = 5
NEEDED = 0.7
PROTOCOLS = {
    "software-timed": ImageReadout(images=400),
    "burst": ImageReadout(images=4000, window=0.4e-9, timing="burst"),
}
LATE = SIMULATED_STATION.model_copy(update={"durability": DurabilitySection(shots=10**9, seconds=1e6)})


def safe(protocol: ImageReadout, directory: Path) -> float:
    """Shots per second with the default durability."""
    return acquire(Acquisition(protocol, SIMULATED_STATION, directory)).outcome.shots_per_second


def careless(protocol: ImageReadout, directory: Path) -> float:
    """Shots per second with nothing synced, and no shard closed by its shots or its age."""
    with mock.patch.object(os, "fsync", return_value=None):
        return acquire(Acquisition(protocol, LATE, directory)).outcome.shots_per_second


def compare(protocol: ImageReadout, folder: Path) -> dict[str, object]:
    """Both rates, one after the other as often as `REPETITIONS`; the first pair warms up and does not count."""
    rates = np.empty((REPETITIONS + 1, 2))
    for row in rates:
        for place, measured in enumerate((safe, careless)):
            row[place] = measured(protocol, folder / "run")
            shutil.rmtree(folder / "run")
    durable, reference = np.median(rates[1:], axis=0)
    ratios = rates[1:, 0] / rates[1:, 1]
    return {
        "shots_per_second": round(float(durable), 1),
        "shots_per_second_without": round(float(reference), 1),
        "ratio": round(float(durable / reference), 3),
        "ratio_of_each_pair": [round(float(ratio), 3) for ratio in ratios],
    }


def main() -> int:
    """Measure and print one JSON object."""
    with tempfile.TemporaryDirectory(dir=sys.argv[1] if len(sys.argv) > 1 else None) as folder:
        result = {name: compare(protocol, Path(folder)) for name, protocol in PROTOCOLS.items()}
    sys.stdout.write(json.dumps(result) + "\n")
    return 0 if all(float(str(found["ratio"])) >= NEEDED for found in result.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
