"""Two who want one bench: the second is refused at once in one line, and the first hears nothing of it."""

import json
import os
import re
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from instruments.values import Identity
from labctl.bench.lock import held, in_use
from labctl.bench.signals import Interruption
from labctl.bench.station import Station, read_station, write_addresses
from labctl.dashboard import launcher
from labctl.dashboard.launcher import Asked
from labctl.engine.session import Acquisition, acquire
from labctl.errors import BenchInUse
from labctl.runs.read.run import open_run
from labctl.runs.sweep import places, read
from protocols.registry import read_protocol
from sim_backends.bench import SimulatedBench
from tests.command_line import LABCTL, answer, as_json, labctl
from tests.observers import Follower
from tests.system.waiting import until_stored

RUN = ("run", "image-readout", "--set", "window=0.4 ns")
ENDLESS = ("--set", "images=4000")


@pytest.fixture
def station(served: tuple[dict[str, Any], Path]) -> Path:
    return served[1]


@contextmanager
def running(station: Path, directory: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A run that has its first shots, killed at the end if it is still there."""
    with subprocess.Popen([*LABCTL, *RUN, *ENDLESS, f"--station={station}", f"--out={directory}"]) as process:
        until_stored(process, directory)
        try:
            yield process
        finally:
            process.kill()


def under_another_name(station: Path) -> Path:
    other = station.with_name("other.toml")
    other.write_text(station.read_text().replace("127.0.0.1", "localhost"))
    return other


TASKS = {
    "check": "labctl check",
    "align": "labctl align",
    "run": "a run of image-readout",
    "Start": "a run of image-readout",
}
SETTINGS = {"window": "0.4 ns", "images": "4000"}


def started(station: Path, out: Path) -> launcher.Started:
    """As the page does."""
    asked = Asked("image-readout", SETTINGS, station=str(station))
    return launcher.start([*asked.words, f"--out={out}"], {})


@contextmanager
def holding(task: str, station: Path, out: Path) -> Iterator[subprocess.Popen[bytes]]:
    """What somebody does with the bench, from when it has it until the block ends: then it is ended, or may go on."""
    with socket.create_server(("127.0.0.1", 0)) as silent, ExitStack() as printed:
        command = [*LABCTL, task, f"--station={station}", *(() if task == "check" else (f"--out={out}",))]
        if task == "check":  # which would be done before anybody else came: its DMD does not answer for a while
            _, port = silent.getsockname()
            other = station.with_name(f"{out.name}.toml")
            patient = rf'\g<1>\ntimeout = "1 h"\g<2>{port}\g<3>'
            other.write_text(re.sub(r'(vialux-alp")(.*?)\d+(::SOCKET)', patient, station.read_text(), flags=re.S))
            command[-1] = f"--station={other}"
        elif task == "run":
            command[len(LABCTL) : len(LABCTL) + 1] = [*RUN, *ENDLESS]
        if task == "Start":
            begun = started(station, out)
            printed.enter_context(begun.printed)
            process = begun.process
        else:
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        try:
            until_held(process, station)
            yield process
            assert process.poll() is None
        finally:
            if task == "check":
                client, _ = silent.accept()
                silent.close()
                client.close()
            else:
                process.send_signal(signal.SIGINT)
            process.wait()


def until_held(process: subprocess.Popen[bytes], station: Path) -> None:
    bench = read_station(station)
    while f"process {process.pid} " not in in_use(bench):
        with suppress(subprocess.TimeoutExpired):
            process.wait(1e-3)  # a check is short
        assert process.poll() is None, "ended before it had the bench"


@pytest.mark.parametrize("first", TASKS)
def test_the_second_is_refused_and_the_first_untouched(
    station: Path, tmp_path: Path, first: str, capsys: pytest.CaptureFixture[str]
) -> None:
    other = under_another_name(station)
    refused = re.compile(
        rf"^labctl: awg is in use: {TASKS[first]}, process \d+ of \S+, since \d+ \w+ [\d:]+ UTC"
        r"(, \d+ of \d+ records(, about \d+ s more)?)?: wait for it(, or end it: labctl stop \S+)?\n?$"
    )
    with holding(first, station, tmp_path / "first") as process:
        for second in ("check", "align", "run", "reproduce", "Start"):
            out = tmp_path / second
            if second == "Start":
                tried = started(other, out)
                with tried.printed:
                    status, said = tried.process.wait(), tried.failure()
            else:
                words = {"run": RUN, "reproduce": ("reproduce", "fig3", "--quick")}.get(second, (second,))
                to = () if second == "check" else ("--out", out)
                status, _, said = labctl(capsys, *words, "--station", other, *to)
            assert (status, refused.match(said) is not None) == (1, True), (second, said)
            assert not (out / "manifest.json").exists()
        looked_at = labctl(capsys, "runs", tmp_path), labctl(capsys, *RUN, "--dry-run", "--station", station)
        assert [status for status, *_ in looked_at] == [0, 0], looked_at
    assert process.returncode == (1 if first == "check" else 130)
    if (events := tmp_path / "first" / "events.jsonl").exists():
        told = {json.loads(line)["event"] for line in events.read_text().splitlines()}
        assert told.isdisjoint({"link lost", "setting changed", "record doubted"})


def test_a_killed_run_lets_go_of_its_bench(station: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with running(station, tmp_path / "run") as first:
        first.kill()
    status, checked = as_json(capsys, "check", "--station", station)
    assert (status, checked["ok"]) == (0, True)
    assert "the supervisor" in (tmp_path / "run" / "commands.log").read_text()


@pytest.mark.parametrize("task", ["check", "align"])
def test_a_killed_check_or_alignment_lets_go_of_its_bench(
    station: Path, tmp_path: Path, task: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = () if task == "check" else (f"--out={tmp_path / 'out'}",)
    with subprocess.Popen([*LABCTL, task, f"--station={station}", *out], stdout=subprocess.DEVNULL) as process:
        until_held(process, station)
        process.kill()
    assert labctl(capsys, *RUN, "--set", "images=4", "--station", station, "--out", tmp_path / "next")[0] == 0


def test_a_killed_group_lets_go_of_its_bench(station: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    directory = tmp_path / "run"
    process = subprocess.Popen(
        [*LABCTL, *RUN, *ENDLESS, f"--station={station}", f"--out={directory}"], start_new_session=True
    )
    with process:
        until_stored(process, directory)
        os.killpg(process.pid, signal.SIGKILL)
    assert labctl(capsys, *RUN, "--set", "images=4", "--station", station, "--out", tmp_path / "next")[0] == 0


def test_one_serial_number_at_two_addresses(tmp_path: Path) -> None:
    one, other = (
        Station.model_validate({"scope": {"address": f"TCPIP::192.0.2.{host}::INSTR"}, "laser": {"armed": False}})
        for host in (1, 2)
    )
    scope = Identity("TEKTRONIX", "DPO72504DX", "B019876", "FV:10")
    with held(one, "labctl align") as first, held(other, "labctl check") as second:
        first.identified("scope", scope)
        with pytest.raises(BenchInUse, match=r"^scope is in use: labctl align, process \d+ of .* UTC: wait for it$"):
            second.identified("scope", scope)
        second.identified("scope", Identity("TEKTRONIX", "DPO72504DX", "B019877", "FV:10"))
    with held(other, "labctl check") as second:
        second.identified("scope", scope)


SWEEP = ("sweep", "image-readout", "--set", "images=8", "--set", "ports=2", "--over", "window=0.4 ns,0.8 ns,1.2 ns")


def refusal(bench: Station) -> str:
    """Why somebody else does not get it; empty where he does."""
    try:
        with held(bench, "a test"):
            return ""
    except BenchInUse as told:
        return str(told)


def test_nobody_gets_the_bench_between_two_points_of_a_sweep(station: Path, tmp_path: Path) -> None:
    bench, folder = read_station(station), tmp_path / "swept"
    with subprocess.Popen([*LABCTL, *SWEEP, f"--station={station}", f"--out={folder}"]) as process:
        until_stored(process, folder / "000-window=0.4ns")
        refused = set()
        while told := refusal(bench):
            refused.add(told.partition(", process")[0])
        assert (folder / "003-window=0.4ns" / "data.h5").exists()
        assert process.wait() == 0
    assert refused == {"awg is in use: a sweep of image-readout"}


def test_points_of_a_sweep_have_the_frames_of_runs_of_their_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with SimulatedBench(noise="by-state") as simulation:
        station, swept = tmp_path / "station.toml", tmp_path / "swept"
        write_addresses(station, {name: found["socket"] for name, found in simulation.resources.items()}, Station())
        assert labctl(capsys, *SWEEP, "--station", station, "--out", swept)[0] == 0
        alone = {}
        for window in ("0.4 ns", "0.8 ns", "1.2 ns"):
            words = (*RUN[:2], *SWEEP[2:6], "--set", f"window={window}", "--station", station)
            alone[window] = as_json(capsys, *words, "--out", tmp_path / window)[1]["frames_sha256"]
    found = {name: values["window"] for name, values in places(read(swept).sweep)}
    for name, window in found.items():
        with open_run(swept / name) as run:
            assert run.digest() == alone[window], name
    assert len(found) == 4


@contextmanager
def known_by_serial_number(folder: Path) -> Iterator[tuple[Path, Callable[[str], str]]]:
    """A station of instruments of which somebody holds the laser, at another address; and what asks that laser."""
    with SimulatedBench(host="127.0.0.2") as simulation:  # no other name of this machine's own
        one, other = (folder / f"{transport}.toml" for transport in ("socket", "hislip"))
        for file in (one, other):
            write_addresses(file, {name: found[file.stem] for name, found in simulation.resources.items()})
        _, host, port, _ = simulation.resources["laser"]["socket"].split("::")
        with (
            socket.create_connection((host, int(port)), timeout=20) as laser,
            laser.makefile("r") as lines,
            ExitStack() as stack,
        ):

            def ask(words: str) -> str:
                laser.sendall(f"{words}\n".encode())
                return lines.readline().strip()

            cut(other, folder / "run")
            first = stack.enter_context(held(read_station(one), "a run of image-readout"))
            first.identified("laser", Identity.parse(ask("*IDN?")))
            yield other, ask


def refused(told: tuple[int, dict[str, Any], str]) -> bool:
    status, found, _ = told
    return (status, found["error"].partition(", process")[0]) == (1, "laser is in use: a run of image-readout")


@pytest.mark.parametrize("words", [("resume", "run"), ("reproduce", "fig2", "--quick", "--out", "out")])
def test_the_light_of_who_has_the_bench_by_another_address_stays_on(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with known_by_serial_number(tmp_path) as (station, ask):
        assert ask("POWER 16.0\nOUTPUT ON\nOUTPUT?") == "1"
        assert refused(answer(*words, "--station", station, "--json"))
        assert ask("OUTPUT?") == "1"


def test_a_check_leaves_the_errors_of_who_has_the_bench_by_another_address(tmp_path: Path) -> None:
    with known_by_serial_number(tmp_path) as (station, ask):
        ask("NOBODY KNOWS THIS\nOUTPUT?")
        assert refused(answer("check", "--station", station, "--json"))
        assert ask("ERROR?").startswith("-113")


def cut(station: Path, directory: Path) -> Path:
    """A run that was stopped after its first record."""
    asked, interruption = read_protocol("image-readout", ["images=4", "ports=2", "window=0.4 ns"]), Interruption()

    def stop(_done: int, _total: int) -> None:
        interruption.requested = True

    acquire(Acquisition(asked, read_station(station), directory), interruption=interruption, observer=Follower(stop))
    return directory
