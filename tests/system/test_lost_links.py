"""A connection that is cut in the middle of a run: the run goes on, or it ends dark with what it had."""

import contextlib
import json
import re
import selectors
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labctl.bench.opening import opened
from labctl.bench.station import read_station, write_addresses
from labctl.runs.live.logs import CommandLog
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from sim_backends.bench import SimulatedBench
from sim_backends.world.signals import Acquisition, Emission
from tests.command_line import as_json, labctl

RUN = ("run", "image-readout", "--set", "images=20", "--set", "window=0.8 ns")
SHOTS = 22


class Proxy:
    """Carries bytes between a driver and an instrument, and cuts the connection at chosen bytes of the replies."""

    def __init__(self, address: str, cuts: Sequence[int] = (), *, heals: bool = True) -> None:
        """`cuts` count the bytes of all replies so far; without `heals` the first cut is for ever."""
        self.replied = 0
        self._cuts = list(cuts)
        self._heals = heals
        self._port = int(address.split("::")[2])
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"TCPIP0::127.0.0.1::{self._listener.getsockname()[1]}::SOCKET"
        threading.Thread(target=self._serve, daemon=True).start()

    def cut(self) -> None:
        """Cut the connection now, while nothing is being said."""
        self._driver.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        with contextlib.suppress(OSError):  # not connected: that alone wakes the thread that accepts
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _serve(self) -> None:
        while True:
            try:
                driver, _ = self._listener.accept()
            except OSError:
                return
            self._driver = driver
            with driver, socket.create_connection(("127.0.0.1", self._port)) as instrument:
                for end in (driver, instrument):
                    end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with contextlib.suppress(ConnectionError):  # an end hung up while the other was speaking
                    if self._carry(driver, instrument) and not self._heals:
                        self.close()

    def _carry(self, driver: socket.socket, instrument: socket.socket) -> bool:
        """Carry until an end hangs up or a cut is reached; True for a cut."""
        with selectors.DefaultSelector() as ready:
            ready.register(driver, selectors.EVENT_READ, instrument)
            ready.register(instrument, selectors.EVENT_READ, driver)
            while True:
                for key, _ in ready.select():
                    data = key.fileobj.recv(65536)  # type: ignore[union-attr]
                    if not data:
                        return False
                    if key.fileobj is instrument:
                        if self._cuts and self.replied + len(data) > self._cuts[0]:
                            driver.sendall(data[: self._cuts.pop(0) - self.replied])
                            return True
                        self.replied += len(data)
                    key.data.sendall(data)


@pytest.fixture
def simulation() -> Iterator[SimulatedBench]:
    with SimulatedBench(noise="by-state") as bench:
        yield bench


@pytest.fixture
def through(simulation: SimulatedBench, tmp_path: Path) -> Iterator[Callable[..., tuple[Path, Proxy]]]:
    """A station file in which one instrument is reached through a proxy."""
    proxies = []

    def build(name: str, *cuts: int, heals: bool = True) -> tuple[Path, Proxy]:
        addresses = {role: found["socket"] for role, found in simulation.resources.items()}
        proxy = Proxy(addresses[name], cuts, heals=heals)
        proxies.append(proxy)
        station = tmp_path / f"station-{len(proxies)}.toml"
        write_addresses(station, addresses | {name: proxy.address})
        if name != "laser":  # whose timeout stands in its command table
            hasty = station.read_text().replace(f"[{name}]\n", f'[{name}]\ntimeout = "1 s"\n')
            station.write_text(hasty)
        return station, proxy

    yield build
    for proxy in proxies:
        proxy.close()


@pytest.fixture
def undisturbed(tmp_path: Path, capsys: pytest.CaptureFixture[str], through: Any) -> tuple[dict[str, Any], int]:
    """What the run gives with whole links, and how many bytes the oscilloscope replies in it."""
    station, proxy = through("scope")
    status, result = as_json(capsys, *RUN, "--station", str(station), "--out", str(tmp_path / "undisturbed"))
    assert (status, result["recovered"]) == (0, 0)
    return result, proxy.replied


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("labctl.engine.recovery.PAUSE_S", 0.01)


def test_a_run_goes_on_over_a_new_link_and_its_frames_are_the_same(
    undisturbed: tuple[dict[str, Any], int],
    through: Any,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    expected, replied = undisturbed
    station, _ = through("scope", *(int(part * replied) for part in (0.3, 1.05, 1.2)))
    status, result = as_json(capsys, *RUN, "--station", str(station), "--out", str(tmp_path / "run"))
    assert status == 0
    assert result["complete"]
    assert result["shots"] == SHOTS
    assert result["recovered"] == 3
    assert result["frames_sha256"] == expected["frames_sha256"]
    assert caplog.text.count("lost link after") == 3
    marked = [line for line in (tmp_path / "run" / "commands.log").read_text().splitlines() if " ! run " in line]
    assert len(marked) == 7, "what is folded back, and two lines a lost link"
    assert re.search(r"lost link after \d+ records, attempt 1 of 3 to go on: scope at TCPIP0", marked[1])
    with open_run(tmp_path / "run") as run:
        assert run.epoch[0, 0] < run.epoch[-1, 0], "light that was switched on again is another epoch"


@pytest.mark.parametrize(
    "name", ["laser", *(pytest.param(name, marks=pytest.mark.full) for name in ("awg", "dmd", "patch_panel"))]
)
def test_every_other_link_may_be_lost_as_well(
    name: str,
    undisturbed: tuple[dict[str, Any], int],
    through: Any,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    station, proxy = through(name)
    run = (*RUN, "--station")
    status, _ = as_json(capsys, *run, str(station), "--out", str(tmp_path / "counted"))
    assert status == 0
    station, _ = through(name, int(0.7 * proxy.replied))
    status, result = as_json(capsys, *run, str(station), "--out", str(tmp_path / "run"))
    assert (status, result["shots"], result["recovered"]) == (0, SHOTS, 1)
    assert result["frames_sha256"] == undisturbed[0]["frames_sha256"]


@pytest.mark.parametrize("name", ["scope", "dmd"])
def test_a_burst_goes_on_as_well(name: str, through: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    station, proxy = through(name)
    run = (*RUN, "--set", "timing=burst", "--station")
    status, expected = as_json(capsys, *run, str(station), "--out", str(tmp_path / "undisturbed"))
    assert (status, expected["recovered"]) == (0, 0)
    station, _ = through(name, proxy.replied - 60)
    status, result = as_json(capsys, *run, str(station), "--out", str(tmp_path / "run"))
    assert (status, result["shots"], result["recovered"]) == (0, SHOTS, 1)
    assert result["frames_sha256"] == expected["frames_sha256"]


def test_a_link_that_stays_dead_ends_the_run_dark(
    undisturbed: tuple[dict[str, Any], int],
    through: Any,
    simulation: SimulatedBench,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    station, _ = through("scope", int(0.75 * undisturbed[1]), heals=False)
    status, out, told = labctl(capsys, *RUN, "--station", station, "--out", tmp_path / "run", "--json")
    result = json.loads(out)
    assert status == 1
    assert re.search(r"^scope at TCPIP0.* (cannot be reached|did not answer)", result["error"])
    left, following = result["notes"]
    assert following == f"the run can go on: labctl resume {tmp_path / 'run'}"
    assert re.search(r"\(scope: scope at TCPIP0.* cannot be reached .*\): the laser is off$", left)
    assert told == f"labctl: {result['error']}\nlabctl: {left}\nlabctl: {following}\n"
    assert caplog.text.count("lost link after") == 3
    assert "Traceback" not in told
    with open_run(tmp_path / "run") as run:
        assert not run.complete
        assert run.done[0] < SHOTS
    assert 0 < run.done[0] + verify_run(tmp_path / "run").suspect < SHOTS
    assert light_at(simulation, None) == pytest.approx(light_at(simulation, Emission(1550.0, 0.03)), abs=1e-3)
    simulation.world.show(np.full((768, 128), 255, np.uint8))
    assert light_at(simulation, Emission(1550.0, 0.03)) > 10e-3


def light_at(simulation: SimulatedBench, emission: Emission | None) -> float:
    """Mean volts at the patched detector: with the laser as the run left it, or with light behind the run's back."""
    world = simulation.world
    if emission is not None:
        world.emit(emission)
    return float(world.record(Acquisition((1,), 25e9, 1000, 0.0), np.array([world.clock.now + 1e-3])).volts.mean())


def test_the_safe_state_is_reached_over_a_link_that_was_lost_unnoticed(
    through: Any, simulation: SimulatedBench
) -> None:
    station, proxy = through("laser")
    with CommandLog() as log, opened(read_station(station), log) as found:
        found.bench.laser.emit()
        proxy.cut()
        found.bench.make_safe()
        assert found.bench.laser.settings()["emitting"] == 0
