"""What it costs to let others carry out tasks: per task here and on a cluster, and what a twin is made of.

    python -m benchmarks cluster

Tasks that do nothing, by the processes of this machine and by a dask scheduler with two workers on it; the reference is
dask alone, `Client.map` of as many. Then one twin: 1000 digits in bursts, measured, put into an S3 on this machine and
judged where it lies; bytes and requests are those that its server counted, seconds are processor time.
"""

import os
import pickle
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import fsspec
from distributed import Client

from benchmarks.rows import Row, Timing, timed
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

TASKS = 300
STORE = "s3://bucket/lab"
TWIN = ImageReadout(images=1000, ports=(2, 3, 4, 5, 6), window="0.4 ns", timing="burst")


def nothing() -> int:
    """A task."""
    return 0


def each(engine: Engine) -> Timing:
    """For each of many such tasks, from when the first ones are done on."""
    began: list[tuple[int, float, float]] = []

    def follow(done: int, _records: int) -> None:
        if done and not began:
            began.append((done, time.perf_counter(), time.process_time()))

    in_parallel(dict.fromkeys(range(TASKS), nothing), engine=engine, interruption=Interruption(), progress=follow)
    ((done, wall, processor),) = began
    left = TASKS - done
    return Timing((time.perf_counter() - wall) / left, (time.process_time() - processor) / left)


def tasks() -> Iterator[Row]:
    """Of both engines beside dask alone."""
    with tempfile.TemporaryDirectory() as place, ExitStack() as stack:
        there = Cluster(Path(place), stack)
        there.until_there(2)
        client = stack.enter_context(Client(there.address, set_as_default=False))  # type: ignore[no-untyped-call]
        spent = [client.run_on_scheduler(time.process_time)]
        by_cluster = each(cluster(there.address, partial(print, file=sys.stderr)))
        spent.append(client.run_on_scheduler(time.process_time))
        alone = timed(lambda: client.gather(client.map(lambda _: 0, range(TASKS), pure=False)))
        spent.append(client.run_on_scheduler(time.process_time))
    here = each(processes)
    reference = 1e3 * alone.wall_s / TASKS
    for what, found in (("processes of this machine", here), ("two workers of a cluster", by_cluster)):
        yield Row(
            f"a task that does nothing, by {what}",
            1e3 * found.wall_s,
            "ms",
            1e3 * found.processor_s,
            "dask alone, Client.map",
            reference,
        )
    one_by_one, at_once = (1e3 * (after - before) / TASKS for before, after in pairwise(spent))
    yield Row("the scheduler's time of the processor for it", one_by_one, "ms", None, "dask alone", at_once)


def judge(run: Path | str) -> None:
    """As a sweep is judged."""
    with open_run(run) as opened:
        records = read_records(opened)
    recognition(records.traces, records.labels, records.groups, sample_interval_s=records.sample_interval_s)


def twin() -> Iterator[Row]:
    """One of them."""
    with tempfile.TemporaryDirectory() as place, s3() as (address, traffic):
        os.environ |= account(address)
        fsspec.filesystem("s3").mkdir("bucket")
        run = Path(place) / "run"
        acquisition = Acquisition(TWIN, SIMULATED_STATION.twin(1), run)
        outcomes: list[Any] = []
        done: dict[str, Callable[[], object]] = {
            "a twin of 1000 digits measured": lambda: outcomes.append(acquire(acquisition).outcome),
            "put into a store": lambda: put_whole(run, location(f"{STORE}/run")),
            "judged where it lies": lambda: judge(f"{STORE}/run"),
        }
        for what, action in done.items():
            traffic.forget()
            found = timed(action)
            yield Row(what, found.wall_s, "s", found.processor_s)
            if traffic.requests:
                yield Row(what, len(traffic.requests), "requests")
        files = [path.stat().st_size for path in run.rglob("*") if path.is_file()]
        yield Row("its files", sum(files) / 1e6, "MB")
        yield Row("its files", len(files), "files")
        yield Row("bytes that came to judge it", traffic.bytes / 1e6, "MB", None, "of its files", sum(files) / 1e6)
        sent = partial(acquire_run, acquisition)
        yield Row("its task, as the scheduler gets it", len(pickle.dumps(sent)) / 1e3, "kB")
        yield Row("its result, as the scheduler gives it", len(pickle.dumps(outcomes[0])) / 1e3, "kB")


def rows() -> Iterator[Row]:
    """What a task costs, then what a twin does."""
    yield from tasks()
    yield from twin()
