"""A run that is killed while the laser emits: another process makes the bench dark, and tells so."""

import json
import os
import re
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self

import pytest

from instruments.safe_state import UnsafeBench
from labctl.bench.opening import opened
from labctl.bench.simulation import SIMULATED_LASER
from labctl.bench.station import read_station, write_addresses
from labctl.bench.supervision import supervised
from labctl.commands.main import main
from labctl.runs.live.alarm import may_emit
from labctl.runs.live.logs import CommandLog
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from tests.system.waiting import until, until_stored

pytestmark = pytest.mark.usefixtures("started_anew")

Served = tuple[dict[str, Any], Path]

DARK_WITHIN_S = 1.0
LONG = ("--set", "images=2000", "--set", "window=0.8 ns")


class Asked:
    """An instrument's own word, over a connection of our own."""

    def __init__(self, served: Served, name: str) -> None:
        _, host, port, _ = served[0][name]["socket"].split("::")
        self._link = socket.create_connection((host, int(port)), timeout=10)
        self._lines = self._link.makefile("rb")

    def ask(self, question: str) -> str:
        self._link.sendall(f"{question}\n".encode())
        return self._lines.readline().decode().strip()

    def seconds_until(self, question: str, answer: str, within_s: float) -> float:
        """How long it takes until that is the answer."""
        began, pause = time.monotonic(), threading.Event()
        while self.ask(question) != answer:
            pause.wait(1e-3)  # the processor is for the run
            assert time.monotonic() - began < within_s, f"{question} is not answered {answer} after {within_s:g} s"
        return time.monotonic() - began

    def close(self) -> None:
        self._lines.close()
        self._link.close()


@pytest.fixture
def laser(served: Served) -> Iterator[Asked]:
    asked = Asked(served, "laser")
    yield asked
    asked.close()


@contextmanager
def running(command: tuple[str, ...], station: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [*command, "run", "image-readout", *LONG, *arguments, "--station", str(station)],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
        text=True,
    ) as process:
        yield process
        process.kill()


def told_in(directory: Path) -> list[str]:
    """What the supervisor wrote into the log of a run."""
    lines = (directory / "commands.log").read_text().splitlines()
    return [line for line in lines if " ! run ended without" in line]


@pytest.mark.parametrize(
    ("timing", "before"), [("software", []), ("burst", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])]
)
def test_a_killed_run_is_dark_within_a_second(
    timing: str,
    before: list[signal.Signals],
    served: Served,
    laser: Asked,
    labctl_command: tuple[str, ...],
    tmp_path: Path,
) -> None:
    """Whatever signals the process group got before."""
    run = tmp_path / "run"
    with running(labctl_command, served[1], "--set", f"timing={timing}", "--out", str(run)) as process:
        laser.seconds_until("OUTPUT?", "1", 60)
        until_stored(process, run)
        laser.seconds_until("OUTPUT?", "1", 60)  # it is dark between bursts
        process.send_signal(signal.SIGSTOP)  # so that the run itself hears nothing of what follows
        for number in before:
            os.killpg(process.pid, number)
        process.kill()
        dark = laser.seconds_until("OUTPUT?", "0", DARK_WITHIN_S)
        print(f"{timing}: dark {dark:.3f} s after the kill")  # noqa: T201
        _, said = process.communicate(timeout=30)  # the supervisor holds standard error until it has done all
    assert "the supervisor did: laser off, AWG output off, DMD blank, oscilloscope stopped" in said
    assert len(told_in(run)) == 1
    for name, question in (("awg", "OUTPut1:STATe?"), ("scope", "ACQuire:STATE?")):
        instrument = Asked(served, name)
        assert instrument.ask(question) == "0"
        instrument.close()
    report = verify_run(run)
    assert report.intact
    assert report.shards > 0


def child_of(process: int) -> int:
    """The one process that another one has started."""
    started = Path("/proc", str(process), "task", str(process), "children").read_text().split()
    (child,) = map(int, started)
    return child


def test_a_run_whose_supervisor_is_killed_ends_dark_and_goes_on_under_a_new_one(
    served: Served, laser: Asked, labctl_command: tuple[str, ...], tmp_path: Path
) -> None:
    run = tmp_path / "run"
    with running(labctl_command, served[1], "--out", str(run)) as process:
        laser.seconds_until("OUTPUT?", "1", 60)
        until_stored(process, run)
        os.kill(child_of(process.pid), signal.SIGKILL)
        laser.seconds_until("OUTPUT?", "0", DARK_WITHIN_S)
        _, said = process.communicate(timeout=30)
    assert process.returncode == 1
    first, second = said.strip().splitlines()[-2:]
    assert first.startswith("labctl: the supervisor or its copy has ended: the bench was made dark")
    assert second.startswith("labctl: the run can go on: labctl resume ")
    with open_run(run) as stored:
        kept = max(stored.done)
    assert 0 < kept < 2000
    shards = (run / "journal.jsonl").read_bytes().count(b"\n")

    command = [*labctl_command, "resume", str(run), "--station", str(served[1])]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        laser.seconds_until("OUTPUT?", "1", 60)
        assert child_of(process.pid)
        until_stored(process, run, shards + 1)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=30)
    assert laser.ask("OUTPUT?") == "0"
    with open_run(run) as stored:
        assert max(stored.done) > kept


def test_a_hung_instrument_delays_no_laser_and_spares_no_other(
    served: Served, laser: Asked, labctl_command: tuple[str, ...], tmp_path: Path
) -> None:
    station = tmp_path / "station.toml"
    with Hanging(served[0]["awg"]["socket"]) as awg:
        addressed(served, station, "awg", awg)
        with running(labctl_command, station, "--out", str(tmp_path / "run")) as process:
            laser.seconds_until("OUTPUT?", "1", 60)
            awg.hangs.set()
            process.kill()
            laser.seconds_until("OUTPUT?", "0", DARK_WITHIN_S)
            _, said = process.communicate(timeout=30)
    assert "the supervisor could not: the safe state is not confirmed (awg: awg at " in said
    assert "did not answer in time" in said
    assert said.count("labctl: ") == 1
    log = (tmp_path / "run" / "commands.log").read_text()
    order = dict.fromkeys(line.split()[2] for line in log[log.rindex("> laser OUTPUT OFF\n") :].splitlines()[1:])
    assert list(order) == ["laser", "awg", "dmd", "scope", "run"]


def test_a_run_that_ends_by_itself_leaves_no_supervisor(
    served: Served, laser: Asked, capfd: pytest.CaptureFixture[str]
) -> None:
    station = read_station(served[1])
    with (
        CommandLog() as log,
        supervised(station, log) as supervisor,
        opened(station, log, observer=supervisor) as found,
    ):
        process = supervisor._process  # type: ignore[attr-defined]
        with found.bench.emitting(1550.0):
            assert laser.ask("OUTPUT?") == "1"
        assert laser.ask("OUTPUT?") == "0"
        assert process.poll() is None
    assert process.returncode is not None
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", ["scope", pytest.param("dmd", marks=pytest.mark.full)])
def test_an_instrument_that_hangs_in_a_run_ends_it_dark(
    name: str,
    served: Served,
    laser: Asked,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("labctl.engine.recovery.PAUSE_S", 0.01)
    station = tmp_path / "station.toml"
    with Hanging(served[0][name]["socket"]) as hanging:
        addressed(served, station, name, hanging)
        hanging.after = {"scope": 40_000, "dmd": 200}[name]
        arguments = ("run", "image-readout", *LONG, "--station", str(station), "--out", str(tmp_path / "run"))
        with pytest.raises(SystemExit) as ended:
            main([*arguments, "--json"])
    assert ended.value.code == 1
    result = json.loads(capsys.readouterr().out)
    assert re.search(rf"^{name} at TCPIP.* did not answer in time", result["error"])
    assert re.search(rf"not confirmed \({name}: .*\): the laser is off$", result["notes"][0])
    assert laser.ask("OUTPUT?") == "0"
    log = (tmp_path / "run" / "commands.log").read_text()
    assert log.count(" ! run lost link") == 3
    assert not told_in(tmp_path / "run"), "what the run saw to itself is not done again"


def test_a_laser_that_no_longer_answers_is_told_to_be_dark_all_the_same(
    served: Served, laser: Asked, tmp_path: Path
) -> None:
    station = tmp_path / "station.toml"
    table = tmp_path / "laser.toml"
    table.write_text(SIMULATED_LASER.read_text().replace("timeout_s = 2.0", "timeout_s = 1.0"))
    with Hanging(served[0]["laser"]["socket"], hears=True) as hanging, CommandLog() as log:
        addressed(served, station, "laser", hanging)
        station.write_text(station.read_text().replace('commands = "simulated"', f'commands = "{table}"'))
        with opened(read_station(station), log) as found:
            found.bench.laser.emit()
            hanging.hangs.set()
            with pytest.raises(UnsafeBench, match=r"\(laser: [^;]*did not answer in time[^;]*\): .*key switch"):
                found.bench.make_safe()
    assert laser.ask("OUTPUT?") == "0"


def test_no_light_without_a_supervisor(served: Served, laser: Asked, tmp_path: Path) -> None:
    station = read_station(served[1])
    with (
        CommandLog() as log,
        supervised(station, log) as supervisor,
        opened(station, log, observer=supervisor) as found,
    ):
        process = supervisor._process  # type: ignore[attr-defined]
        process.kill()
        process.wait()
        with pytest.raises(UnsafeBench, match="the supervisor has not started, or it or its copy has ended: no light"):
            found.bench.emitting(1550.0).__enter__()
        assert laser.ask("OUTPUT?") == "0"


def test_a_supervisor_that_is_gone_or_alone_is_noticed_while_something_is_uploaded(
    served: Served, laser: Asked
) -> None:
    """Without the copy that stands in for it."""
    station = read_station(served[1])
    with (
        CommandLog() as log,
        supervised(station, log) as supervisor,
        opened(station, log, observer=supervisor) as found,
    ):
        process = supervisor._process  # type: ignore[attr-defined]

        def upload_alone() -> None:
            with found.bench.emitting(1550.0):
                supervisor.uploading("waveform", 1, 2)
                os.kill(child_of(process.pid), signal.SIGKILL)
                until(lambda: supervisor.uploading("waveform", 2, 2))

        with pytest.raises(UnsafeBench, match="the supervisor or its copy has ended: the bench was made dark"):
            upload_alone()
        assert laser.ask("OUTPUT?") == "0"
        with pytest.raises(UnsafeBench, match="or its copy has ended: no light"):
            found.bench.emitting(1550.0).__enter__()
        assert process.poll() is None, "it acts if this process is killed now"


def test_a_safe_state_that_was_cut_short_is_left_to_the_supervisor(
    served: Served, laser: Asked, capfd: pytest.CaptureFixture[str]
) -> None:
    station = read_station(served[1])
    with CommandLog() as log, supervised(station, log) as supervisor, opened(station, log) as found:
        supervisor.before_light()
        supervisor.emission(on=True)
        found.bench.laser.emit()
        assert laser.ask("OUTPUT?") == "1"
    assert laser.ask("OUTPUT?") == "0"
    assert "the supervisor did: laser off" in capfd.readouterr().err


def test_a_laser_whose_cable_is_out_goes_dark_when_it_is_in_again(served: Served, laser: Asked, tmp_path: Path) -> None:
    address = served[0]["laser"]["socket"]
    with Hanging(address) as cable:
        addressed(served, tmp_path / "station.toml", "laser", cable)
        station = read_station(tmp_path / "station.toml")
        with (
            CommandLog() as log,
            supervised(station, log) as supervisor,
            opened(station, log, observer=supervisor) as found,
        ):
            supervisor.before_light()
            supervisor.emission(on=True)
            found.bench.laser.emit()
            cable.hangs.set()
            cable.__exit__()
            with pytest.raises(UnsafeBench, match="may still emit"):
                found.bench.make_safe()
    assert laser.ask("OUTPUT?") == "1", "nobody can reach it, and nobody waits for that"
    with Hanging(address, port=cable.port):
        supervisor._process.wait()  # type: ignore[attr-defined]
    assert laser.ask("OUTPUT?") == "0"


@pytest.mark.parametrize("is_killed", [False, True])
def test_what_a_run_prints_ends_with_it_while_the_supervisor_goes_on_trying(
    is_killed: bool, served: Served, laser: Asked, labctl_command: tuple[str, ...], tmp_path: Path
) -> None:
    address, station, run = served[0]["laser"]["socket"], tmp_path / "station.toml", tmp_path / "run"
    table = tmp_path / "laser.toml"
    table.write_text(SIMULATED_LASER.read_text().replace("timeout_s = 2.0", "timeout_s = 1.0"))
    with Hanging(address) as cable:
        addressed(served, station, "laser", cable)
        station.write_text(station.read_text().replace('commands = "simulated"', f'commands = "{table}"'))
        with running(labctl_command, station, "--out", str(run)) as process:
            laser.seconds_until("OUTPUT?", "1", 60)
            until_stored(process, run)
            cable.hangs.set()
            process.send_signal(signal.SIGKILL if is_killed else signal.SIGTERM)
            _, said = process.communicate(timeout=60)
    assert "the laser may still emit, switch it off by its key switch" in said
    assert laser.ask("OUTPUT?") == "1", "nobody can reach it"
    assert may_emit(run)
    with Hanging(address, port=cable.port):
        laser.seconds_until("OUTPUT?", "0", 30)
        until(lambda: not may_emit(run))


def addressed(served: Served, station: Path, name: str, hanging: "Hanging") -> None:
    """A station file in which one instrument may hang, and is not waited for long."""
    addresses = {role: found["socket"] for role, found in served[0].items()}
    write_addresses(station, addresses | {name: hanging.address}, read_station(served[1]))
    if name != "laser":  # whose timeout stands in its command table
        station.write_text(station.read_text().replace(f"[{name}]\n", f'[{name}]\ntimeout = "0.3 s"\n'))


class Hanging:
    """Carries bytes to an instrument and back, until it hangs: then no answer comes any more.

    `after` is how many bytes of answers come before it hangs by itself. With `hears` it takes commands even then.
    """

    def __init__(self, address: str, *, hears: bool = False, port: int = 0) -> None:
        self.hangs = threading.Event()
        self.after: int | None = None
        self._hears = hears
        self._port = int(address.split("::")[2])
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = self._listener.getsockname()[1]
        self.address = f"TCPIP0::127.0.0.1::{self.port}::SOCKET"
        threading.Thread(target=self._serve, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # not connected: that alone wakes the thread that accepts
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _serve(self) -> None:
        with suppress(OSError):
            while True:
                driver, _ = self._listener.accept()
                instrument = socket.create_connection(("127.0.0.1", self._port))
                for end in (driver, instrument):
                    end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._carry, args=(driver, instrument, self._heard), daemon=True).start()
                threading.Thread(target=self._carry, args=(instrument, driver, self._answered), daemon=True).start()

    def _heard(self, _count: int) -> bool:
        return self._hears or not self.hangs.is_set()

    def _answered(self, count: int) -> bool:
        if self.after is not None:
            self.after -= count
            if self.after < 0:
                self.hangs.set()
        return not self.hangs.is_set()

    def _carry(self, source: socket.socket, target: socket.socket, passes: Callable[[int], bool]) -> None:
        with source, suppress(OSError):
            while data := source.recv(65536):
                if passes(len(data)):
                    target.sendall(data)
            target.shutdown(socket.SHUT_RDWR)
