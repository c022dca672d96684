"""Shots per second of a software-timed run on the simulated bench, beside what its bare messages would cost.

    python benchmarks/acquisition.py

The reference is the number of queries a shot makes, times the latency of an empty query over the same kind of link in
the same run: a bench without physics, parsing or storage could not be faster.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from instruments.visa import VisaLink
from labctl.bench.station import Station
from labctl.engine.session import Acquisition, acquire
from protocols.image_readout import ImageReadout
from sim_backends.bench import SimulatedBench

QUERIES = 2000


def empty_query_s() -> float:
    """Median latency of `*OPC?` on an idle virtual instrument in this process."""
    with SimulatedBench() as bench:
        link = VisaLink(bench.resources["awg"]["socket"], name="awg", timeout_s=5, transcript=lambda *_: None)
        durations = []
        for _ in range(QUERIES):
            started = time.perf_counter()
            link.query("*OPC?")
            durations.append(time.perf_counter() - started)
        link.close()
    return float(np.median(durations))


def main() -> None:
    """Measure and print one JSON object."""
    latency = empty_query_s()
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder) / "run"
        acquired = acquire(Acquisition(ImageReadout(), Station(), directory, profile=True))
        log = (directory / "commands.log").read_text(encoding="utf-8").splitlines()
    replies = sum(line.split(" ", 2)[1] == "<" for line in log)
    outcome = acquired.outcome
    bound = outcome.shots / (replies * latency)
    result = {
        "shots_per_second": round(outcome.shots_per_second, 1),
        "bound_by_bare_queries_per_second": round(bound, 1),
        "share_of_bound": round(outcome.shots_per_second / bound, 3),
        "empty_query_us": round(latency * 1e6, 1),
        "queries_per_shot": round(replies / outcome.shots, 1),
        "profile_ms_per_shot": acquired.budget,
    }
    sys.stdout.write(json.dumps(result) + "\n")


if __name__ == "__main__":
    main()
