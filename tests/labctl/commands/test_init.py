"""`labctl init` on a bench that answers, on one that does not, and on a person who types."""

import io
import json
import re
import socketserver
import sys
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path
from shutil import copyfile
from typing import Any

import jsonschema
import pytest

from instruments.alnair_tlg220 import Tlg220Section
from instruments.values import Identity
from labctl.bench.discovery import Answer, answers_at, recognised
from labctl.bench.lock import held_alone
from labctl.bench.schema import STATION, schema_of
from labctl.bench.simulation import SIMULATED_LASER
from labctl.bench.station import Station, read_station
from sim_backends.bench import SimulatedBench
from tests.command_line import labctl

SILENT, NOBODY = "TCPIP0::127.0.0.1::9::SOCKET", "TCPIP0::127.0.0.1::7::SOCKET"


class Terminal(io.StringIO):
    """A person's answers."""

    def isatty(self) -> bool:
        return True


def written(path: Path) -> Station:
    """What the file says, once it is known to be right."""
    content = tomllib.loads(path.read_text("utf-8"))
    jsonschema.Draft202012Validator(schema_of(STATION)).validate(content)
    return read_station(path)


@pytest.fixture(scope="module")
def addresses() -> Iterator[dict[str, str]]:
    """A bench that answers."""
    with SimulatedBench() as bench:
        yield {name: found["socket"] for name, found in bench.resources.items()}


def test_instruments_that_answer_are_known_by_what_they_say(
    addresses: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    named = [word for address in reversed(addresses.values()) for word in ("--address", address)]
    path = tmp_path / "bench.toml"
    status, out, err = labctl(capsys, "init", path, "--no-search", *named, "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)
    assert {name: told["address"] for name, told in found["instruments"].items()} == addresses
    assert written(path).addresses == addresses
    text = path.read_text("utf-8")
    assert text.startswith("#:schema station.schema.json\n")
    assert json.loads((tmp_path / "station.schema.json").read_text("utf-8")) == schema_of(STATION)
    assert "# Answered here: TEKTRONIX AWG70002A SIM0001" in text
    assert "class 3B" in text
    status, out, _ = labctl(capsys, "check", "--station", path, "--json")
    assert (status, json.loads(out)["ok"]) == (0, True)


def test_nobody_answers_and_nothing_is_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bench.toml"
    status, out, _ = labctl(capsys, "init", path, "--no-search", "--yes", "--address", SILENT)
    assert status == 0
    station = written(path)
    assert set(station.addresses.values()) == {""}
    assert not station.laser.armed
    assert station.limits.optical_power == station.laser.power == 0.03
    assert path.read_text("utf-8").count("# Not found") == 5
    assert "laser: not found: write its address into the file" in out
    assert f"{SILENT}: nobody answers there: check that it is switched on, or correct --address" in out
    assert f"next: labctl check --station {path}" in out
    status, out, _ = labctl(capsys, "check", "--station", path)
    assert status == 1
    assert "laser.address is empty: write its VISA address" in out


def test_a_table_for_a_laser_without_one_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--no-search", "--yes", "--laser", "manual", "--laser-commands", "tlg.toml")
    status, _, err = labctl(capsys, "init", tmp_path / "bench.toml", *words)
    assert (status, err) == (2, "labctl: --laser-commands: this laser has no command table: leave it out\n")
    assert not list(tmp_path.iterdir())


def test_every_key_is_there_with_its_default(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every line that is a comment of a key is right when its # is taken away, quantities with their unit."""
    path = tmp_path / "bench.toml"
    labctl(capsys, "init", path, "--no-search", "--yes")
    text = re.sub(r"^# (?=\w+ = )", "", path.read_text("utf-8"), flags=re.MULTILINE)
    path.write_text(re.sub(r'^\w+ = ""', "# \\g<0>", text, flags=re.MULTILINE), "utf-8")
    assert written(path).limits == Station().limits
    whole = tomllib.loads(text)
    assert (whole.pop("name"), whole.pop("mixed")) == ("bench", False)
    whole = {table: {key: value for key, value in keys.items() if value != ""} for table, keys in whole.items()}
    assert Station.model_validate(whole) == Station(name="simulated bench")
    for table, keys in whole.items():
        fields = type(getattr(Station(), table)).model_fields
        assert keys.keys() | {"address"} >= {key for key, field in fields.items() if field.default is not None}


def test_what_is_said_wins(addresses: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bench.toml"
    said = ("--awg", SILENT, "--laser", "manual", "--dmd", "usb", "--patch-panel", "manual", "--ports", "2-6")
    more = (
        "--optical-power",
        "5 mW",
        "--name",
        "room 2",
        "--burst",
        "--address",
        addresses["awg"],
        "--address",
        NOBODY,
    )
    status, out, _ = labctl(capsys, "init", path, "--no-search", *said, *more, "--json")
    assert status == 0
    station = written(path)
    assert (station.awg.address, station.dmd.address, station.scope.address) == (SILENT, "usb", "")
    assert (station.laser.driver, station.patch_panel.driver) == ("manual-laser", "manual-patch-panel")
    assert (station.limits.optical_power, station.laser.power) == (0.005, 0.005)
    assert (station.name, station.wiring.burst, station.patch_panel.ports) == ("room 2", True, (2, 3, 4, 5, 6))
    assert json.loads(out)["silent"] == ["awg", NOBODY]
    assert "# Did not answer when this file was written." in path.read_text("utf-8")
    assert [other["address"] for other in json.loads(out)["others"]] == [addresses["awg"]]


def test_what_can_hardly_be_meant_is_told(
    addresses: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--awg", addresses["scope"], "--optical-power", "1 MW", "--no-search")
    status, _, told = labctl(capsys, "init", tmp_path / "bench.toml", *words)
    assert status == 0
    assert f"{addresses['scope']}: TEKTRONIX DPO72504DX" in " ".join(told.split())
    assert "not what labctl knows as" in told
    assert "1 MW is more than a laser of class 3B has, 0.5 W: is it what you mean?" in told


def test_a_real_laser_needs_a_command_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bench.toml"
    table = tmp_path / "ours.toml"
    copyfile(SIMULATED_LASER, table)
    labctl(capsys, "init", path, "--no-search", "--laser", SILENT, "--laser-commands", table)
    laser = written(path).laser
    assert isinstance(laser, Tlg220Section)
    assert laser.commands == table
    assert "Its command set is not public" in path.read_text("utf-8")


def test_a_person_is_asked_and_may_just_press_enter(
    addresses: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "room2.toml"
    typed = ["", addresses["scope"], "by hand", "manual", "usb", "manual", "two", "2-6", "20", "0 W", "20 mW", "y", ""]
    monkeypatch.setattr("sys.stdin", Terminal("\n".join(typed) + "\n"))
    status, out, err = labctl(capsys, "init", path, "--no-search", "--address", addresses["awg"], "--json")
    assert (status, out.count("\n")) == (0, 1)
    assert err.splitlines()[1].startswith("Write an address as VISA does, such as TCPIP0::")
    assert f"Address of the arbitrary waveform generator [{addresses['awg']}]:  TEKTRONIX AWG70002A SIM0001" in err
    assert "Address of the oscilloscope:  TEKTRONIX DPO72504DX" in err
    assert "Error: 'by hand' is no address: write one such as TCPIP0::192.0.2.10::inst0::INSTR, or simulated or" in err
    assert "Error: ports = 'two': 'two' is not a list of ports: write it like '2-6'" in err
    assert "Error: optical_power = '20': '20' has no unit: write it like '20 W'" in err
    assert "Error: optical_power = '0 W': Input should be greater than 0 W" in err
    station = written(path)
    assert (station.awg.address, station.scope.address) == (addresses["awg"], addresses["scope"])
    assert (station.laser.driver, station.limits.optical_power, station.name) == ("manual-laser", 0.02, "room2")
    assert station.wiring.burst
    assert "# Answered here: TEKTRONIX DPO72504DX" in path.read_text("utf-8")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--awg", "manual"],
            "--awg: 'manual' is no address: write one such as TCPIP0::192.0.2.10::inst0::INSTR, or sim",
        ),
        (["--awg", "garbage"], "--awg: 'garbage' is no address"),
        (["--patch-panel", "usb"], "--patch-panel: 'usb' is no address"),
        (["--optical-power", "30 V"], "--optical-power: '30 V' is not in W"),
        (["--optical-power", "-3 mW"], "limits.optical_power = '-3 mW': Input should be greater than 0 W"),
        (["--optical-power", "0 dBm", "--laser-commands", "nosuch.toml"], "/nosuch.toml"),
        (["--ports", "2-x"], "patch_panel.ports = '2-x'"),
        (["--dmd", 'TCPIP::a"b'], "--dmd: address = "),
    ],
)
def test_what_would_be_wrong_is_not_written(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = labctl(capsys, "init", tmp_path / "bench.toml", "--no-search", "--yes", *words)
    assert (status, err.count("\n")) == (2, 1)
    assert message in err
    assert not list(tmp_path.iterdir())


def test_a_file_that_exists_is_not_touched(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bench.toml"
    path.write_text("mine", encoding="utf-8")
    status, _, err = labctl(capsys, "init", path, "--no-search", "--yes")
    assert (status, path.read_text("utf-8")) == (2, "mine")
    assert "exists: name a new file" in err
    assert [found.name for found in tmp_path.iterdir()] == ["bench.toml"]


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits of files")
@pytest.mark.parametrize(("room", "written"), [(1 << 10, []), (1 << 14, ["bench.toml"])])
def test_a_disk_without_room_takes_whole_files_or_none(
    room: int, written: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Half a station file is that of a bench with other limits."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        words = ("--no-search", "--yes", "--optical-power", "10 mW")
        status, _, err = labctl(capsys, "init", tmp_path / "bench.toml", *words)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert status == 2
    assert "cannot be written (File too large)" in err
    assert [path.name for path in tmp_path.iterdir()] == written
    assert all(read_station(tmp_path / name).limits.optical_power == 10e-3 for name in written)


def test_whoever_is_there_hears_one_question_and_nothing_else() -> None:
    heard: list[bytes] = []

    class Listener(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            for line in self.rfile:
                heard.append(line)
                self.wfile.write(b"Somebody,Else,1,2\n")

    with socketserver.TCPServer(("127.0.0.1", 0), Listener) as server:
        threading.Thread(target=server.handle_request).start()
        address = f"TCPIP0::127.0.0.1::{server.server_address[1]}::SOCKET"
        assert list(answers_at([address, address])) == [Answer(address, Identity("Somebody", "Else", "1", "2"))]
    assert heard == [b"*IDN?\n"]


def test_what_another_program_has_open_is_not_spoken_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socketserver.TCPServer(("127.0.0.1", 0), socketserver.StreamRequestHandler) as server:
        server.timeout = 0
        server.handle_timeout = lambda: heard.append("nobody")  # type: ignore[method-assign]
        heard: list[str] = []
        address = f"TCPIP0::127.0.0.1::{server.server_address[1]}::SOCKET"
        with held_alone(address.replace("127.0.0.1", "localhost"), "a run of image-readout"):
            status, out, _ = labctl(capsys, "init", tmp_path / "bench.toml", "--no-search", "--scope", address)
        server.handle_request()
    assert (status, heard) == (0, ["nobody"])
    assert re.search(
        f"^{address}: held by a run of image-readout, process .*; it was not asked who is there$", out, re.M
    )
    assert "nobody answers" not in out
    assert "# Another program had it open" in (tmp_path / "bench.toml").read_text("utf-8")


@pytest.mark.parametrize(
    ("maker", "model", "instrument"),
    [
        ("TEKTRONIX", "AWG70001A", "awg"),
        ("TEKTRONIX", "DPO72504DX", "scope"),
        ("TEKTRONIX", "MSO73304DX", "scope"),
        ("TEKTRONIX", "MDO3024", ""),
        ("Alnair Labs", "TLG-220", "laser"),
        ("ACME", "Fibre Switch 16", "patch_panel"),
        ("ACME", "Toaster", ""),
    ],
)
def test_makers_and_models(maker: str, model: str, instrument: str) -> None:
    assert recognised("", Identity(maker, model, "", "")).instrument == instrument


def test_a_person_hears_at_once_who_is_at_an_address(
    addresses: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("\n".join([SILENT, addresses["awg"], *[""] * 7]) + "\n"))
    status, out, err = labctl(capsys, "init", tmp_path / "bench.toml", "--no-search")
    assert status == 0
    assert "Write an address as VISA does, such as TCPIP0::192.0.2.10::inst0::INSTR." in err.splitlines()[1]
    assert "generator:  nobody answers there now" in err
    assert "FV:6.1.0123: not what labctl knows as oscilloscope" in err
    assert "awg: nobody answers at its address" in out


def test_people_read_who_else_answers(
    addresses: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--scope", "simulated", "--address", addresses["scope"])
    _, out, _ = labctl(capsys, "init", tmp_path / "bench.toml", "--no-search", *words)
    assert f"{addresses['scope']} answers too: TEKTRONIX DPO72504DX" in out
