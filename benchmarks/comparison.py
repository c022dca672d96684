"""What it costs to know that settings and records are what they should be: part of the time of a whole run.

A figure is a part of the seconds of its own run, and has no reference beside it; no goal is set. Software-timed, in
bursts and with averages, each several times; a part is the median.
"""

import statistics
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.rows import REPETITIONS, Row
from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition, acquire
from protocols.image_readout import ImageReadout

RUNS = {
    "software-timed": ImageReadout(images=1000),
    "bursts": ImageReadout(images=4000, timing="burst"),
    "mean of 16": ImageReadout(images=500, averages=16),
}


def part_of_time(protocol: ImageReadout) -> float:
    """Of one run, from first light to the last record."""
    with tempfile.TemporaryDirectory() as folder:
        acquired = acquire(Acquisition(protocol, SIMULATED_STATION, Path(folder) / "run", profile=True))
    outcome = acquired.outcome
    return acquired.budget["comparison"] * 1e-3 * outcome.shots / outcome.seconds


def rows() -> Iterator[Row]:
    """A row for each timing."""
    for name, protocol in RUNS.items():
        parts = [part_of_time(protocol) for _ in range(REPETITIONS)]
        yield Row(f"settings and records compared, {name}", 100 * statistics.median(parts), "% of the run")
