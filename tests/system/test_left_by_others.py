"""What a former user has left set at an instrument: a run sets it, and is the run of a bench that nobody touched."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from labctl.bench.station import SIMULATED_STATION, Station, write_addresses
from sim_backends.bench import SimulatedBench
from sim_backends.virtual.mso6b.instrument import VirtualMso6b
from tests.command_line import answer

SMALL = ("run", "image-readout", "--set", "images=4", "--set", "ports=2", "--set", "window=0.4 ns")
DPO, SIX = "tektronix-dpo72504dx", "tektronix-mso6b"
HEADERS = ("HEADer ON", "FACtory", "HEADer ON;:VERBose OFF")


@contextmanager
def bench(path: Path, driver: str = DPO, **left: str) -> Iterator[SimulatedBench]:
    """A bench with station file `path` and an oscilloscope of `driver`; what is `left` was sent to its instruments."""
    section = {"scope": {"driver": driver}}
    station = Station.model_validate(SIMULATED_STATION.model_dump(exclude_defaults=True) | section)
    with SimulatedBench(plugged_in={"scope": VirtualMso6b} if driver == SIX else {}) as found:
        write_addresses(path, {name: one["socket"] for name, one in found.resources.items()}, station)
        for name, messages in left.items():
            asked(found, name, f"{messages}\n*OPC?")
        yield found


def asked(found: SimulatedBench, name: str, messages: str) -> str:
    """What an instrument answers to the one question among messages of another client."""
    _, host, port, _ = found.resources[name]["socket"].split("::")
    with socket.create_connection((host, int(port)), timeout=20) as link, link.makefile("rb") as lines:
        link.sendall(f"{messages}\n".encode())
        return lines.readline().decode().strip()


def run(path: Path) -> None:
    """A run ends well."""
    words = (*SMALL, "--station", path, "--arm", "--out", path.with_name("run"), "--json")
    status, found, _ = answer(*words)
    assert (status, found.get("error")) == (0, None)


@pytest.mark.parametrize("driver", [DPO, SIX])
@pytest.mark.parametrize("left", HEADERS)
def test_an_oscilloscope_whose_replies_have_headers_is_understood(driver: str, left: str, tmp_path: Path) -> None:
    with bench(path := tmp_path / "bench.toml", driver, scope=left):
        run(path)


@pytest.mark.parametrize(
    ("driver", "setting", "others", "own"),
    [
        (DPO, "DESE", "0", "255"),
        (SIX, "DESE", "0", "255"),
        (DPO, "ACQuire:SYNcsamples", "ON", "0"),
        (DPO, "CH1:BANdwidth:ENHanced", "OFF", "AUTO"),
        (DPO, "CH1:VTERm:BIAS", "1.5", "0.0000000000E+00"),
    ],
)
def test_what_changes_records_or_hides_errors_is_set(
    driver: str, setting: str, others: str, own: str, tmp_path: Path
) -> None:
    with bench(path := tmp_path / "bench.toml", driver, scope=f"{setting} {others}") as found:
        run(path)
        assert asked(found, "scope", f"{setting}?") == own


@pytest.mark.parametrize("left", ["AMPLitude 0.5;OFFSet 1.15", "AMPLitude 0.9;OFFSet -0.95"])
def test_marker_levels_are_set_whatever_they_were(left: str, tmp_path: Path) -> None:
    marker = "SOURce1:MARKer1:VOLTage"
    with bench(path := tmp_path / "bench.toml", awg=f"{marker}:{left}") as found:
        run(path)
        levels = asked(found, "awg", f"{marker}:HIGH?;LOW?").split(";")
    assert [float(level) for level in levels] == [1.0, 0.0]


@pytest.mark.parametrize("left", HEADERS)
def test_open_questions_are_answered_by_an_oscilloscope_whose_replies_have_headers(left: str, tmp_path: Path) -> None:
    with bench(path := tmp_path / "bench.toml", scope=left):
        status, found, _ = answer("check", "--deep", "--station", path, "--json")
    assert (status, found.get("error")) == (0, None)
