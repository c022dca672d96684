"""`labctl check` over sockets: something is wrong with one instrument, and the others are checked all the same."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from labctl.bench.station import read_station, write_addresses
from sim_backends.faults.bench import Befalling, FaultyBench
from sim_backends.faults.catalogue import QUEUE, START, WIRE, Fault, Moment
from sim_backends.faults.distortions import instead
from tests.command_line import labctl

ROLES = ("awg", "scope", "laser", "dmd", "patch_panel")
QUICKLY_TESTED = ("scope", "laser", "dmd", "patch_panel")
NOBODY, START_OF_ALL = START["nobody there"], Moment("", 0)
TEST_FAILED = Fault("the self-test fails", answers={"*TST?": instead(b"3")})


@contextmanager
def station_of(bench: FaultyBench, path: Path) -> Iterator[Path]:
    with bench:
        write_addresses(path, {name: found["socket"] for name, found in bench.resources.items()})
        text = path.read_text("utf-8")
        path.write_text(text.replace("[awg]\n", "[awg]\ntimeout = '0.3 s'\n"), "utf-8")
        yield path


def checked(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, dict[str, Any]]:
    status, out, err = labctl(capsys, "check", "--station", path, "--json", *options)
    assert bool(err) == ("--deep" in options)
    return status, json.loads(out)


def with_fault(
    role: str, fault: Fault, moment: Moment, folder: Path, capsys: pytest.CaptureFixture[str], *options: str
) -> dict[str, Any]:
    """What `labctl check` finds at the instrument with the fault; everything else must be well."""
    with station_of(FaultyBench([Befalling(role, fault, moment)]), folder / "bench.toml") as path:
        status, found = checked(path, capsys, *options)
    assert status == 1
    assert not found["ok"]
    assert {name for name, finding in found["instruments"].items() if not finding["ok"]} == {role}
    assert all(found["instruments"][name]["self_test"] == "passed" for name in QUICKLY_TESTED if name != role)
    broken: dict[str, Any] = found["instruments"][role]
    return broken


def test_everything_is_told_of_a_bench_that_is_well(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with station_of(FaultyBench([]), tmp_path / "bench.toml") as path:
        status, found = checked(path, capsys)
    assert (status, found["ok"]) == (0, True)
    awg = found["instruments"]["awg"]
    assert awg["address"].startswith("TCPIP0::127.0.0.1::")
    assert (awg["manufacturer"], awg["model"], awg["firmware"]) == ("TEKTRONIX", "AWG70002A", "FV:6.1.0123")
    assert (awg["options"], awg["self_test"], awg["errors"]) == ("03,225", "not run", [])
    assert awg["limits"]["amplitude"] == {"low": 0.25, "high": 0.5, "unit": "Vpp"}
    assert awg["limits"]["awg.amplitude"]["high"] == 0.5
    assert found["instruments"]["scope"]["options"].startswith("STD")
    assert found["instruments"]["laser"]["limits"]["wavelength"]["unit"] == "nm"
    assert found["instruments"]["laser"]["limits"]["laser.power"] == {"low": 0.0, "high": 0.03, "unit": "W"}
    assert list(found["instruments"]) == ["laser", "awg", "dmd", "scope", "patch_panel"]


@pytest.mark.parametrize("role", ROLES)
def test_one_that_is_not_there_keeps_no_other_from_being_checked(
    role: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = with_fault(role, NOBODY, START_OF_ALL, tmp_path, capsys)
    assert found["identity"] == ""
    assert found["self_test"] == "not run"
    assert found["address"] in found["problem"]
    assert "check address, cable and power" in found["problem"]


def test_one_that_stops_answering(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = with_fault("awg", WIRE["dead"], Moment("*OPT?"), tmp_path, capsys)
    assert "AWG70002A" in found["identity"]
    assert "did not answer in time (at '*OPT?')" in found["problem"]


def test_a_self_test_of_minutes_is_run_when_somebody_asks_for_it_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with station_of(FaultyBench([]), tmp_path / "bench.toml") as path:
        status, out, err = labctl(capsys, "check", "--station", path, "--json", "--deep")
    found = json.loads(out)["instruments"]
    assert status == 0
    assert {found[role]["self_test"] for role in ROLES} == {"passed"}
    assert err == "awg: tests itself, which may take 20 minutes; Ctrl-C stops waiting for it\n"


HEEDING_CTRL_C = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell turns it off for what it starts behind
from labctl.commands.main import main
main(sys.argv[1:])
"""


def test_whoever_does_not_want_to_wait_for_it_stops(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    silent = Befalling("awg", WIRE["no reply"], Moment("*TST?"))
    with station_of(FaultyBench([silent]), tmp_path / "bench.toml") as path:
        command = (sys.executable, "-c", HEEDING_CTRL_C, "check", "--deep", "--station", str(path))
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None
            told = process.stderr.readline()
            process.send_signal(signal.SIGINT)
            _, rest = process.communicate(timeout=60)
        assert told.startswith("awg: tests itself")
        assert process.returncode == 130
        assert rest.count("\n") <= 1
        assert "Traceback" not in rest
        assert checked(path, capsys)[0] == 0, "nothing is left behind"


@pytest.mark.parametrize("role", ["awg", "scope"])
def test_one_whose_self_test_fails(role: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = with_fault(role, TEST_FAILED, Moment("*IDN?"), tmp_path, capsys, "--deep")
    assert (
        found["self_test"] == found["problem"] == f"{role}: self-test failed with code 3: see the instrument's screen"
    )


@pytest.mark.parametrize(
    ("role", "header"), [("awg", "*IDN?"), ("scope", "*IDN?"), ("laser", "*IDN?"), ("patch_panel", "*IDN?")]
)
def test_what_the_error_queue_held_is_told_once(
    role: str, header: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with station_of(
        FaultyBench([Befalling(role, QUEUE["error queued"], Moment(header))]), tmp_path / "bench.toml"
    ) as path:
        status, found = checked(path, capsys)
        assert status == 1
        assert "injected" in " ".join(found["instruments"][role]["errors"])
        assert found["instruments"][role]["self_test"] == ("not run" if role == "awg" else "passed")
        assert "repeat the check" in found["instruments"][role]["problem"]
        assert checked(path, capsys)[0] == 0


def test_a_driver_whose_library_is_missing_is_one_instrument_that_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bench.toml"
    path.write_text("mixed = true\n[dmd]\naddress = 'usb'\n", encoding="utf-8")
    status, found = checked(path, capsys)
    assert status == 1
    assert found["instruments"]["dmd"]["problem"].startswith("dmd: ")
    assert "labctl[alp]" in found["instruments"]["dmd"]["problem"] or find_spec("ALP4")
    assert found["instruments"]["awg"]["ok"]


def test_a_level_above_its_limit_is_refused_before_anything_is_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bench.toml"
    path.write_text("[laser]\npower = '40 mW'\n", encoding="utf-8")
    status, _, err = labctl(capsys, "check", "--station", path)
    assert status == 2
    assert "laser.power = 40 mW exceeds limits.optical_power" in err


def test_people_read_addresses_options_limits_and_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with station_of(FaultyBench([Befalling("scope", NOBODY, START_OF_ALL)]), tmp_path / "bench.toml") as path:
        status, out, _ = labctl(capsys, "check", "--station", path)
    assert status == 1
    assert "FAILS" in out
    assert "03,225" in out
    assert "0.25 to 0.5" in out
    assert out.count("self-test passed") == 3
    assert "awg: self-test not run (it may take 20 minutes: labctl check --deep), no errors queued" in out
    (told,) = [line for line in out.splitlines() if line.startswith("scope at ")]
    assert told.endswith("check address, cable and power")


def test_an_instrument_at_anothers_address_is_refused_and_one_that_only_reads_otherwise_can_be_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with station_of(FaultyBench([]), tmp_path / "bench.toml") as path:
        text = path.read_text("utf-8")
        station = read_station(path)
        awg, scope = station.awg.address, station.scope.address
        path.write_text(text.replace(awg, "@").replace(scope, awg).replace("@", scope), "utf-8")
        status, found = checked(path, capsys)
        assert status == 1
        assert {name for name, finding in found["instruments"].items() if not finding["ok"]} == {"awg", "scope"}
        assert found["instruments"]["awg"]["model"] == "DPO72504DX"
        assert (
            "is 'TEKTRONIX DPO72504DX', which driver 'tektronix-awg70002a' is not for"
            in (found["instruments"]["awg"]["problem"])
        )
        run = ("run", "image-readout", "--set", "images=4", "--station", path, "--out", tmp_path / "run")
        status, _, err = labctl(capsys, *run)
        assert status == 1
        assert "correct awg.address" in err or "correct scope.address" in err
        assert not (tmp_path / "run").exists()

        for named, well in (("dpo72504", True), ("DPO7000", False)):
            path.write_text(text.replace("[scope]\n", f"[scope]\nidentity = '{named}'\n"), "utf-8")
            assert checked(path, capsys)[1]["instruments"]["scope"]["ok"] == well


@pytest.mark.parametrize("other", ["awg", "scope", "laser", "patch_panel"])
def test_another_instrument_at_the_dmds_address_is_sent_nothing_that_it_would_keep_as_an_error(
    other: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with station_of(FaultyBench([]), tmp_path / "bench.toml") as path:
        text = path.read_text("utf-8")
        station = read_station(path)
        path.write_text(text.replace(station.dmd.address, station.section_of(other).address), "utf-8")
        _, found = checked(path, capsys)
        assert "which driver 'vialux-alp' is not for: correct dmd.address" in found["instruments"]["dmd"]["problem"]
        status, _, err = labctl(capsys, "align", "--station", path, "--out", tmp_path / "aligned")
        assert status == 1
        assert "correct dmd.address" in err
        path.write_text(text, "utf-8")
        status, found = checked(path, capsys)
        assert (status, found["ok"]) == (0, True), found


def test_what_a_person_sets_is_at_no_address(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bench.toml"
    path.write_text("[laser]\ndriver = 'manual-laser'\n[patch_panel]\ndriver = 'manual-patch-panel'\n", "utf-8")
    status, found = checked(path, capsys, "--attended")
    at = {name: told["address"] for name, told in found["instruments"].items()}
    assert (status, at) == (0, dict.fromkeys(ROLES, "simulated") | {"laser": "by hand", "patch_panel": "by hand"})
