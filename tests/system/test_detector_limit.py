"""More light than a detector may see: found by the probe shots, or at the record that shows it; the bench ends dark."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from instruments.limits import OverLimit
from labctl.bench.station import LimitsSection, Station, read_station, write_addresses
from labctl.commands.main import main
from labctl.engine.session import Acquisition, acquire
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from protocols.registry import read_protocol
from sim_backends.bench import SimulatedBench
from sim_backends.parameters import Parameters
from tests.observers import Follower

SETTINGS = ["images=6", "ports=4", "window=2 ns"]
WEAK_MW, STRONG_DBM = 5, 16


def test_the_twin_cannot_give_what_the_default_forbids() -> None:
    assert Parameters().detector_limit_v < LimitsSection().detector


@pytest.mark.parametrize("timing", ["software", "burst"])
def test_too_much_gain_is_found_by_the_probe_shots(
    timing: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    station = tmp_path / "bench.toml"
    station.write_text(
        "[wiring]\nburst = true\n[sim]\nparameters = { detector_gain_v_per_w = 1e5, detector_limit_v = 2.5 }\n", "utf-8"
    )
    words = [word for setting in (*SETTINGS, f"timing={timing}") for word in ("--set", setting)]
    with pytest.raises(SystemExit) as ended:
        main(["run", "image-readout", *words, "--station", str(station), "--out", str(tmp_path / "run"), "--json"])
    told = json.loads(capsys.readouterr().out)
    assert (ended.value.code, told["exit"]) == (1, 1)
    shown = re.match(
        r"scope: CH1 shows ([\d.]+) V, above limits\.detector = 1\.5 V: lower the laser's power", told["error"]
    )
    assert shown
    assert float(shown[1]) == pytest.approx(2.5, rel=0.2), "where this detector saturates, but for noise"
    assert nothing_but_dark_at_the_end(tmp_path / "run")
    with open_run(tmp_path / "run") as run:
        assert sum(run.done) == 0


@pytest.fixture
def simulation() -> Iterator[SimulatedBench]:
    with SimulatedBench() as bench:
        yield bench


def test_a_laser_turned_up_in_the_middle_of_a_run(simulation: SimulatedBench, tmp_path: Path) -> None:
    """Somebody turns it up at its front panel. The limit lies below the end of the range, above all that was probed."""
    said = Station.model_validate({"laser": {"power": f"{WEAK_MW} mW"}})
    asked = read_protocol("image-readout", SETTINGS)
    before = tmp_path / "before.toml"
    write_addresses(before, {role: found["socket"] for role, found in simulation.resources.items()}, said)
    acquire(Acquisition(asked, read_station(before), tmp_path / "before"))
    with open_run(tmp_path / "before") as run:
        volts = run.volts()
        (scale,), (offset,) = run.scale, run.offset
    limit = float(volts.max() + 127 * scale + offset) / 2
    station = read_station(before).model_copy(update={"limits": LimitsSection(detector=limit)})

    def turned_up(done: int, _total: int) -> None:
        if done == 2:
            tell_the_laser(simulation, f"POWER {STRONG_DBM}")

    with pytest.raises(OverLimit, match=rf"scope: CH1 shows [\d.]+ V, above limits.detector = {limit:g} V"):
        acquire(Acquisition(asked, station, tmp_path / "run"), observer=Follower(turned_up))
    assert tell_the_laser(simulation, "") == "0"
    assert nothing_but_dark_at_the_end(tmp_path / "run")
    report = verify_run(tmp_path / "run")
    assert sum(report.passes) + report.suspect >= 2
    with open_run(tmp_path / "run") as run:
        assert sum(run.done) < run.shape.shots
        assert not len(run.frames), "what somebody else's light has made is in doubt"
    with h5py.File(tmp_path / "run" / "data.h5") as file:
        volts = file["scale"][0] * file["frames"][:].astype(float) + file["offset"][0]
        assert np.abs(volts).max() <= limit, "the record that showed it is not kept"


def nothing_but_dark_at_the_end(directory: Path) -> bool:
    log = (directory / "commands.log").read_text("utf-8")
    return log.rindex("> laser OUTPUT OFF") > log.rindex("> laser OUTPUT ON")


def tell_the_laser(simulation: SimulatedBench, command: str) -> str:
    """Say something to it as another client; whether it emits."""
    import pyvisa

    address = simulation.resources["laser"]["socket"]
    instrument: Any = pyvisa.ResourceManager("@py").open_resource(
        address, read_termination="\n", write_termination="\n"
    )
    with instrument:
        if command:
            instrument.write(command)
        return str(instrument.query("OUTPUT?"))
