"""What a supervisor does when its parent is gone, told by a pipe that ends."""

import io
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from instruments.bench import Bench
from labctl.command_log import CommandLog
from labctl.opening import SIMULATED_LASER, opened
from labctl.station import SIMULATED_STATION, Station
from labctl.supervision import supervised
from labctl.supervisor import Task, supervise, within_reach
from sim_backends.bench import SimulatedBench


@pytest.fixture
def station() -> Iterator[Station]:
    """A bench at addresses, served from here."""
    with SimulatedBench() as bench:
        sections = {name: {"address": found["socket"]} for name, found in bench.resources.items()}
        yield Station.model_validate(sections | {"laser": sections["laser"] | {"commands": SIMULATED_LASER}})


def orders(station: Station, *later: object) -> io.BytesIO:
    task = Task(station=station, log_started=time.monotonic() - 1000)
    return io.BytesIO("".join(f"{line}\n" for line in (task.model_dump_json(), *map(json.dumps, later))).encode())


def test_a_parent_that_ended_leaves_a_safe_bench_and_a_line_in_the_log(
    station: Station, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "commands.log"
    path.write_text("999.5 > laser OUTPUT ON\n999.6 > scope CURV")
    with CommandLog() as log, opened(station, log) as found:
        found.bench.laser.emit()
        supervise(orders(station, str(tmp_path / "no run"), str(path)), lambda: None)
        assert found.bench.laser.settings()["emitting"] == 0
    lines = path.read_text().splitlines()
    assert lines[1] == "999.6 > scope CURV"
    assert lines[2].endswith("> laser OUTPUT OFF")
    assert 1000 < float(lines[2].split()[0]) < 1100
    done = "the supervisor did: laser off, AWG output off, DMD blank, oscilloscope stopped"
    assert f" ! run ended without making the bench safe, {done} (" in lines[-1]
    assert capfd.readouterr().err == f"labctl: the run ended without making the bench safe, {done}\n"


def test_a_laser_set_by_hand_is_left_to_a_person(station: Station, capfd: pytest.CaptureFixture[str]) -> None:
    by_hand = station.model_copy(update={"laser": station.laser.model_copy(update={"driver": "manual-laser"})})
    supervise(orders(by_hand), lambda: None)
    said = capfd.readouterr().err
    assert "did: AWG output off, DMD blank, oscilloscope stopped; the laser is set by hand: switch it off" in said


def test_what_cannot_be_reached_is_told(station: Station, capfd: pytest.CaptureFixture[str]) -> None:
    nobody = {"address": "TCPIP0::127.0.0.1::9::SOCKET"}
    supervise(orders(station.model_copy(update={"awg": station.awg.model_copy(update=nobody)})), lambda: None)
    said = capfd.readouterr().err
    assert "the supervisor could not: the safe state is not confirmed (awg: awg at TCPIP0" in said
    assert said.endswith("the laser is off\n")
    assert said.count("\n") == 1


@pytest.mark.parametrize("nothing", [b"", b'{"station": {'])
def test_a_parent_that_ended_before_it_said_anything_had_no_light(nothing: bytes) -> None:
    asked: list[str] = []
    supervise(io.BytesIO(nothing), lambda: asked.append("ready"))
    assert not asked


def test_a_bench_in_this_process_or_by_hand_is_out_of_reach(station: Station) -> None:
    assert within_reach(station) == ("laser", "awg", "dmd", "scope")
    assert within_reach(SIMULATED_STATION) == ()
    mixed = {"laser": {"driver": "manual-laser", "address": "by hand"}, "awg": {"address": "TCPIP0::192.0.2.1::INSTR"}}
    assert within_reach(Station.model_validate(mixed)) == ("awg",)


def test_a_replay_is_not_supervised(station: Station, bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LABCTL_REPLAY", "{}")
    unwatched = bench.before_light
    with CommandLog() as log, supervised(station, log) as watch:
        watch(bench)
        assert bench.before_light is unwatched


def test_it_starts_without_what_only_a_run_needs() -> None:
    heavy = ("scipy", "sklearn", "h5py", "matplotlib", "rich", "pint", "sim_backends", "labctl.runs")
    loaded = f"import sys, labctl.supervisor; print([name for name in {heavy} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", loaded], capture_output=True, check=True).stdout == b"[]\n"
