"""Work in several processes: in the order that it needs, and ended by the first failure or by somebody."""

import gc
import operator
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from select import select
from typing import Any

import pytest

from labctl.bench.signals import Interruption
from labctl.errors import WorkerKilled
from labctl.studies.processes import processes, side_by_side
from labctl.studies.tasks import Interrupted, in_parallel

Tasks = dict[str, Callable[[], Any]]


def test_a_task_begins_when_those_it_needs_are_done(tmp_path: Path) -> None:
    seen: list[int] = []
    kept = tmp_path / "kept"
    tasks: Tasks = {
        "read": partial(kept.read_text, "utf-8"),
        "write": partial(kept.write_text, "light", "utf-8"),
        "count": partial(len, "dark"),
    }
    found = in_parallel(
        tasks,
        engine=processes,
        interruption=Interruption(),
        progress=lambda done, _steps: seen.append(done),
        needs={"read": ["write", "count"]},
    )
    assert {name: result for name, (result, _) in found.items()} == {"read": "light", "write": 5, "count": 4}
    assert all(seconds >= 0 for _, seconds in found.values())
    assert seen == sorted(seen)
    assert seen[-1] == 3


def test_what_tasks_leave_is_collected() -> None:
    """It is not in the process that those of a pool are copies of, which only loads."""
    assert side_by_side(dict.fromkeys(range(3), gc.isenabled)) == dict.fromkeys(range(3), True)


def test_the_first_failure_ends_it_all(tmp_path: Path) -> None:
    later = tmp_path / "later"
    tasks: Tasks = {"wrong": partial(operator.truediv, 1, 0), "later": partial(later.touch)}
    with pytest.raises(ZeroDivisionError):
        in_parallel(
            tasks,
            engine=processes,
            interruption=Interruption(),
            progress=lambda *_: None,
            needs={"later": ["wrong"]},
        )
    assert not later.exists()


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal here")
def test_a_process_that_is_killed_ends_it_in_one_line() -> None:
    tasks: Tasks = {"killed": partial(signal.raise_signal, signal.SIGKILL), "endless": partial(time.sleep, 1e6)}
    with pytest.raises(
        WorkerKilled, match=r"^a process that carried out a task was killed, perhaps .*: .*begin again$"
    ):
        in_parallel(tasks, engine=processes, interruption=Interruption(), progress=lambda *_: None)


def test_interrupted_nothing_more_begins(tmp_path: Path) -> None:
    later = tmp_path / "later"
    tasks: Tasks = {"first": partial(len, "light"), "later": partial(later.touch)}
    with pytest.raises(Interrupted):
        in_parallel(
            tasks,
            engine=processes,
            interruption=Interruption(requested=True),
            progress=lambda *_: None,
            needs={"later": ["first"]},
        )
    assert not later.exists()


def test_stopped_at_once_it_waits_for_no_task() -> None:
    told = 0

    def progress(done: int, _records: int) -> None:
        nonlocal told
        told += done
        if told > 1:
            raise KeyboardInterrupt

    tasks: Tasks = {"first": partial(len, "light"), "endless": partial(time.sleep, 1e6)}
    with pytest.raises(KeyboardInterrupt):
        in_parallel(
            tasks, engine=processes, interruption=Interruption(), progress=progress, needs={"endless": ["first"]}
        )


STOPPED_WHILE_IT_LOADS = """
import os, signal
from functools import partial
from labctl.studies.processes import load_meanwhile, side_by_side

signal.signal(signal.SIGINT, signal.default_int_handler)  # who began the tests may ignore it

def ctrl_c():
    try:
        os.killpg(0, signal.SIGINT)
        signal.pause()
    except KeyboardInterrupt:
        pass

load_meanwhile("loads_slowly")
ctrl_c()
with open(os.environ["GO_ON"], "w"):  # open where it is read from: by that module
    ctrl_c()
print(side_by_side({"one": partial(len, "light"), "other": partial(len, "dark")}))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="each process loads for itself")
def test_ctrl_c_while_modules_are_loaded_is_heard_by_the_command_alone(tmp_path: Path) -> None:
    os.mkfifo(go_on := tmp_path / "go_on")
    (tmp_path / "loads_slowly.py").write_text("import os\nopen(os.environ['GO_ON']).read()\n", encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, "-c", STOPPED_WHILE_IT_LOADS],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        start_new_session=True,
        env=os.environ | {"PYTHONPATH": str(tmp_path), "GO_ON": str(go_on)},
    )
    assert (ended.stdout, ended.stderr) == ("{'one': 5, 'other': 4}\n", "")


ONE_IDLES_ONE_WORKS = """
import multiprocessing, time
from functools import partial
from labctl.bench.signals import Interruption
from labctl.studies.processes import processes, side_by_side
from labctl.studies.tasks import in_parallel

def progress(done, _records):
    if done:
        print(*(worker.pid for worker in multiprocessing.active_children()), flush=True)

tasks = {"first": partial(len, "light"), "endless": partial(time.sleep, 1e6)}
in_parallel(tasks, engine=processes, interruption=Interruption(), progress=progress)
"""


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="nobody tells here that a process has ended")
def test_who_is_killed_leaves_no_process_behind() -> None:
    with subprocess.Popen([sys.executable, "-c", ONE_IDLES_ONE_WORKS], stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        workers = [os.pidfd_open(int(pid)) for pid in program.stdout.readline().split()]
        program.kill()
    assert len(workers) == min(os.cpu_count() or 1, 2)
    try:
        assert all(select([worker], [], [], 60)[0] for worker in workers)
    finally:
        for worker in workers:
            os.close(worker)
