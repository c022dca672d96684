"""What a supervisor does when its parent is gone, told by a pipe that ends."""

import io
import json
import os
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any

import pytest

from instruments.alnair_tlg220 import Tlg220
from instruments.bench import Observer
from instruments.errors import NotConfigured
from instruments.vialux_alp import VialuxAlp
from labctl.bench.opening import opened
from labctl.bench.recording.wire import Wire
from labctl.bench.simulation import SIMULATED_LASER
from labctl.bench.station import SIMULATED_STATION, Station
from labctl.bench.supervision import COMMAND, supervised
from labctl.bench.supervisor import (
    AGAIN_S,
    AT_ONCE_S,
    ATTEMPTS,
    READY,
    TELL_EVERY,
    TRYING,
    Task,
    supervise,
    within_reach,
)
from labctl.runs.live.alarm import SEEN_DARK, may_emit, say_dark
from labctl.runs.live.events import EventReader
from labctl.runs.live.logs import CommandLog
from sim_backends.bench import SimulatedBench

NOBODY = {"address": "TCPIP0::127.0.0.1::9::SOCKET"}


@pytest.fixture
def station() -> Iterator[Station]:
    """A bench at addresses, served from here."""
    with SimulatedBench() as bench:
        sections = {name: {"address": found["socket"]} for name, found in bench.resources.items()}
        yield Station.model_validate(sections | {"laser": sections["laser"] | {"commands": SIMULATED_LASER}})


def orders(station: Station, *later: object) -> io.BytesIO:
    task = Task(station=station, log_started=time.perf_counter() - 1000)
    return io.BytesIO("".join(f"{line}\n" for line in (task.model_dump_json(), *map(json.dumps, later))).encode())


def without_laser(station: Station) -> Station:
    """Nobody listens at the laser's address."""
    return station.model_copy(update={"laser": station.laser.model_copy(update=NOBODY)})


def ignored(_said: bytes) -> None:
    pass


def test_a_parent_that_ended_leaves_a_safe_bench_and_a_line_in_the_log(
    station: Station, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "commands.log"
    path.write_text("999.5 > laser OUTPUT ON\n999.6 > scope CURV")
    with CommandLog() as log, opened(station, log) as found:
        found.bench.laser.emit()
        supervise(orders(station, str(tmp_path / "no run"), str(path)), ignored)
        assert found.bench.laser.settings()["emitting"] == 0
    lines = path.read_text().splitlines()
    assert lines[1] == "999.6 > scope CURV"
    assert lines[2].endswith("> laser OUTPUT OFF")
    assert 1000 < float(lines[2].split()[0]) < 1100
    done = "the supervisor did: laser off, AWG output off, DMD blank, oscilloscope stopped"
    assert f" ! run ended without making the bench safe, {done} (" in lines[-1]
    assert capfd.readouterr().err == f"labctl: the run ended without making the bench safe, {done}\n"
    (told,) = EventReader(tmp_path / "events.jsonl").read()
    assert (told.name, told.fields["reached"], told.fields["by"]) == ("safe state", True, "supervisor")


def test_a_laser_set_by_hand_is_left_to_a_person(station: Station, capfd: pytest.CaptureFixture[str]) -> None:
    by_hand = station.model_copy(update={"laser": station.laser.model_copy(update={"driver": "manual-laser"})})
    supervise(orders(by_hand), ignored)
    said = capfd.readouterr().err
    assert "did: AWG output off, DMD blank, oscilloscope stopped; the laser is set by hand: switch it off" in said


def test_what_cannot_be_reached_is_told(station: Station, capfd: pytest.CaptureFixture[str]) -> None:
    supervise(orders(station.model_copy(update={"awg": station.awg.model_copy(update=NOBODY)})), ignored)
    said = capfd.readouterr().err
    assert "the supervisor could not: the safe state is not confirmed (awg: awg at TCPIP0" in said
    assert said.endswith("the laser is off\n")
    assert said.count("\n") == 1


def test_a_laser_that_cannot_be_reached_is_tried_until_it_can(
    station: Station, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its cable is plugged in again while the supervisor waits for the third time."""
    pauses: list[float] = []
    said: list[bytes] = []
    with CommandLog() as log, opened(station, log) as found, socket.create_server(("127.0.0.1", 0)) as unplugged:
        found.bench.laser.emit()
        port = unplugged.getsockname()[1]
        unplugged.close()
        away = station.laser.model_copy(update={"address": f"TCPIP0::127.0.0.1::{port}::SOCKET"})

        def plug_in(seconds: float) -> None:
            pauses.append(seconds)
            if len(pauses) == 3:
                stack.enter_context(forwarded(port, station.laser.address))

        with ExitStack() as stack:
            supervise(orders(station.model_copy(update={"laser": away})), said.append, plug_in)
        assert found.bench.laser.settings()["emitting"] == 0
    assert pauses == [AGAIN_S] * 3
    assert said == [READY, TRYING]
    first, last = capfd.readouterr().err.splitlines()
    assert "the laser may still emit, switch it off by its key switch; the laser is tried again for 10 min" in first
    assert last == "labctl: the run ended without making the bench safe, the supervisor did at last: laser off"


def test_people_are_told_of_a_laser_that_goes_on_emitting_until_somebody_has_seen_it_dark(
    station: Station, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pauses: list[float] = []
    (tmp_path / "events.jsonl").touch()

    def see(seconds: float) -> None:
        pauses.append(seconds)
        if len(pauses) == 3 * TELL_EVERY + 1:
            assert may_emit(tmp_path)
            say_dark(tmp_path)

    supervise(orders(without_laser(station), str(tmp_path / "commands.log")), ignored, see)
    assert len(pauses) == 3 * TELL_EVERY + 1
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 4
    assert all("the laser may still emit, switch it off by its key switch" in line for line in lines)
    told = EventReader(tmp_path / "events.jsonl").read()
    assert [(one.name, one.fields.get("disobeyed")) for one in told] == [("safe state", ["laser"])] * 4 + [
        (SEEN_DARK, None)
    ]
    assert not may_emit(tmp_path)


@contextmanager
def trying(station: Station, **files: Any) -> Iterator[subprocess.Popen[bytes]]:
    """A process that supervises one that has ended, and whose laser is out of reach: it tries until the block ends."""
    with subprocess.Popen(COMMAND, stdin=subprocess.PIPE, **files) as process:
        try:
            assert process.stdin is not None
            process.stdin.write(orders(without_laser(station)).read())
            process.stdin.close()
            yield process
        finally:
            process.kill()


def test_where_standard_error_is_a_terminal_it_is_told_in_red(station: Station) -> None:
    """And what is captured is let go of; a terminal is not waited for."""
    ours, theirs = os.openpty()
    with trying(station, stdout=subprocess.PIPE, stderr=theirs) as process:
        os.close(theirs)
        assert process.stdout is not None
        assert (process.stdout.readline(), process.stdout.readline()) == (READY, TRYING)
        told = os.read(ours, 10_000).decode()
    os.close(ours)
    assert re.match(r"\a\x1b\[1;31mlabctl: the run ended without .* the laser may still emit.*\x1b\[0m", told)


@pytest.mark.skipif(sys.platform == "win32", reason="needs a terminal")
def test_a_terminal_that_is_held_keeps_nobody_from_trying(station: Station) -> None:
    import termios

    ours, held = os.openpty()
    termios.tcflow(held, termios.TCOOFF)
    with trying(station, stdout=subprocess.PIPE, stderr=held) as process:
        assert process.stdout is not None
        assert (process.stdout.readline(), process.stdout.readline()) == (READY, TRYING)
    os.close(held)
    os.close(ours)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a file that takes nothing")
def test_a_parent_that_cannot_be_told_anything_keeps_nobody_from_trying(station: Station) -> None:
    """Whatever the system calls a pipe that nobody reads: Windows calls it an invalid argument."""
    with Path("/dev/full").open("wb") as full, trying(station, stdout=full, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        told = process.stderr.readline()
    assert b"the laser is tried again for 10 min" in told


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a file that takes nothing")
def test_a_supervisor_that_cannot_be_told_anything_hinders_no_run_on_its_way_into_the_dark(
    station: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        CommandLog() as log,
        supervised(station, log) as supervisor,
        monkeypatch.context() as patched,
        FileIO("/dev/full", "w") as full,
    ):
        patched.setattr(supervisor, "_orders", full)
        supervisor.emission(on=True)
        supervisor.safe_state(None)


def test_a_laser_that_is_never_reached_is_left_to_its_key_switch(
    station: Station, capfd: pytest.CaptureFixture[str]
) -> None:
    pauses: list[float] = []
    supervise(orders(without_laser(station)), ignored, pauses.append)
    assert len(pauses) == ATTEMPTS
    told = capfd.readouterr().err.splitlines()[-1]
    assert told.endswith("the laser could not be reached, switch it off by its key switch")


def test_a_laser_that_answers_and_drops_the_command_is_told_again(
    station: Station, capfd: pytest.CaptureFixture[str]
) -> None:
    """At once, as it may have heard the last command of a killed run after that; and then again and again."""
    drops: list[int] = []

    def hears_some(data: bytes) -> bytes:
        if b"OUTPUT OFF" in data and len(drops) < 2 * (len(AT_ONCE_S) + 1):
            drops.append(1)
            return data.replace(b"OUTPUT OFF\n", b"")
        return data

    said: list[bytes] = []
    with CommandLog() as log, opened(station, log) as found, socket.create_server(("127.0.0.1", 0)) as free:
        found.bench.laser.emit()
        port = free.getsockname()[1]
        free.close()
        deaf = station.laser.model_copy(update={"address": f"TCPIP0::127.0.0.1::{port}::SOCKET"})
        with forwarded(port, station.laser.address, hears_some):
            supervise(orders(station.model_copy(update={"laser": deaf})), said.append, lambda _seconds: None)
        assert found.bench.laser.settings()["emitting"] == 0
    assert said == [READY, TRYING]
    first, last = capfd.readouterr().err.splitlines()
    assert "laser: still emits after output_off" in first
    assert last.endswith("the supervisor did at last: laser off")


def test_what_a_driver_needs_is_read_while_it_is_there(station: Station, tmp_path: Path) -> None:
    table = tmp_path / "laser.toml"
    table.write_bytes(SIMULATED_LASER.read_bytes())
    own = station.model_copy(update={"laser": station.laser.model_copy(update={"commands": table})})
    said: list[bytes] = []

    def gone(word: bytes) -> None:
        said.append(word)
        table.unlink(missing_ok=True)

    with CommandLog() as log, opened(own, log) as found:
        found.bench.laser.emit()
        supervise(orders(own), gone, lambda _seconds: None)
        assert said == [READY]
        assert found.bench.laser.settings()["emitting"] == 0


def test_what_gives_no_light_may_be_missing_until_it_is_needed(
    station: Station, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """As a DMD whose library this process lacks: the light goes off all the same, and the DMD is named."""

    def missing(_dmd: VialuxAlp, *_arguments: object, **_options: object) -> None:
        raise NotConfigured("dmd: its library is not installed")

    monkeypatch.setattr(VialuxAlp, "__init__", missing)
    said: list[bytes] = []
    supervise(orders(station), said.append)
    assert said == [READY]
    told = capfd.readouterr().err
    assert "dmd: dmd: its library is not installed" in told
    assert "the laser is off" in told
    monkeypatch.setattr(Tlg220, "__init__", missing)
    with pytest.raises(NotConfigured):
        supervise(orders(station), said.append)
    assert said == [READY], "there is to be no light"


def test_a_driver_that_fails_is_tried_again(
    station: Station, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    failures = iter([ValueError("no number")] * 3)
    make_safe = Tlg220.make_safe

    def garbled(laser: Tlg220) -> None:
        for failure in failures:
            raise failure
        make_safe(laser)

    monkeypatch.setattr(Tlg220, "make_safe", garbled)
    said: list[bytes] = []
    with CommandLog() as log, opened(station, log) as found:
        found.bench.laser.emit()
        supervise(orders(station), said.append, lambda _seconds: None)
        assert found.bench.laser.settings()["emitting"] == 0
    assert said == [READY, TRYING]
    first, last = capfd.readouterr().err.splitlines()
    assert "laser: ValueError: no number" in first
    assert last.endswith("the supervisor did at last: laser off")


@contextmanager
def forwarded(port: int, address: str, heard: Callable[[bytes], bytes] = bytes) -> Iterator[None]:
    """What comes to `port` goes to the instrument at `address`, as it is `heard`, and back."""
    with socket.create_server(("127.0.0.1", port)) as listener:
        threading.Thread(target=_forward, args=(listener, int(address.split("::")[2]), heard), daemon=True).start()
        yield


def _forward(listener: socket.socket, port: int, heard: Callable[[bytes], bytes]) -> None:
    with suppress(OSError):
        while True:
            client, _ = listener.accept()
            instrument = socket.create_connection(("127.0.0.1", port))
            for source, target, passed in ((client, instrument, heard), (instrument, client, bytes)):
                threading.Thread(target=_carry, args=(source, target, passed), daemon=True).start()


def _carry(source: socket.socket, target: socket.socket, passed: Callable[[bytes], bytes]) -> None:
    with source, suppress(OSError):
        while data := source.recv(65536):
            target.sendall(passed(data))
        target.shutdown(socket.SHUT_RDWR)


@pytest.mark.parametrize("nothing", [b"", b'{"station": {'])
def test_a_parent_that_ended_before_it_said_anything_had_no_light(nothing: bytes) -> None:
    said: list[bytes] = []
    supervise(io.BytesIO(nothing), said.append)
    assert not said


def test_a_bench_in_this_process_or_by_hand_is_out_of_reach(station: Station) -> None:
    assert within_reach(station) == ("laser", "awg", "dmd", "scope")
    assert within_reach(SIMULATED_STATION) == ()
    mixed = {"laser": {"driver": "manual-laser", "address": "by hand"}, "awg": {"address": "TCPIP0::192.0.2.1::INSTR"}}
    assert within_reach(Station.model_validate(mixed)) == ("awg",)


def test_a_replay_is_not_supervised(station: Station) -> None:
    with CommandLog() as log, supervised(station, log, Wire(replay={})) as nobody:
        assert type(nobody) is Observer


def test_it_starts_without_what_only_a_run_needs() -> None:
    heavy = (
        "scipy",
        "sklearn",
        "h5py",
        "matplotlib",
        "rich",
        "pint",
        "sim_backends",
        "labctl.runs.read",
        "labctl.runs.write",
    )
    loaded = f"import sys, labctl.bench.supervisor; print([name for name in {heavy} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", loaded], capture_output=True, check=True).stdout == b"[]\n"
