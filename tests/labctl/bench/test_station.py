"""The station file and what it refuses."""

import os
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from instruments.alnair_tlg220 import Tlg220Section
from labctl.bench.station import read_station, toml, write_addresses
from labctl.errors import StationError


def write(folder: Path, text: str) -> Path:
    path = folder / "bench.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_without_a_file_the_bench_is_simulated() -> None:
    station = read_station(None)
    assert station.simulated
    assert station.wiring.burst


def test_units_are_understood(tmp_path: Path) -> None:
    text = """
    name = "room 2"
    [awg]
    address = "TCPIP0::192.0.2.1::inst0::INSTR"
    amplitude = "400 mVpp"
    [laser]
    power = "13 dBm"
    wavelength = "1551 nm"
    [patch_panel]
    ports = "2-6"
    [scope]
    trigger_source = "auxiliary"
    """
    station = read_station(write(tmp_path, text))
    assert station.awg.amplitude == pytest.approx(0.4)
    assert station.laser.power == pytest.approx(0.01995, rel=1e-3)
    assert station.patch_panel.ports == (2, 3, 4, 5, 6)
    assert station.scope.trigger_source == "AUX"
    assert station.source.endswith("bench.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[awg]\ncolour = 1", r"bench\.toml: awg\.colour = 1: unknown key"),
        ("[laser]\npower = '30 V'", r"laser\.power = '30 V': '30 V' is not in W: write it like '1 W'"),
        ("[scope]\nbandwidth = '-3 GHz'", r"scope\.bandwidth = '-3 GHz': Input should be greater than 0 Hz$"),
        ("[laser]\npower = '30'", r"laser\.power = '30': '30' has no unit"),
        ("[scope]\nchannels = [5]", r"scope\.channels\.0 = 5: "),
        ("[patch_panel]\nports = 'all'", r"patch_panel\.ports = 'all': 'all' is not a list of ports"),
        ("[awg\n", r"is not TOML"),
        ("[durability]\nshots = 0", r"durability\.shots = 0"),
        ("awg = 5", r"awg = 5: Input should be a valid dictionary"),
        ("[awg]\ndriver = 5", r"awg\.driver = 5: Input should be a valid string"),
        (
            "[awg]\ndriver = 'nothing'",
            r"bench\.toml: awg\.driver = 'nothing' is not installed: choose one of tektronix",
        ),
        ("[laser]\npower = 30", r"laser\.power = 30: has no unit: write it like '30 W'"),
        ("[limits]\ndetector = 1.5", r"limits\.detector = 1\.5: has no unit: write it like '1\.5 V'"),
        ("[awg]\nversion = '4.3'", r"awg\.version = '4\.3': unknown key"),
        ("[laser]\ndriver = 'manual-laser'\ntimeout = '5 s'", r"laser\.timeout = '5 s': unknown key"),
    ],
)
def test_what_is_wrong_is_named_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(StationError, match=message) as refused:
        read_station(write(tmp_path, text))
    assert "\n" not in str(refused.value)


def test_a_section_has_the_keys_of_its_driver_and_those_that_every_driver_once_took(tmp_path: Path) -> None:
    """Files of before say `commands` of a laser that is set by hand, `timeout` of fibres that are moved by hand."""
    text = """
    [laser]
    driver = "manual-laser"
    commands = "table.toml"
    [dmd]
    driver = "ti-dlpc900"
    version = "4.3"
    timeout = "5 s"
    [patch_panel]
    driver = "manual-patch-panel"
    timeout = "5 s"
    """
    station = read_station(write(tmp_path, text))
    said = station.model_dump(mode="json")
    assert said["laser"].keys() == {"driver", "address", "identity", "armed", "power", "wavelength"}
    assert said["dmd"] == {"driver": "ti-dlpc900", "address": "usb", "identity": None, "timeout": 5.0}
    assert said["patch_panel"].keys() == {"driver", "address", "identity", "ports", "bypass"}
    assert station.by_hand == ("laser", "patch_panel")


def test_files_of_an_instrument_are_beside_the_station_file(tmp_path: Path) -> None:
    for said, meant in (("table.toml", tmp_path / "table.toml"), ("/lab/table.toml", Path("/lab/table.toml"))):
        laser = read_station(write(tmp_path, f"[laser]\ncommands = '{said}'")).laser
        assert isinstance(laser, Tlg220Section)
        assert laser.commands == meant


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_a_pipe_is_refused(tmp_path: Path) -> None:
    """It is empty for whoever reads it again: a bench of which nothing is said is the simulated one."""
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(StationError, match=r"pipe: cannot be read \(it is no regular file\): name a station file"):
        read_station(tmp_path / "pipe")


def test_no_station_is_written_of_instruments_whose_driver_is_not_known(tmp_path: Path) -> None:
    """A recording has only their names."""
    with pytest.raises(StationError, match=r"not written: nothing says which driver amplifier, mine has: leave"):
        write_addresses(tmp_path / "station.toml", {"awg": "TCPIP::a::INSTR", "amplifier": "b", "mine": "c"})
    assert not list(tmp_path.iterdir())


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(StationError, match=r"nowhere\.toml: cannot be read"):
        read_station(tmp_path / "nowhere.toml")


def test_addresses_survive_the_file(tmp_path: Path) -> None:
    names = ("awg", "scope", "laser", "dmd", "patch_panel")
    addresses = {name: f"TCPIP0::127.0.0.1::{5000 + rank}::SOCKET" for rank, name in enumerate(names)}
    path = tmp_path / "served.toml"
    write_addresses(path, addresses)
    station = read_station(path)
    assert station.addresses == addresses
    assert isinstance(station.laser, Tlg220Section)
    assert str(station.laser.commands) == "simulated"
    assert station.laser.armed
    assert not station.simulated
    with pytest.raises(StationError, match="name a new file"):
        write_addresses(path, addresses)


@given(st.text(alphabet=st.characters(exclude_categories=["Cs"])))
def test_any_text_is_written_as_toml_reads_it(text: str) -> None:
    assert tomllib.loads(f"text = {toml(text)}") == {"text": text}


def test_a_saved_station_says_all_that_its_bench_said(tmp_path: Path) -> None:
    text = """
    name = "twin of \\"room 2\\""
    [laser]
    power = "10 mW"
    commands = "table.toml"
    [patch_panel]
    ports = "0,2-6"
    [wiring]
    projector = false
    [durability]
    seconds = 0.5
    [sim]
    twin_seed = 3
    parameters = { enob = 4.5, shared_reference = false }
    """
    said = read_station(write(tmp_path, text))
    addresses = {name: f"TCPIP0::127.0.0.1::{5000 + rank}::SOCKET" for rank, name in enumerate(said.addresses)}
    path = tmp_path / "served.toml"
    write_addresses(path, addresses, said)
    saved = read_station(path)
    assert saved.addresses == addresses
    assert isinstance(saved.laser, Tlg220Section)
    assert saved.laser.commands == tmp_path / "table.toml"
    for section in ("name", "wiring", "limits", "durability", "sim"):
        assert getattr(saved, section) == getattr(said, section)
    assert saved.patch_panel.ports == said.patch_panel.ports
    assert saved.laser.power == said.laser.power


def test_instruments_that_are_set_by_hand_need_no_address(tmp_path: Path) -> None:
    address = 'address = "TCPIP0::192.0.2.1::inst0::INSTR"'
    instruments = "".join(f"[{name}]\n{address}\n" for name in ("awg", "scope", "dmd"))
    by_hand = '[laser]\ndriver = "manual-laser"\n[patch_panel]\ndriver = "manual-patch-panel"\n'
    assert not read_station(write(tmp_path, instruments + by_hand)).simulated
    partly = read_station(write(tmp_path, by_hand))
    assert partly.simulations == ("awg", "scope", "dmd")
    assert not partly.wholly_simulated
