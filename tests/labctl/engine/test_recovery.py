"""When a run goes on after a lost link, and when it does not."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from instruments.errors import InstrumentError, LinkError
from instruments.safe_state import UnsafeBench
from labctl.bench.opening import OpenBench
from labctl.engine.recovery import ATTEMPTS, Recovery
from labctl.runs.live.logs import CommandLog

LOST = LinkError("scope at nowhere cannot be reached")


@pytest.fixture
def run_log(tmp_path: Path) -> Iterator[CommandLog]:
    with CommandLog() as log:
        log.keep_in(tmp_path / "commands.log")
        yield log


@pytest.fixture
def recovery(open_bench: OpenBench, run_log: CommandLog, monkeypatch: pytest.MonkeyPatch) -> Recovery:
    monkeypatch.setattr("labctl.engine.recovery.PAUSE_S", 0.0)
    open_bench.bench.observer = run_log
    return Recovery(open_bench.bench)


def lines(run_log: CommandLog, tmp_path: Path) -> list[str]:
    run_log.keep_in(tmp_path / "commands.log")  # what was written so far is now in the file
    return [line for line in (tmp_path / "commands.log").read_text().splitlines() if " ! run " in line]


def test_so_often_in_a_row_and_no_more(recovery: Recovery, run_log: CommandLog, tmp_path: Path) -> None:
    for _ in range(ATTEMPTS):
        recovery.after(LOST, 7)
    with pytest.raises(LinkError, match="scope at nowhere"):
        recovery.after(LOST, 7)
    recovery.after(LOST, 8)
    assert len(lines(run_log, tmp_path)) == 2 * (ATTEMPTS + 1)


def test_what_is_no_lost_link_is_not_tried_again(
    recovery: Recovery, run_log: CommandLog, tmp_path: Path, log: Any
) -> None:
    for error in (InstrumentError("scope: refuses"), UnsafeBench("the safe state is not confirmed")):
        with pytest.raises(type(error)):
            recovery.after(error, 7)
    assert not log.messages
    assert not lines(run_log, tmp_path)


def test_a_bench_that_is_gone_ends_the_run_with_what_happened_and_how_it_is_left(
    recovery: Recovery, open_bench: OpenBench
) -> None:
    assert open_bench.simulation is not None
    open_bench.simulation.stop()
    lost = LinkError("scope at nowhere cannot be reached")
    lost.add_note("the safe state is not confirmed (scope): the laser is off")
    with pytest.raises(LinkError, match="scope at nowhere") as failure:
        recovery.after(lost, 7)
    (note,) = failure.value.__notes__
    assert "the laser may still emit, switch it off by its key switch" in note
