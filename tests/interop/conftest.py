"""A served bench for drivers nobody here wrote: `labctl sim serve` in a process and an environment of its own."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.truth.served import served

TRANSPORTS = ("socket", "hislip", "vxi11")
TIMEOUT_MS = 10_000

Resources = dict[str, dict[str, str]]
Open = Callable[[str], Any]


@pytest.fixture(scope="session")
def resources() -> Iterator[Resources]:
    """Addresses of a bench."""
    with served() as addresses:
        yield addresses


@pytest.fixture(scope="session")
def resources_with_dlpc900(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Resources]:
    """Addresses of a bench whose DMD is a DLPC900."""
    station: Path = tmp_path_factory.mktemp("station") / "bench.toml"
    station.write_text("[dmd]\ndriver = 'ti-dlpc900'\naddress = 'simulated'\n")
    with served("--station", str(station)) as addresses:
        yield addresses


@pytest.fixture(scope="session")
def resources_with_mso6b(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Resources]:
    """Addresses of a bench whose oscilloscope is a 6 Series B."""
    station: Path = tmp_path_factory.mktemp("station") / "bench.toml"
    station.write_text("[scope]\ndriver = 'tektronix-mso6b'\n")
    with served("--station", str(station)) as addresses:
        yield addresses


@pytest.fixture(params=TRANSPORTS)
def transport(request: pytest.FixtureRequest, resources: Resources) -> str:
    """One transport after the other; those the bench does not serve are skipped."""
    name: str = request.param
    if name not in resources["awg"]:
        pytest.skip(f"the bench serves no {name} addresses")
    return name


@pytest.fixture
def visa(resources: Resources) -> Iterator[Open]:
    """Plain PyVISA sessions: `visa(address)`, lines ending in a newline both ways."""
    pyvisa = pytest.importorskip("pyvisa")
    manager = pyvisa.ResourceManager("@py")
    opened = []

    def open_address(address: str) -> Any:
        session = manager.open_resource(address, read_termination="\n", write_termination="\n", timeout=TIMEOUT_MS)
        opened.append(session)
        return session

    yield open_address
    for session in opened:
        session.close()
    manager.close()


@pytest.fixture
def lit(resources: Resources, visa: Open) -> Iterator[None]:
    """Light on the detectors: laser on, half the mirrors towards the fibre, ports 2 and 3 on channels 1 and 2."""
    laser, dmd, switch = (visa(resources[name]["socket"]) for name in ("laser", "dmd", "patch_panel"))
    laser.write("*RST;POWER 14.8;OUTPUT ON")
    while laser.query("SETTLED?") != "1":
        pass
    switch.write("ROUTe:CLOSe (@1!2,2!3)")
    dmd.query("*RST;*OPC?")
    assert dmd.query("ALP:DEVALLOC") == "0"
    sequence = dmd.query("ALP:SEQALLOC 1,1").removeprefix("0,")
    for line in ("SEQCONTROL {},2110,2", "SEQCONTROL {},2104,2106", "SEQTIMING {},0,0,0,0,0"):
        assert dmd.query("ALP:" + line.format(sequence)) == "0"
    half = (b"\xff" * 128 + b"\x00" * 128) * 384
    dmd.write_raw(f"ALP:SEQPUT {sequence},0,1,#598304".encode() + half + b"\n")
    assert dmd.read() == "0"
    assert dmd.query(f"ALP:PROJSTARTCONT {sequence}") == "0"
    yield
    laser.query("OUTPUT OFF;*OPC?")


@pytest.fixture
def fresh(resources: Resources, visa: Open) -> None:
    """The AWG and the oscilloscope as after `*RST`, their queues empty."""
    for name in ("awg", "scope"):
        assert visa(resources[name]["socket"]).query("*RST;*CLS;*OPC?") == "1"


def port(address: str) -> int:
    """The TCP port in an address of any transport."""
    found = re.search(r"(?:127\.0\.0\.1::|hislip0,)(\d+)", address)
    assert found is not None, address
    return int(found[1])
