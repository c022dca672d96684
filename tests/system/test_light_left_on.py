"""Light that somebody has left on: it is told, and goes off before anything is set, whatever becomes of the run."""

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from labctl.bench.station import SIMULATED_STATION, Station, write_addresses
from sim_backends.bench import SimulatedBench
from sim_backends.faults.bench import Befalling, FaultyBench
from sim_backends.faults.catalogue import Arrival, Fault, Moment
from sim_backends.virtual.amplifier.instrument import VirtualAmplifier
from sim_backends.virtual.attenuator.instrument import VirtualAttenuator
from tests.command_line import answer

SMALL = ("run", "image-readout", "--set", "images=4", "--set", "ports=2", "--set", "window=0.4 ns")
LIGHT = ("attenuator", "amplifier", "laser")
LEFT_ON = {"laser": "POWER 16.0\nOUTPUT ON\n", "amplifier": "OUTPut ON\n", "attenuator": "OUTPut ON\n"}
NOBODY = "TCPIP0::127.0.0.1::9::SOCKET"


@pytest.fixture
def bench() -> Iterator[SimulatedBench]:
    """As somebody at the front panels has left it."""
    with SimulatedBench(plugged_in={"amplifier": VirtualAmplifier, "attenuator": VirtualAttenuator}) as bench:
        assert [is_on(bench, name, LEFT_ON[name]) for name in LIGHT] == [True] * 3
        yield bench


def is_on(bench: SimulatedBench, name: str, said: str = "") -> bool:
    _, host, port, _ = bench.resources[name]["socket"].split("::")
    with socket.create_connection((host, int(port)), timeout=20) as link, link.makefile("rb") as lines:
        link.sendall(f"{said}OUTPut?\n".encode())
        return lines.readline().strip() == b"1"


def station(bench: SimulatedBench, path: Path, **instead: str) -> Path:
    section: dict[str, Any] = {"amplifier": {"driver": "table-amplifier", "commands": "simulated", "power": "100 mW"}}
    section |= {"attenuator": {"driver": "table-attenuator", "commands": "simulated", "attenuation_db": 9.0}}
    whole = Station.model_validate(SIMULATED_STATION.model_dump(exclude_defaults=True) | section)
    write_addresses(path, {name: found["socket"] for name, found in bench.resources.items()} | instead, whole)
    return path


def test_it_goes_off_before_anything_is_set(bench: SimulatedBench, tmp_path: Path) -> None:
    words = (*SMALL, "--station", station(bench, tmp_path / "bench.toml"), "--arm", "--out", tmp_path / "run")
    assert answer(*words, "--json")[0] == 0
    log = (tmp_path / "run" / "commands.log").read_text("utf-8")
    sent = ("attenuator OUTPut OFF", "amplifier OUTPut OFF", "laser OUTPUT OFF", "laser POWER", "laser OUTPUT ON")
    places = [log.index(f"> {message}") for message in sent]
    assert places == sorted(places)
    assert places[2] < log.index("> awg "), "nobody else is asked before"


def test_it_goes_off_where_another_instrument_ends_the_run(bench: SimulatedBench, tmp_path: Path) -> None:
    file = station(bench, tmp_path / "bench.toml", dmd=NOBODY)
    status, found, _ = answer(*SMALL, "--station", file, "--arm", "--out", tmp_path / "run", "--json")
    assert status == 1
    assert "dmd" in found["error"]
    assert not any(is_on(bench, name) for name in LIGHT)


@pytest.mark.parametrize("away", LIGHT)
def test_it_goes_off_where_one_of_them_is_not_there(away: str, bench: SimulatedBench, tmp_path: Path) -> None:
    file = station(bench, tmp_path / "bench.toml", **{away: NOBODY})
    status, found, _ = answer(*SMALL, "--station", file, "--arm", "--out", tmp_path / "run", "--json")
    assert status == 1
    assert found["error"].startswith(f"{away} at {NOBODY} cannot be reached")
    assert [is_on(bench, name) for name in LIGHT] == [name == away for name in LIGHT]


def test_a_laser_that_stays_on_is_told_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("labctl.bench.lock.DARK_WITHIN_S", 0.0)
    deaf = Befalling("laser", Fault("the link ends at OUTPUT OFF", Arrival.LOST), Moment("OUTPUT", 2, times=1000))
    with FaultyBench([deaf]) as bench:
        assert is_on(bench, "laser", LEFT_ON["laser"])
        file = tmp_path / "bench.toml"
        write_addresses(file, {name: found["socket"] for name, found in bench.resources.items()})
        status, found, _ = answer(*SMALL, "--station", file, "--out", tmp_path / "run", "--json")
        assert status == 1
        assert "the laser may still emit, switch it off by its key switch" in found["error"]
        assert bench.world._emission is not None
        status, found, _ = answer("check", "--station", file, "--json")
        assert (status, "its supervisor still tries to switch the laser off" in found["error"]) == (1, True)


def test_it_is_told_by_the_check(bench: SimulatedBench, tmp_path: Path) -> None:
    file = station(bench, tmp_path / "bench.toml")
    status, found, _ = answer("check", "--station", file, "--json")
    assert (status, found["instruments"]["laser"]["emits"]) == (0, True)
    assert found["instruments"]["awg"]["emits"] is None
    assert is_on(bench, "laser"), "a check changes nothing"
    is_on(bench, "laser", "OUTPUT OFF\n")
    assert answer("check", "--station", file, "--json")[1]["instruments"]["laser"]["emits"] is False
