"""A run or a station that somebody else has made: nothing is opened, nothing is written, no light, one line."""

import hashlib
import json
import os
import re
import shutil
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import h5py
import pytest

from instruments.vialux_alp import LIBRARY_VARIABLE
from labctl.bench.signals import Interruption
from labctl.bench.station import USUAL, read_station, write_addresses
from labctl.engine.session import Acquisition, acquire
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import manifest_digest
from labctl.runs.format.plain_hdf5 import set_text
from labctl.runs.verification import verify_run
from protocols.registry import read_protocol
from sim_backends.bench import SimulatedBench
from tests import command_line
from tests.observers import Follower
from tests.system.conftest import without_arm

SETTINGS = ("images=6", "window=0.4 ns", "ports=2")

Labctl = Callable[..., tuple[int, dict[str, Any]]]
Edit = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def simulation() -> Iterator[SimulatedBench]:
    with SimulatedBench() as bench:
        yield bench


@pytest.fixture(scope="module")
def own(simulation: SimulatedBench, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """This bench's station."""
    path = tmp_path_factory.mktemp("own") / "bench.toml"
    write_addresses(path, {role: found["socket"] for role, found in simulation.resources.items()})
    return path


@pytest.fixture(scope="module")
def begun(own: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was stopped after some records."""
    directory, interruption = tmp_path_factory.mktemp("begun") / "run", Interruption()

    def stop(done: int, _total: int) -> None:
        interruption.requested = done == 3

    asked = read_protocol("image-readout", list(SETTINGS))
    acquire(Acquisition(asked, read_station(own), directory), interruption=interruption, observer=Follower(stop))
    return directory


@pytest.fixture
def run(begun: Path, tmp_path: Path) -> Path:
    return shutil.copytree(begun, tmp_path / "run")


class Listening:
    """Addresses at which nobody must connect."""

    def __init__(self, stack: ExitStack) -> None:
        self._sockets = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in USUAL]
        for listener in self._sockets:
            listener.settimeout(0)
        ports = [listener.getsockname()[1] for listener in self._sockets]
        self.addresses = {role: f"TCPIP0::127.0.0.1::{port}::SOCKET" for role, port in zip(USUAL, ports, strict=True)}

    def connections(self) -> int:
        found = 0
        for listener in self._sockets:
            with suppress(BlockingIOError):
                listener.accept()[0].close()
                found += 1
        return found


@pytest.fixture
def listening() -> Iterator[Listening]:
    with ExitStack() as stack:
        yield Listening(stack)


def edit(run: Path, change: Edit, *, skilfully: bool = False) -> None:
    """Change the manifest; `skilfully`: and whatever in the run would tell that."""
    paths = RunPaths(run)
    manifest = json.loads(paths.manifest.read_text())
    change(manifest)
    if skilfully:
        with h5py.File(paths.plan, "r+") as plan:
            del plan.attrs["manifest_sha256"]
            set_text(plan, "manifest_sha256", manifest_digest(manifest))
        manifest["plan_sha256"] = hashlib.sha256(paths.plan.read_bytes()).hexdigest()
        paths.data.unlink(missing_ok=True)
    paths.manifest.write_text(json.dumps(manifest))


def content(directory: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(directory.rglob("*")) if path.is_file()}


def refused(labctl: Labctl, capsys: pytest.CaptureFixture[str], directory: Path, *command: object) -> str:
    """The one line of a command that wrote nothing and asked for what is wrong."""
    before = content(directory)
    status, out, err = command_line.labctl(capsys, *command)
    assert (status, out) == (2, ""), err
    assert re.fullmatch(r"labctl: [^\n]+\n", err)
    assert content(directory) == before
    return err


def elsewhere(listening: Listening, source: Path) -> Edit:
    """All that a stranger might want: armed, more power than anybody allows, and other instruments."""

    def change(manifest: dict[str, Any]) -> None:
        station = manifest["station"]
        station["source"] = str(source)
        station["laser"] |= {"armed": True, "power": 0.2}
        station["limits"]["optical_power"] = 1.0
        for role, address in listening.addresses.items():
            station[role]["address"] = address

    return change


def strangers_station(path: Path, listening: Listening) -> Path:
    """The same in words, as an archive brings it along."""
    write_addresses(path, listening.addresses)
    text = path.read_text().replace("[laser]\n", "[laser]\npower = '200 mW'\n")
    path.write_text(text + "\n[limits]\noptical_power = '1 W'\n")
    return path


@pytest.mark.parametrize("brings_its_station", [False, True])
def test_a_strangers_run_has_no_bench(
    brings_its_station: bool,
    run: Path,
    listening: Listening,
    labctl: Labctl,
    capsys: pytest.CaptureFixture[str],
) -> None:
    station = run.parent / "stranger.toml"
    if brings_its_station:
        strangers_station(station, listening)
    edit(run, elsewhere(listening, station), skilfully=True)
    assert verify_run(run).intact, "nothing in the run itself tells"
    for words in ((), ("--arm",), ("--arm", "--attended")):
        told = refused(labctl, capsys, run, "resume", run, *words)
        assert "name the station of this bench by --station" in told
    assert listening.connections() == 0


def test_on_this_bench_a_strangers_power_is_another_setting(
    run: Path, own: Path, listening: Listening, labctl: Labctl, simulation: SimulatedBench
) -> None:
    edit(run, elsewhere(listening, run.parent / "stranger.toml"), skilfully=True)
    before = content(run)
    status, told = labctl("resume", run, "--station", own)
    assert (status, told["differences"]) == (2, [{"setting": "station laser.power", "then": 0.2, "now": 0.03}])
    assert content(run) == before
    assert listening.connections() == 0
    assert simulation.world._emission is None


def test_limits_and_arm_are_those_of_this_bench(
    run: Path, own: Path, labctl: Labctl, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    unarmed = without_arm(own, tmp_path)
    assert "unarmed.toml: the laser is not armed" in labctl("resume", run, "--station", unarmed)[1]["error"]
    careful = tmp_path / "careful.toml"
    careful.write_text(own.read_text() + "\n[limits]\noptical_power = '10 mW'\n")
    status, told = labctl("resume", run, "--station", careful)
    assert status == 2
    assert re.search(r"laser\.power.*exceeds|optical_power", told["error"])


def arm(manifest: dict[str, Any]) -> None:
    manifest["station"]["laser"]["armed"] = False


def raise_power(manifest: dict[str, Any]) -> None:
    manifest["station"]["laser"]["power"] = 0.2


def raise_limit(manifest: dict[str, Any]) -> None:
    manifest["station"]["limits"]["optical_power"] = 1.0


def add_a_note(manifest: dict[str, Any]) -> None:
    manifest["note"] = "mine"


def ask_for_more(manifest: dict[str, Any]) -> None:
    manifest["protocol"]["settings"]["averages"] = 1_000_000


@pytest.mark.parametrize("change", [arm, raise_power, raise_limit, add_a_note, ask_for_more])
@pytest.mark.parametrize("older", [False, True])
def test_an_edited_manifest_is_refused(
    change: Edit, older: bool, run: Path, own: Path, labctl: Labctl, capsys: pytest.CaptureFixture[str]
) -> None:
    if older:  # what a labctl wrote that kept a copy of the manifest in data.h5 only
        make_older(run)
    edit(run, change)
    for words in ((), ("--station", own)):
        assert "manifest.json: edited since the run was begun" in refused(labctl, capsys, run, "resume", run, *words)
    report = verify_run(run)
    assert not report.intact
    assert report.damaged is not None
    assert report.damaged.file in ("manifest.json", "data.h5")


def test_a_manifest_that_is_only_written_otherwise_is_the_same(run: Path, labctl: Labctl) -> None:
    paths = RunPaths(run)
    manifest = json.loads(paths.manifest.read_text())
    paths.manifest.write_text(json.dumps(dict(sorted(manifest.items()))))
    assert verify_run(run).intact
    assert labctl("resume", run)[1]["complete"]


def make_older(run: Path) -> None:
    paths = RunPaths(run)
    with h5py.File(paths.plan, "r+") as plan:
        del plan.attrs["manifest_sha256"]
    manifest = json.loads(paths.manifest.read_text())
    manifest["plan_sha256"] = hashlib.sha256(paths.plan.read_bytes()).hexdigest()
    paths.manifest.write_text(json.dumps(manifest))
    with h5py.File(paths.data, "r+") as data:
        del data.attrs["manifest"]
        set_text(data, "manifest", json.dumps(manifest))


def test_the_station_that_a_run_was_begun_with_must_be_what_it_was(
    begun: Path, own: Path, simulation: SimulatedBench, labctl: Labctl, tmp_path: Path
) -> None:
    station = tmp_path / "bench.toml"
    shutil.copy(own, station)
    interruption = Interruption()

    def stop(_done: int, _total: int) -> None:
        interruption.requested = True

    acquire(
        Acquisition(read_protocol("image-readout", list(SETTINGS)), read_station(station), tmp_path / "run"),
        interruption=interruption,
        observer=Follower(stop),
    )
    station.write_text(station.read_text() + "\n[limits]\noptical_power = '1 W'\n")
    status, told = labctl("resume", tmp_path / "run")
    assert status == 2
    assert "bench.toml' as it is now: name the station of this bench by --station" in told["error"]
    station.unlink()
    os.mkfifo(station)
    assert labctl("resume", tmp_path / "run")[0] == 2
    station.unlink()
    shutil.copy(own, station)
    assert labctl("resume", tmp_path / "run")[1]["complete"]
    assert simulation.world._emission is None


@pytest.mark.parametrize("command", [("check",), ("run", "image-readout", "--dry-run"), ("run", "image-readout")])
def test_a_station_loads_no_code(
    command: tuple[str, ...],
    listening: Listening,
    labctl: Labctl,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    station, folder = tmp_path / "station.toml", tmp_path / "library"
    folder.mkdir()
    write_addresses(station, listening.addresses | {"dmd": "usb"})
    station.write_text(station.read_text().replace("[dmd]\n", f'[dmd]\nlibrary = "{folder}"\n'))
    for allowed in (None, "", str(tmp_path)):
        if allowed is not None:
            monkeypatch.setenv(LIBRARY_VARIABLE, allowed)
        told = refused(labctl, capsys, tmp_path, *command, "--station", station)
        assert f"station.toml: dmd.library = '{folder}': " in told
        assert LIBRARY_VARIABLE in told
    assert listening.connections() == 0
    monkeypatch.setenv(LIBRARY_VARIABLE, str(folder))
    assert read_station(station).dmd.address == "usb"


def test_a_run_loads_no_code(
    run: Path, own: Path, labctl: Labctl, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def change(manifest: dict[str, Any]) -> None:
        manifest["station"]["dmd"] |= {"address": "usb", "library": str(tmp_path)}

    edit(run, change, skilfully=True)
    assert "--station" in refused(labctl, capsys, run, "resume", run)
    assert labctl("resume", run, "--station", own)[1]["complete"], "on this bench's own DMD"
