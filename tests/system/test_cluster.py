"""Twins measured and examined by the workers of a dask cluster: the digits of one machine, whoever dies meanwhile."""

import json
import os
import re
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from platform import node
from shutil import copytree, ignore_patterns
from threading import Thread

import h5py
import pytest
from distributed import Client

from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION
from labctl.errors import ClusterError, RunError, WrongPlace, notes
from labctl.runs.format.provenance import SOURCES
from labctl.studies.cluster import cluster
from labctl.studies.paper.experiments import Experiment
from labctl.studies.paper.report import as_json
from labctl.studies.paper.reproduction import Plan, reproduce
from labctl.studies.processes import processes
from labctl.studies.sweeps.evaluation import evaluate_sweep
from labctl.studies.tasks import CALLER, Engine, Interrupted, Workers, in_parallel
from tests.checkout import ROOT
from tests.clusters import Cluster
from tests.command_line import answer

SEEDS = 3

GONE = "the scheduler is gone or stands still"
BACK = "the scheduler is there again; what it lost begins anew"
NO_WORKERS = "the scheduler has no workers"


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with ExitStack() as stack:
        yield Cluster(tmp_path_factory.mktemp("workers"), stack)


@pytest.fixture
def dask(started: Cluster) -> Cluster:
    """Two workers, who may have worked for the test before."""
    started.have(2)
    return started


EXPERIMENT = Experiment.model_validate(
    {
        "name": "few",
        "title": "Few digits",
        "part_of": "a test",
        "paper": "nothing",
        "statement": "A few images on a few benches.",
        "analysis": "recognition",
        "runs": {"chip": {"protocol": "image-readout", "settings": {"images": 40, "window": "0.4 ns", "ports": "2-3"}}},
        "settings": {
            "windows": ["0.4 ns"],
            "classes": ["0", "1", "2", "3"],
            "curves": [{"key": "accuracy", "label": "chip", "run": "chip"}],
        },
        "twins": SEEDS,
        "splits": 2,
        "must": [{"what": "accuracy", "path": ["accuracy", "0.4"], "at_least": 0.0}],
    }
)


def carried_out(
    engine: Engine,
    folder: Path,
    measured: Callable[[int], None] = lambda _records: None,
    interruption: Interruption | None = None,
) -> tuple[str, list[bytes]]:
    """What the experiment came to, and the frames of its runs; told of all records but perhaps the last, each once."""
    plan = Plan((EXPERIMENT,), SIMULATED_STATION, folder, engine=engine)
    told: list[int] = []

    def follow(records: int) -> None:
        told.append(records)
        measured(records)

    (found,), failed = reproduce(plan, interruption=interruption or Interruption(), measured=follow)
    assert not failed
    frames = []
    shots = 0
    for directory in found.runs:
        with h5py.File(directory / "data.h5") as file:
            frames.append(file["frames"][:].tobytes())
            shots += len(file["shots"])
    assert shots / 2 < told[-1] <= max(told) <= shots
    names = {run.name for run in found.runs}
    assert {entry.name for entry in folder.iterdir()} >= names
    entry = as_json(found)
    return json.dumps({key: entry[key] for key in ("here", "must")}, sort_keys=True), frames


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, list[bytes]]:
    """The same by this machine alone."""
    return carried_out(processes, tmp_path_factory.mktemp("here"))


def test_workers_come_to_the_same_digits(dask: Cluster, tmp_path: Path, here: tuple[str, list[bytes]]) -> None:
    told: list[str] = []
    made: list[int] = []
    assert carried_out(cluster(dask.address, told.append), tmp_path / "there", made.append) == here
    assert told == []
    assert max(made) > 0


def test_a_worker_that_is_killed_costs_time(dask: Cluster, tmp_path: Path, here: tuple[str, list[bytes]]) -> None:
    def kill(records: int) -> None:
        if records:
            dask.workers[0].kill()

    assert carried_out(cluster(dask.address, print), tmp_path / "there", kill) == here
    assert dask.workers[0].wait() != 0


def test_a_scheduler_that_is_killed_costs_time(dask: Cluster, tmp_path: Path, here: tuple[str, list[bytes]]) -> None:
    told: list[str] = []
    lost = False

    def lose(records: int) -> None:
        nonlocal lost
        if records and not lost:
            lost = True
            dask.lose_all(workers=0)

    def hire(line: str) -> None:
        told.append(line.partition(": ")[2].partition(":")[0])
        if told[-1] == NO_WORKERS:
            dask.workers = [dask.worker()]

    assert carried_out(cluster(dask.address, hire), tmp_path / "there", lose) == here
    assert lost
    assert told == [GONE, BACK, NO_WORKERS]


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_scheduler_that_stands_still_is_told_and_can_be_left(
    dask: Cluster, tmp_path: Path, here: tuple[str, list[bytes]], monkeypatch: pytest.MonkeyPatch, interrupted: bool
) -> None:
    told: list[str] = []
    interruption = Interruption()

    def hold(records: int) -> None:
        if records and not told:
            dask.scheduler.send_signal(signal.SIGSTOP)
            monkeypatch.setattr("labctl.studies.cluster.CONNECT_S", 0.5)

    def hear(line: str) -> None:
        told.append(line.partition(": ")[2].partition(":")[0])
        interruption.requested = interrupted
        if not interrupted:
            monkeypatch.setattr("labctl.studies.cluster.CONNECT_S", 10.0)
            dask.scheduler.send_signal(signal.SIGCONT)

    engine = cluster(dask.address, hear)
    try:
        if interrupted:
            with pytest.raises(Interrupted):
                carried_out(engine, tmp_path / "there", hold, interruption)
        else:
            assert carried_out(engine, tmp_path / "there", hold) == here
    finally:
        dask.scheduler.send_signal(signal.SIGCONT)
    assert told == ([GONE] if interrupted else [GONE, BACK])


def test_a_scheduler_without_workers_is_told_and_waited_for(
    dask: Cluster, tmp_path: Path, here: tuple[str, list[bytes]]
) -> None:
    dask.have(0)
    told: list[str] = []

    def hire(line: str) -> None:
        told.append(line)
        dask.workers = [dask.worker()]

    assert carried_out(cluster(dask.address, hire), tmp_path / "there") == here
    assert told == [f"{dask.address}: {NO_WORKERS}: start some; Ctrl-C keeps what is finished"]


class TakesTheSchedulerWithIt:
    """A result: while it is sent for the first time, the scheduler is killed."""

    def __init__(self, scheduler: int, mark: Path) -> None:
        self.scheduler = scheduler
        self.mark = mark

    def __reduce__(self) -> tuple[type[str], tuple[str]]:
        if not self.mark.exists():
            self.mark.touch()
            os.kill(self.scheduler, signal.SIGKILL)
        return str, ("arrived",)


def test_a_result_that_is_on_its_way_when_the_scheduler_is_killed_is_made_again(dask: Cluster, tmp_path: Path) -> None:
    mark = tmp_path / "killed"
    again = False

    def begin_again(_done: int, _records: int) -> None:
        nonlocal again
        if mark.exists() and not again:
            again = True
            dask.lose_all()

    task: Callable[[], object] = partial(TakesTheSchedulerWithIt, dask.scheduler.pid, mark)
    found = in_parallel(
        {"only": task},
        engine=cluster(dask.address, print),
        interruption=Interruption(),
        progress=begin_again,
    )
    assert again
    assert found["only"][0] == "arrived"


def fails() -> None:
    raise RunError("the disk is full")


def fails_when_it_should_end() -> None:
    while not CALLER.get().stopped():
        pass
    error = RunError("the disk is full too")
    error.add_note("the run is kept")
    raise error


def test_a_task_that_fails_after_another_is_heard(dask: Cluster) -> None:
    tasks = {task.__name__: task for task in (fails, fails_when_it_should_end)}
    with pytest.raises(RunError) as raised:
        in_parallel(tasks, engine=cluster(dask.address, print), interruption=Interruption(), progress=lambda *_: None)
    assert str(raised.value) == "the disk is full"
    where, kept, there = notes(raised.value)
    assert kept == "the run is kept"
    for note in (where, there):
        assert re.fullmatch(rf"on {node()}, worker tcp://127.0.0.1:\d+", note)


def test_the_twins_of_a_sweep_are_tasks_of_four_workers(dask: Cluster, tmp_path: Path) -> None:
    dask.have(4)
    settings = ("--set", "images=60", "--set", "ports=2-3", "--set", "window=0.4 ns")
    words = ("sweep", "image-readout", *settings, "--over", "sim.twin_seed=1:4:4", "--order", "as-given")
    there = ("--scheduler", dask.address, "--store", str(tmp_path / "store"))
    status, found, _ = answer(*words, *there, "--out", tmp_path / "swept", "--json")
    assert (status, found["runs"], found["complete"], found["measured"]) == (0, 5, 5, 5)
    assert answer(*words, "--scheduler", "local", "--out", tmp_path / "here", "--json")[0] == 0
    runs = sorted(path.name for path in (tmp_path / "store").iterdir())
    assert len(runs) == 5
    for run in runs:
        with (
            h5py.File(tmp_path / "store" / run / "data.h5") as one,
            h5py.File(tmp_path / "here" / run / "data.h5") as other,
        ):
            assert one["frames"][:].tobytes() == other["frames"][:].tobytes()
    _, judged, _ = answer("evaluate", tmp_path / "swept", "--scheduler", dask.address, "--json")
    assert judged["points"] == evaluate_sweep(tmp_path / "here")["points"]


def test_workers_that_share_no_folder_are_told(tmp_path: Path) -> None:
    @contextmanager
    def elsewhere(tasks: int) -> Iterator[Workers]:
        with processes(tasks) as workers:
            yield workers
        (tmp_path / "there").rename(tmp_path / "another machine")

    plan = Plan((EXPERIMENT,), SIMULATED_STATION, tmp_path / "there", engine=elsewhere)
    with pytest.raises(WrongPlace, match=r": was measured, and is not there on .*: the workers share no such folder"):
        reproduce(plan, interruption=Interruption())


def test_interrupted_runs_end_and_none_is_in_place(dask: Cluster, tmp_path: Path) -> None:
    interruption = Interruption()
    plan = Plan((EXPERIMENT,), SIMULATED_STATION, tmp_path / "there", engine=cluster(dask.address, print))

    def interrupt(records: int) -> None:
        interruption.requested |= records > 0

    with pytest.raises(Interrupted):
        reproduce(plan, interruption=interruption, measured=interrupt)
    with Client(dask.address, set_as_default=False) as client, suppress(OSError):  # type: ignore[no-untyped-call]
        assert client.run(len, ()) is not None, "the workers are there for the next"


def test_an_interruption_does_not_wait_for_a_worker_that_stands_still(
    dask: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interruption, held = Interruption(), dask.workers[0]
    plan = Plan((EXPERIMENT,), SIMULATED_STATION, tmp_path / "there", engine=cluster(dask.address, print))

    def interrupt(records: int) -> None:
        if records:
            held.send_signal(signal.SIGSTOP)
            monkeypatch.setattr("labctl.studies.cluster.CONNECT_S", 0.5)
            interruption.requested = True

    try:
        with pytest.raises(Interrupted):
            reproduce(plan, interruption=interruption, measured=interrupt)
    finally:
        held.send_signal(signal.SIGCONT)


def test_nobody_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("labctl.studies.cluster.CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    plan = Plan((EXPERIMENT,), SIMULATED_STATION, tmp_path / "there", engine=cluster(address, print))
    with pytest.raises(ClusterError, match=rf"^{address}: no scheduler answers: start 'dask scheduler', or correct"):
        reproduce(plan, interruption=Interruption())


@pytest.mark.parametrize("said", [b"", b"HTTP/1.0 400 Bad Request\r\n\r\n"])
def test_who_answers_is_no_scheduler(said: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("labctl.studies.cluster.CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as other, ExitStack() as stack:

        def talk() -> None:
            with suppress(OSError):  # it is closed
                while True:
                    asked = stack.enter_context(other.accept()[0])
                    asked.sendall(said)

        Thread(target=talk, daemon=True).start()
        address = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(ClusterError, match=rf"^{address}: no scheduler answers.*: start 'dask scheduler', or cor"):
            stack.enter_context(cluster(address, print)(1))


@pytest.mark.parametrize("address", ["", "Local", "127.0.0.1", "tcp://127.0.0.1", "foo://127.0.0.1:1", "tcp://h:port"])
@pytest.mark.parametrize(
    "words", [("sweep", "image-readout", "--over", "window=0.4 ns,1 ns"), ("reproduce", "fig3"), ("demo",)]
)
def test_what_is_no_address_is_refused_before_a_folder_is_made(
    words: tuple[str, ...], address: str, tmp_path: Path
) -> None:
    status, found, _ = answer(*words, "--scheduler", address, "--out", tmp_path / "out", "--json")
    assert (status, found["error"]) == (
        2,
        f"--scheduler = {address!r}: is no address: write one such as tcp://192.0.2.7:8786, or local for the cores of "
        f"this machine",
    )
    assert not (tmp_path / "out").exists()


def test_a_worker_of_several_threads_is_refused(tmp_path: Path) -> None:
    with ExitStack() as stack:
        found = Cluster(tmp_path / "workers", stack, workers=0)
        found.worker(threads=2)
        found.until_there(1)
        plan = Plan((EXPERIMENT,), SIMULATED_STATION, tmp_path / "there", engine=cluster(found.address, print))
        with pytest.raises(ClusterError, match=r"has 2 threads: start it with --nthreads 1$"):
            reproduce(plan, interruption=Interruption())


@pytest.mark.usefixtures("started_anew")
def test_a_worker_of_a_changed_labctl_is_refused(tmp_path: Path) -> None:
    for package in SOURCES:
        copytree(ROOT / package, tmp_path / "checkout" / package, ignore=ignore_patterns("__pycache__"))
    with (tmp_path / "checkout" / "sim_backends" / "world" / "noise.py").open("a", encoding="utf-8") as changed:
        changed.write("# louder\n")
    with ExitStack() as stack:
        found = Cluster(tmp_path / "workers", stack, workers=0)
        found.worker(checkout=tmp_path / "checkout")
        found.until_there(1)
        plan = Plan((EXPERIMENT,), SIMULATED_STATION, tmp_path / "there", engine=cluster(found.address, print))
        with pytest.raises(
            ClusterError, match=r": has sources of labctl [0-9a-f]{64}, not [0-9a-f]{64}: install there"
        ):
            reproduce(plan, interruption=Interruption())
