"""What it costs to know that settings and records are what they should be: part of the time of a whole run.

    python benchmarks/comparison.py

The reference is the same run: the seconds of all its other steps. Software-timed, in bursts and with averages, each
several times; a part is the median.
"""

import json
import statistics
import sys
import tempfile
from pathlib import Path

from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition, acquire
from protocols.image_readout import ImageReadout

TIMES = 3
RUNS = {
    "software": ImageReadout(images=1000),
    "burst": ImageReadout(images=4000, timing="burst"),
    "averages": ImageReadout(images=500, averages=16),
}


def part_of_time(protocol: ImageReadout) -> float:
    """Of one run, from first light to the last record."""
    with tempfile.TemporaryDirectory() as folder:
        acquired = acquire(Acquisition(protocol, SIMULATED_STATION, Path(folder) / "run", profile=True))
    outcome = acquired.outcome
    return acquired.budget["comparison"] * 1e-3 * outcome.shots / outcome.seconds


def main() -> None:
    """Measure and print one JSON object."""
    parts = {name: [part_of_time(protocol) for _ in range(TIMES)] for name, protocol in RUNS.items()}
    result = {
        name: {"part": round(statistics.median(found), 4), "largest": round(max(found), 4)}
        for name, found in parts.items()
    }
    sys.stdout.write(json.dumps(result) + "\n")


if __name__ == "__main__":
    main()
