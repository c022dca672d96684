"""No light without a person's word: `armed = true` in the station file, or `--arm`."""

import json
import os
import shlex
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from labctl.bench.opening import Access
from labctl.bench.signals import Interruption
from labctl.bench.station import read_station, write_addresses
from labctl.engine.session import Acquisition, acquire
from protocols.registry import read_protocol
from sim_backends.bench import SimulatedBench
from sim_backends.world.signals import Emission
from tests.observers import Follower
from tests.system.conftest import without_arm

SETTINGS = ("images=4", "ports=2", "window=0.4 ns")
RUN = ("run", "image-readout", *(word for setting in SETTINGS for word in ("--set", setting)))

Labctl = Callable[..., tuple[int, dict[str, Any]]]
Heard = list[Emission | None]
"""What a virtual laser was told, one after the other: light, or None for darkness."""


@pytest.fixture(scope="module")
def simulation() -> Iterator[SimulatedBench]:
    with SimulatedBench() as bench:
        yield bench


@pytest.fixture
def heard(simulation: SimulatedBench, monkeypatch: pytest.MonkeyPatch) -> Heard:
    told: Heard = []
    emit = simulation.world.emit

    def hear(emission: Emission | None, *, lit_from_s: float = 0.0) -> None:
        told.append(emission)
        emit(emission, lit_from_s=lit_from_s)

    monkeypatch.setattr(simulation.world, "emit", hear)
    return told


@pytest.fixture
def armed(simulation: SimulatedBench, tmp_path: Path) -> Path:
    """What `labctl sim serve --save-station` writes."""
    path = tmp_path / "armed.toml"
    write_addresses(path, {role: found["socket"] for role, found in simulation.resources.items()})
    return path


@pytest.fixture
def unarmed(armed: Path) -> Path:
    return without_arm(armed, armed.parent)


def cut(station: Path, directory: Path, *, by_command: bool) -> Path:
    """A run that was stopped after its first shot."""
    interruption = Interruption()

    def stop(_done: int, _total: int) -> None:
        interruption.requested = True

    asked = read_protocol("image-readout", list(SETTINGS))
    acquire(
        Acquisition(asked, read_station(station), directory, access=Access(armed=by_command)),
        interruption=interruption,
        observer=Follower(stop),
    )
    return directory


@pytest.mark.parametrize("command", [RUN, ("reproduce", "fig2", "--seeds", "1")])
def test_a_laser_that_nobody_armed_is_never_told_to_emit(
    command: tuple[str, ...], unarmed: Path, heard: Heard, labctl: Labctl, tmp_path: Path
) -> None:
    status, told = labctl(*command, "--station", unarmed, "--out", tmp_path / "out")
    assert status == 2
    assert "unarmed.toml: the laser is not armed" in told["error"]
    assert "armed = true under [laser]" in told["error"]
    assert "repeat with --arm" in told["error"]
    assert not any(heard)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("by_command", [False, True])
def test_an_armed_run_is_lit_and_ends_dark(
    by_command: bool, armed: Path, unarmed: Path, heard: Heard, labctl: Labctl, tmp_path: Path
) -> None:
    words = ("--station", unarmed, "--arm") if by_command else ("--station", armed)
    status, done = labctl(*RUN, *words, "--out", tmp_path / "run")
    assert (status, done["complete"]) == (0, True)
    assert any(heard)
    assert heard[-1] is None
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text("utf-8"))
    assert manifest["station"]["laser"]["armed"] is not by_command


def test_a_run_whose_station_was_armed_is_resumed_without_a_word(
    armed: Path, heard: Heard, labctl: Labctl, tmp_path: Path
) -> None:
    status, resumed = labctl("resume", cut(armed, tmp_path / "run", by_command=False))
    assert (status, resumed["complete"]) == (0, True)
    assert heard[-1] is None


def test_the_arm_of_a_command_line_is_good_for_one_command(
    armed: Path, unarmed: Path, heard: Heard, labctl: Labctl, tmp_path: Path
) -> None:
    directory = cut(unarmed, tmp_path / "run", by_command=True)
    heard.clear()
    status, told = labctl("resume", directory)
    assert status == 2
    assert "repeat with --arm" in told["error"]
    assert not heard
    assert labctl("resume", directory, "--arm")[1]["complete"]
    other = cut(unarmed, tmp_path / "other", by_command=True)
    assert labctl("resume", other, "--station", armed)[1]["complete"], "and the station may be armed meanwhile"
    assert heard[-1] is None


def test_the_command_that_goes_on_is_told_with_the_arm(
    unarmed: Path, simulation: SimulatedBench, labctl: Labctl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    emit, interrupts = simulation.world.emit, iter([signal.SIGINT])

    def light(emission: Emission | None, *, lit_from_s: float = 0.0) -> None:
        emit(emission, lit_from_s=lit_from_s)
        if emission is not None:
            for number in interrupts:
                os.kill(os.getpid(), number)

    monkeypatch.setattr(simulation.world, "emit", light)
    status, told = labctl(*RUN, "--station", unarmed, "--arm", "--out", tmp_path / "run")
    assert (status, told["complete"]) == (130, False)
    assert told["records"] < told["records_planned"] == 6
    assert told["next"] == f"labctl resume {tmp_path / 'run'} --arm"
    status, told = labctl(*shlex.split(told["next"])[1:])
    assert (status, told["complete"]) == (0, True)


def test_what_gives_no_light_needs_no_arm(unarmed: Path, heard: Heard, labctl: Labctl) -> None:
    assert labctl("check", "--station", unarmed)[0] == 0
    assert labctl(*RUN, "--station", unarmed, "--dry-run")[0] == 0
    assert not any(heard)
