"""Work in several processes: in the order that it needs, and ended by the first failure or by somebody."""

import operator
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from labctl.bench.signals import Interruption
from labctl.studies.processes import processes
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
