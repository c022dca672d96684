"""Commands with the DMD at `address = "usb"`: ALP4lib from the registry, with the simulated DMD behind it."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from labctl.bench.station import SIMULATED_STATION, Station, write_addresses
from labctl.runs.read.run import open_run
from sim_backends.bench import SimulatedBench
from sim_backends.faults.bench import Befalling, FaultyBench
from sim_backends.faults.catalogue import WIRE, Moment
from sim_backends.virtual.alp.instrument import SERIAL
from tests.alp_shared_library import SharedLibrary, in_place_of_the_vendors
from tests.command_line import as_json
from tests.faults.matrix import SMALL, TIMEOUT_S, short_waits

RUN = ("run", "image-readout", "--set", "images=8", "--set", "ports=2,3", "--set", "window=0.4 ns")
TIMINGS = ("software", "burst")


@contextmanager
def wired(folder: Path, simulated: SimulatedBench, **keys: Any) -> Iterator[tuple[Path, SharedLibrary]]:
    """A station file with the DMD of a simulated bench at the end of a USB cable, and what stands for the library."""
    path = folder / "usb.toml"
    station = Station.model_validate(SIMULATED_STATION.model_dump(exclude_defaults=True) | {"dmd": keys})
    with simulated, short_waits():
        served = {role: found["socket"] for role, found in simulated.resources.items()}
        write_addresses(path, served | {"dmd": "usb"}, station)
        with in_place_of_the_vendors(served["dmd"], timeout_s=TIMEOUT_S) as library:
            yield path, library


def test_check_prints_one_json_object(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with wired(tmp_path, SimulatedBench(SMALL), serial_number=SERIAL) as (station, library):
        status, found = as_json(capfd, "check", "--station", station)
    assert status == 0
    assert found["instruments"]["dmd"]["self_test"] == "passed"
    assert found["instruments"]["dmd"]["serial"] == str(SERIAL)
    assert library.called[-1] == "AlpDevFree"


def test_another_serial_number_is_told(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with wired(tmp_path, SimulatedBench(SMALL), serial_number=SERIAL + 1) as (station, _):
        status, found = as_json(capfd, "check", "--station", station)
    assert status == 1
    assert "dmd.serial_number" in found["instruments"]["dmd"]["problem"]


@pytest.mark.parametrize("timing", TIMINGS)
def test_a_run_gives_the_bytes_of_one_over_the_network(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], timing: str
) -> None:
    digests = []
    for name in ("usb", "network"):
        folder, bench = tmp_path / name, SimulatedBench(SMALL)
        folder.mkdir()
        with wired(folder, bench) as (station, library):
            if name == "network":
                station = folder / "network.toml"
                write_addresses(station, {role: found["socket"] for role, found in bench.resources.items()})
            words = ("--set", f"timing={timing}", "--station", station, "--out", folder / "run")
            status, found = as_json(capfd, *RUN, *words)
        assert status == 0, found
        assert bool(library.called) is (name == "usb")
        digests.append(found["frames_sha256"])
    assert digests[0] == digests[1]


@pytest.mark.parametrize("fault", ["lost before", "unheard", "no reply", "power blink"])
def test_a_run_goes_on_when_the_cable_was_pulled(tmp_path: Path, capfd: pytest.CaptureFixture[str], fault: str) -> None:
    with wired(tmp_path, FaultyBench([Befalling("dmd", WIRE[fault], Moment("ALP:SEQPUT", 11))], SMALL)) as (station, _):
        status, found = as_json(capfd, *RUN, "--station", station, "--out", tmp_path / "run")
    assert status == 0, json.dumps(found)
    assert found["recovered"] == 1
    with open_run(tmp_path / "run") as run:
        assert run.complete
