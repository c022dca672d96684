"""`labctl record` and `labctl replay`, as they are typed: a run is played again without any physics."""

import hashlib
import json
import re
import signal
import socket
import subprocess
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest

from instruments.alnair_tlg220 import Tlg220Section
from instruments.errors import LinkError
from instruments.tektronix_awg70002a import Awg70002a
from instruments.visa import VisaLink
from labctl.bench.opening import Access, opened
from labctl.bench.recording.format import Kind, read_recording
from labctl.bench.recording.recorder import Masks, recording_before, recordings
from labctl.bench.recording.replay import addresses, redirected, replay_of
from labctl.bench.recording.wire import RecordingRequest, Wire
from labctl.bench.simulation import SIMULATED_LASER
from labctl.bench.station import SIMULATED_STATION, SimSection, Station, read_station, write_addresses
from labctl.errors import StationError
from sim_backends.bench import SimulatedBench
from sim_backends.faults.bench import Befalling, FaultyBench
from sim_backends.faults.catalogue import WIRE, Moment
from sim_backends.virtual.attenuator.instrument import VirtualAttenuator
from tests.checkout import ROOT
from tests.command_line import LABCTL, labctl

MOST_POLLS = 1000
KILLED = ROOT / "tests" / "labctl" / "runs" / "older" / "1.1" / "killed"
"""A run of a bench that is not whole."""
STORED = Path(__file__).with_name("check.rec")
"""`labctl record check.rec --mask -- check`, on the simulated bench: make it anew when a driver is meant to differ."""

RUN = ("run", "image-readout", "--set", "images=8", "--set", "window=0.4 ns")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A recording of a small run, and what the run printed."""
    folder = tmp_path_factory.mktemp("recorded")
    command = [*LABCTL, "record", str(folder / "bench.rec"), "--", *RUN, "--out", str(folder / "run"), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "recorded in" in done.stderr
    return folder / "bench.rec", json.loads(done.stdout)


def test_the_replay_gives_the_same_frames(
    recorded: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, run = recorded
    status, out, err = labctl(capsys, "replay", recording, "--json", "--", *RUN, "--out", tmp_path / "again")
    assert (status, err) == (0, "")
    assert json.loads(out)["frames_sha256"] == run["frames_sha256"]
    origins = [
        json.loads(labctl(capsys, "show", one, "--json")[1])["origin"] for one in (run["run"], tmp_path / "again")
    ]
    assert origins == ["simulated", "replayed"]


def test_a_replay_says_nothing_of_how_long_a_bench_takes(
    recorded: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = labctl(capsys, "replay", recorded[0], "--", *RUN, "--out", tmp_path / "again")
    assert (status, "shots/s\n" in out) == (0, True)


def test_the_drivers_say_what_they_said_when_it_was_recorded(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = labctl(capsys, "replay", STORED, "--json", "--", "check")
    assert (status, err) == (0, "")
    assert json.loads(out)["instruments"]["scope"]["identity"].startswith("TEKTRONIX DPO72504DX serial-1")


def test_blocks_are_recorded_whole(recorded: tuple[Path, dict[str, Any]]) -> None:
    recording = read_recording(recorded[0])
    assert recording.complete
    assert {connection.instrument for connection in recording.connections} == set(Station().addresses)
    sent = [record.read() for record in recording.records if record.kind is Kind.SENT]
    put = next(message for message in sent if message.startswith(b"ALP:SEQPUT"))
    assert re.match(rb"ALP:SEQPUT \d+,0,1,#598304", put)
    assert put.endswith(b"\n")
    assert len(put) == put.index(b"#598304") + 7 + 98304 + 1
    assert any(record.read().startswith(b"#") for record in recording.records if record.kind is Kind.RECEIVED)


def test_a_changed_driver_is_named(
    recorded: tuple[Path, dict[str, Any]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Awg70002a, "MARKER_RESOLUTION_BITS", 8)
    status, out, err = labctl(capsys, "replay", recorded[0], "--", *RUN, "--out", tmp_path / "again")
    (difference,) = [line for line in err.splitlines() if line.startswith("replay:")]
    assert (status, out) == (1, "")
    assert re.fullmatch(
        r"replay: awg: message \d+ of connection 1: "
        r"expected 'SOURce1:DAC:RESolution 9', was sent 'SOURce1:DAC:RESolution 8'",
        difference,
    )
    assert err.splitlines()[-1] == difference
    assert "cannot be reached" not in err, "nor is it tried again: no instrument failed"
    assert "labctl resume" not in err


def test_a_changed_block_is_named_by_its_first_byte(
    recorded: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = [*RUN, "--set", "seed=2", "--out", str(tmp_path / "again")]
    status, _, err = labctl(capsys, "replay", recorded[0], "--", *other)
    assert (status, err.count("\n")) == (1, 1)
    assert re.search(r"#<\d+ bytes, crc32 \w{8}>, was sent .*; first differing byte of the block \d+: 0x", err)


def test_a_command_that_does_less_is_told(
    recorded: tuple[Path, dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = labctl(capsys, "replay", recorded[0], "--", "run", "image-readout", "--dry-run")
    assert status == 1
    assert re.search(r"replay: the command ended after 0 of \d+ messages", err)


def test_a_torn_recording_is_played_to_its_end(
    recorded: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torn = tmp_path / "torn.rec"
    torn.write_bytes(recorded[0].read_bytes()[:-20_000])
    status, _, err = labctl(capsys, "replay", torn, "--", *RUN, "--out", tmp_path / "again")
    assert status == 1
    assert "is incomplete" in err.splitlines()[0]
    (difference,) = [line for line in err.splitlines() if line.startswith("replay:")]
    assert "nothing more" in difference
    assert "key switch" not in err


def test_a_run_of_a_recording_says_so_and_goes_on_with_no_bench(
    recorded: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torn, run = tmp_path / "torn.rec", tmp_path / "again"
    torn.write_bytes(recorded[0].read_bytes()[:-20_000])
    status, _, err = labctl(capsys, "replay", torn, "--", *RUN, "--out", run)
    assert (status, "labctl resume" in err) == (1, False)
    manifest = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["replay"] == [{"name": "torn.rec", "sha256": hashlib.sha256(torn.read_bytes()).hexdigest()}]
    status, out, err = labctl(capsys, "resume", run)
    assert (status, out) == (2, "")
    assert err.endswith(
        f"labctl: {run}: its records are those of a recording, to which a bench adds none: repeat its command under "
        "'labctl replay', or begin a new run\n"
    )


def test_a_recording_adds_nothing_to_a_run_of_a_bench(
    recorded: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = copytree(KILLED, tmp_path / "killed")
    status, _, err = labctl(capsys, "replay", recorded[0], "--", "resume", run)
    assert status == 2
    assert f"labctl: {run}: its records are those of a bench, to which a recording adds none: leave out 'labctl" in err


def test_damaged_and_existing_files(
    recorded: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged = bytearray(recorded[0].read_bytes())
    records = read_recording(recorded[0]).records
    damaged[records[len(records) // 2].offset - 1] ^= 1
    (tmp_path / "damaged.rec").write_bytes(damaged)
    status, out, err = labctl(capsys, "replay", tmp_path / "damaged.rec", "--json")
    assert status == 2
    assert "is damaged at byte" in err
    assert json.loads(out)["exit"] == 2
    status, _, err = labctl(capsys, "record", recorded[0], "--", "check")
    assert status == 2
    assert "exists" in err
    (tmp_path / "a-2.rec").touch()
    status, _, err = labctl(capsys, "record", tmp_path / "a.rec", "--", "check")
    assert status == 2
    assert "a-2.rec: exists" in err


@pytest.mark.parametrize(("there", "new"), [("night.rec", "night-2.rec"), ("night-2.rec", "night.rec")])
def test_two_recordings_never_look_like_two_benches_of_one(
    there: str, new: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / there).touch()
    status, _, err = labctl(capsys, "record", tmp_path / new, "--", "check")
    assert (status, err.count("\n")) == (2, 1)
    assert there in err
    assert [path.name for path in tmp_path.iterdir()] == [there]


@pytest.mark.parametrize("new", ["night-1.rec", "night-02.rec", "night-two.rec", "night-2.txt", ".-2"])
def test_other_names_are_those_of_recordings_of_their_own(new: str, tmp_path: Path) -> None:
    (tmp_path / "night.rec").touch()
    assert recording_before(tmp_path / new) is None


@pytest.mark.parametrize("nested", [("replay", "a.rec"), ("record", "a.rec", "--", "check")])
def test_neither_is_nested(nested: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("record", "replay"):
        status, _, err = labctl(capsys, command, tmp_path / "b.rec", "--", *nested)
        assert status == 2
        assert "cannot be recorded or replayed" in err


@pytest.mark.parametrize("apart", [("queue", "start"), ("init", "--no-search", "--scope", "simulated")])
def test_what_would_speak_past_the_recording_is_refused_before_anything(
    apart: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for command in ("record", "replay"):
        status, _, err = labctl(capsys, command, "b.rec", "--", *apart)
        assert (status, err.count("\n")) == (2, 1)
        assert "cannot be recorded or replayed" in err
    assert not list(tmp_path.iterdir())


def test_what_is_for_clients_of_your_own_is_refused_with_a_command(
    recorded: tuple[Path, dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = labctl(capsys, "replay", recorded[0], "--port-base", "5000", "--", "check")
    assert status == 2
    assert "leave the command out" in err


def test_a_masked_recording_tells_no_serial_number_and_still_matches(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, _ = labctl(capsys, "record", tmp_path / "m.rec", "--mask", "--", "check")
    assert status == 0
    whole = b"".join(record.read() for record in read_recording(tmp_path / "m.rec").records)
    assert b"SIM0001" not in whole
    assert b"127.0.0.1" not in (tmp_path / "m.rec").read_bytes()
    assert b"serial-1" in whole
    status, out, _ = labctl(capsys, "replay", tmp_path / "m.rec", "--json", "--", "check")
    assert status == 0
    assert "serial-1" in json.loads(out)["instruments"]["awg"]["identity"]


def test_nothing_spoken_nothing_recorded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = labctl(capsys, "record", tmp_path / "m.rec", "--", "data", "list")
    assert status == 0
    assert "nothing was recorded" in err
    assert not (tmp_path / "m.rec").exists()


def test_every_bench_of_a_command_has_its_file(tmp_path: Path) -> None:
    wire = Wire(record=RecordingRequest(path=tmp_path / "a.rec", mask=False, command=("twice",)))
    for _ in range(2):
        with opened(Station(), lambda *_: None, Access(wire=wire)) as found:
            found.bench.awg.identify()
    for name in ("a.rec", "a-2.rec"):
        recording = read_recording(tmp_path / name)
        assert recording.complete
        assert [connection.instrument for connection in recording.connections] == ["awg"]
        assert recording.heading["command"] == ["twice"]


class TestServing:
    """Without a command: until everything is played, a difference, or a signal."""

    def serve(self, recording: Path, *options: str) -> "subprocess.Popen[str]":
        command = [*LABCTL, "replay", str(recording), "--json", *options]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def test_ends_well_when_all_is_played(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        labctl(capsys, "record", tmp_path / "c.rec", "--", "check")
        station = tmp_path / "station.toml"
        with self.serve(tmp_path / "c.rec", "--save-station", str(station)) as server:
            assert server.stdout is not None
            resources = json.loads(server.stdout.readline())["resources"]
            assert list(resources) == list(Station().addresses)
            status, _, _ = labctl(capsys, "check", "--station", station)
            _, err = server.communicate(timeout=30)
        assert (status, server.returncode) == (0, 0)
        assert re.search(r"replay: (\d+) of \1 messages were played", err)

    def test_a_signal_before_the_end(self, recorded: tuple[Path, dict[str, Any]]) -> None:
        with self.serve(recorded[0]) as server:
            assert server.stdout is not None
            server.stdout.readline()
            server.send_signal(signal.SIGTERM)
            _, err = server.communicate(timeout=30)
        assert server.returncode == 130
        assert "replay: 0 of" in err


def test_a_difference_ends_the_serving(
    recorded: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    station = tmp_path / "station.toml"
    with ThreadPoolExecutor(1) as client:
        failure = client.submit(identify, station)
        status, out, err = labctl(capsys, "replay", recorded[0], "--save-station", station)
        assert isinstance(failure.result(30), LinkError)
    assert status == 1
    assert re.search(r"patch_panel +TCPIP0::127", out)
    assert re.search(r"replay: awg: message 1 of connection 1: expected .*, was sent 'HELLO\?'", err)


def identify(station: Path) -> LinkError | None:
    """Ask the AWG of `station`, as soon as there is one, what nobody has asked it before."""
    pause = threading.Event()
    for _ in range(MOST_POLLS):
        if station.exists() and "patch_panel" in station.read_text():
            break
        pause.wait(0.02)
    link = VisaLink(read_station(station).awg.address, name="awg", timeout_s=10, transcript=lambda *_: None)
    try:
        link.query("HELLO?")
    except LinkError as error:
        return error
    finally:
        link.close()
    return None


def test_a_taken_port_is_told(recorded: tuple[Path, dict[str, Any]], capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        status, _, err = labctl(capsys, "replay", recorded[0], "--port-base", str(taken.getsockname()[1]))
    assert status == 2
    assert "choose another port" in err


def test_masks() -> None:
    masks = Masks()
    assert masks.identity(b"TEKTRONIX,AWG70002A,B010203,FV:6.1\n") == b"TEKTRONIX,AWG70002A,serial-1,FV:6.1\n"
    assert masks.identity(b"TEKTRONIX,DPO,C1,FV\n") == b"TEKTRONIX,DPO,serial-2,FV\n"
    assert masks.identity(b"TEKTRONIX,AWG70002A,B010203,FV:6.1\n") == b"TEKTRONIX,AWG70002A,serial-1,FV:6.1\n"
    assert masks.resource("TCPIP0::scope.lab.example::inst0::INSTR") == "TCPIP0::host-1::inst0::INSTR"
    assert masks.resource("TCPIP0::scope.lab.example::4000::SOCKET") == "TCPIP0::host-1::4000::SOCKET"
    assert masks.resource("USB0::0x0699::0x0503::B010203::INSTR") == "USB0::0x0699::0x0503::serial-1::INSTR"
    assert masks.resource("ASRL/dev/ttyUSB0::INSTR") == "ASRL/dev/ttyUSB0::INSTR"


def test_it_does_not_matter_which_of_several_benches_is_opened_first(tmp_path: Path) -> None:
    first, second, unknown = (Station(sim=SimSection(twin_seed=seed)) for seed in (1, 2, 3))
    recording = Access(wire=Wire(record=RecordingRequest(path=tmp_path / "a.rec", mask=False, command=("several",))))
    for station in (first, second, first):
        with opened(station, lambda *_: None, recording) as found:
            (found.bench.awg if station is first else found.bench.scope).identify()
    files = recordings(tmp_path / "a.rec")
    assert [file.name for file in files] == ["a.rec", "a-2.rec", "a-3.rec"]
    played = [read_recording(file) for file in files]
    with replay_of(played) as replay:
        playing = Access(wire=Wire(replay=addresses(replay, played)))
        for station in (second, first, first):
            with opened(station, lambda *_: None, playing) as found:
                assert found.simulation is None
                (found.bench.awg if station is first else found.bench.scope).identify()
        with (
            pytest.raises(StationError, match="no bench with these settings was recorded"),
            opened(unknown, print, playing),
        ):
            pass
        replay.stop()
        assert replay.complete


def test_stations_are_redirected_to_the_replay(recorded: tuple[Path, dict[str, Any]]) -> None:
    station = Station(laser={"commands": "own.toml"}, dmd={"address": "TCPIP0::a::1::SOCKET"})
    played = [read_recording(recorded[0])]
    with replay_of(played) as replay:
        benches = addresses(replay, played)
        (resources,) = benches.values()
        assert redirected(station, benches).addresses == resources
        for told, commands in ((station, Path("own.toml")), (Station(), SIMULATED_LASER)):
            laser = redirected(told, benches).laser
            assert isinstance(laser, Tlg220Section)
            assert laser.commands == commands


def test_a_replay_speaks_to_no_instrument_that_was_not_recorded(
    recorded: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = []
    with SimulatedBench(plugged_in={"attenuator": VirtualAttenuator}) as bench:
        attenuator = {"driver": "table-attenuator", "commands": "simulated", "attenuation_db": 1.0}
        station = Station.model_validate(
            SIMULATED_STATION.model_dump(exclude_defaults=True) | {"attenuator": attenuator}
        )
        write_addresses(tmp_path / "six.toml", {name: at["socket"] for name, at in bench.resources.items()}, station)
        _, host, port, _ = bench.resources["attenuator"]["socket"].split("::")
        with socket.create_connection((host, int(port)), timeout=20) as link, link.makefile("rb") as lines:
            link.sendall(b"OUTPut ON\n")
            for command in ((*RUN, "--out", tmp_path / "again"), ("check",)):
                told.append(labctl(capsys, "replay", recorded[0], "--", *command, "--station", tmp_path / "six.toml"))
                link.sendall(b"OUTPut?;INPut:ATTenuation?\n")
                assert lines.readline() == b"1;0.0000000000E+00\n"
    for status, _, err in told:
        assert status == 2
        assert "six.toml: attenuator is not in the recording, so a replay would speak to the real one: " in err


def test_who_is_silent_in_a_recording_is_not_asked_at_the_address_of_the_station(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, silent = tmp_path / "bench.toml", Befalling("awg", WIRE["dead"], Moment("*IDN?"))
    with FaultyBench([silent]) as bench:
        write_addresses(file, {name: found["socket"] for name, found in bench.resources.items()})
        text = file.read_text("utf-8").replace("[awg]\n", "[awg]\ntimeout = '0.3 s'\n")
        file.write_text(text, "utf-8")
        labctl(capsys, "record", tmp_path / "a.rec", "--", "check", "--station", file)
    with socket.create_server(("127.0.0.1", 0)) as real:
        port = bench.resources["awg"]["socket"].split("::")[2]
        file.write_text(text.replace(port, str(real.getsockname()[1])), "utf-8")
        _, out, _ = labctl(capsys, "replay", tmp_path / "a.rec", "--", "check", "--station", file)
        assert "did not answer in time (at '*IDN?')" in out
        real.settimeout(0.0)
        with pytest.raises(BlockingIOError):
            real.accept()


def test_a_child_process_learns_of_the_wire_by_its_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wire = Wire(
        record=RecordingRequest(path=tmp_path / "a.rec", mask=True, command=("check",)), replay={"a": {"awg": "b"}}
    )
    assert Wire.of_this_process() == Wire()
    for name, value in wire.environment().items():
        monkeypatch.setenv(name, value)
    assert Wire.of_this_process() == wire
