"""What it costs to let others carry out tasks: per task here and on a cluster, and what a twin is made of.

    python -m benchmarks.cluster

Tasks that do nothing, by the processes of this machine and by a dask scheduler with two workers on it; the reference is
dask alone, `Client.map` of as many. Then one twin: 1000 digits in bursts, measured, put into an S3 on this machine and
judged where it lies; bytes and requests are those that its server counted, seconds are processor time.
"""

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import cloudpickle
import fsspec
import psutil
from distributed import Client

from labctl.analysis.recognition import recognition
from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition, acquire
from labctl.runs.format.store import location
from labctl.runs.read.records import read_records
from labctl.runs.read.run import open_run
from labctl.runs.write.placing import put_whole
from labctl.studies.cluster import cluster
from labctl.studies.processes import processes
from labctl.studies.run_tasks import acquire_run
from labctl.studies.tasks import Engine, in_parallel
from protocols.image_readout import ImageReadout
from tests.clusters import Cluster
from tests.stores import account, s3

TASKS = 1000
STORE = "s3://bucket/lab"
TWIN = ImageReadout(images=1000, ports=(2, 3, 4, 5, 6), window="0.4 ns", timing="burst")


def nothing() -> int:
    """A task."""
    return 0


def each(engine: Engine) -> tuple[float, float]:
    """Seconds by the clock, and processor time of this process, for each of many such tasks, once the first is done."""
    began: list[tuple[float, float]] = []

    def follow(done: int, _records: int) -> None:
        if done and not began:
            began.append((time.perf_counter(), time.process_time()))

    in_parallel(dict.fromkeys(range(TASKS), nothing), engine=engine, interruption=Interruption(), progress=follow)
    ((clock, processor),) = began
    return (time.perf_counter() - clock) / TASKS, (time.process_time() - processor) / TASKS


def tasks() -> dict[str, Any]:
    """Of both engines, and of dask alone, in ms."""
    with tempfile.TemporaryDirectory() as place, ExitStack() as stack:
        there = Cluster(Path(place), stack)
        there.until_there(2)
        scheduler = psutil.Process(there.scheduler.pid)
        before = scheduler.cpu_times()
        by_cluster, here = each(cluster(there.address, sys.stderr.write))
        after = scheduler.cpu_times()
        with Client(there.address, set_as_default=False) as client:  # type: ignore[no-untyped-call]
            began = time.perf_counter()
            client.gather(client.map(lambda _: 0, range(TASKS), pure=False))
            alone = (time.perf_counter() - began) / TASKS
    spent = after.user + after.system - before.user - before.system
    return {
        "by_processes_ms": round(1e3 * each(processes)[0], 2),
        "by_cluster_ms": round(1e3 * by_cluster, 2),
        "dask_alone_ms": round(1e3 * alone, 2),
        "processor_here_ms": round(1e3 * here, 2),
        "processor_of_the_scheduler_ms": round(1e3 * spent / TASKS, 2),
    }


def processor(what: Callable[[], object]) -> float:
    """Seconds of processor time of this process."""
    began = time.process_time()
    what()
    return round(time.process_time() - began, 2)


def judge(run: Path | str) -> None:
    """As a sweep is judged."""
    with open_run(run) as opened:
        records = read_records(opened)
    recognition(records.traces, records.labels, records.groups, sample_interval_s=records.sample_interval_s)


def twin() -> dict[str, Any]:
    """One of them."""
    with tempfile.TemporaryDirectory() as place, s3() as (address, traffic):
        os.environ |= account(address)
        fsspec.filesystem("s3").mkdir("bucket")
        run = Path(place) / "run"
        acquisition = Acquisition(TWIN, SIMULATED_STATION.twin(1), run)
        sent = len(cloudpickle.dumps(partial(acquire_run, acquisition)))
        outcomes: list[Any] = []
        measured = processor(lambda: outcomes.append(acquire(acquisition).outcome))
        traffic.forget()
        put = processor(lambda: put_whole(run, location(f"{STORE}/run")))
        requests_of_putting = len(traffic.requests)
        traffic.forget()
        judged = processor(lambda: judge(f"{STORE}/run"))
        return {
            "measured_s": measured,
            "put_s": put,
            "judged_s": judged,
            "task_bytes": sent,
            "result_bytes": len(cloudpickle.dumps(outcomes[0])),
            "bytes_put": sum(path.stat().st_size for path in run.rglob("*") if path.is_file()),
            "requests_of_putting": requests_of_putting,
            "bytes_of_judging": traffic.bytes,
            "requests_of_judging": len(traffic.requests),
        }


def main() -> None:
    """Measure and print one JSON object."""
    sys.stderr.write(json.dumps({"tasks": tasks(), "twin": twin()}) + "\n")


if __name__ == "__main__":
    main()
