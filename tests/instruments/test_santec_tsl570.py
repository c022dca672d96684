"""The TSL-570 in the place of the usual laser: messages end with CR, leftovers are set, a wrong driver is told."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from instruments.bench import Bench
from instruments.errors import InstrumentError, LightLost, OutOfRange, SettingChanged
from instruments.limits import OverLimit
from instruments.visa import VisaLink
from labctl.bench.check import check_bench
from labctl.bench.discovery import answers_at
from labctl.bench.laser_limits import check_laser
from labctl.bench.opening import OpenBench, opened
from labctl.bench.station import Station
from labctl.errors import StationError
from sim_backends.bench import SimulatedBench
from sim_backends.virtual import VirtualTsl570
from tests.command_line import labctl

STATION = Station.model_validate({"laser": {"driver": "santec-tsl-570", "power": "10 mW"}})


@pytest.fixture
def open_bench(log: Any) -> Iterator[OpenBench]:
    with opened(STATION, log) as found:
        yield found


@pytest.fixture
def front_panel(simulation: SimulatedBench, log: Any) -> Iterator[VisaLink]:
    resource = simulation.resources["laser"]["socket"]
    link = VisaLink(resource, name="they", timeout_s=5, transcript=log, write_eol="\r", read_eol="\r")
    yield link
    link.close()


@pytest.fixture(scope="module")
def santec() -> Iterator[str]:
    """Where one is served."""
    with SimulatedBench(plugged_in={"laser": VirtualTsl570}) as simulation:
        yield simulation.resources["laser"]["socket"]


def test_it_is_checked_with_the_rest() -> None:
    found = check_bench(STATION, lambda *_: None)["laser"]
    assert found.ok
    assert (found.identity.manufacturer, found.identity.model) == ("SANTEC", "TSL-570")
    assert (found.examination.limits["wavelength"].low, found.examination.limits["power"].high) == (1500, 13)


def test_a_run_is_lit_by_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bench.toml"
    path.write_text('[laser]\ndriver = "santec-tsl-570"\npower = "10 mW"\n', encoding="utf-8")
    run = ("run", "image-readout", "--set", "images=4", "--station", path, "--out", tmp_path / "run")
    assert labctl(capsys, *run)[0] == 0
    sent = (tmp_path / "run" / "commands.log").read_text("utf-8")
    assert sent.index("> laser :POWer:STATe 1") < sent.rindex("> laser :POWer:STATe 0")
    assert sent.index("SYSTem:COMMunicate:CODe 0") < sent.index(":WAVelength 1550.0000")


def test_light_on_and_off(bench: Bench) -> None:
    with bench.emitting(1555.5):
        assert bench.laser.power() == pytest.approx(10e-3, rel=1e-3)
        assert bench.laser.settings()["wavelength_nm"] == 1555.5
        bench.laser.require_emission()
        bench.require_unchanged()
    settings = bench.laser.settings()
    assert (settings["emitting"], settings["shutter_closed"]) == (0, 1)
    with pytest.raises(InstrumentError, match="the light went out by itself"):
        bench.laser.require_emission()


def test_a_shutter_that_somebody_closed_is_light_that_is_lost(bench: Bench, front_panel: VisaLink) -> None:
    with bench.emitting(1550.0):
        front_panel.write(":POWer:SHUTter 1")
        with pytest.raises(LightLost, match="its shutter is closed and was open"):
            bench.laser.require_emission()


def test_outside_its_band_or_power_nothing_is_sent(bench: Bench, log: Any) -> None:
    with pytest.raises(OutOfRange, match=r"laser power = 13\.9794 dBm is outside"):
        bench.laser.set_power(25e-3)
    assert not log.sent_to("laser")
    with pytest.raises(OutOfRange, match=r"laser wavelength = 1640 nm is outside 1500\.\.1630 nm"):
        bench.laser.tune(1640.0)
    assert not [text for text in log.sent_to("laser") if text.startswith(":WAVelength 1")]
    with pytest.raises(StationError, match=r"laser\.power = 30 mW is 14\.77121 dBm, but the laser of driver santec"):
        check_laser(Station.model_validate({"laser": {"driver": "santec-tsl-570"}}), [1550.0])


@pytest.mark.parametrize(
    "left",
    [
        *(":SYSTem:COMMunicate:CODe 1", ":POWer:UNIT 1", ":WAVelength:OFFSet 0.05", ":COHCtrl 1", ":AM:STATe 1"),
        *(":WAVelength:FINe 50", ":WAVelength:SWEep:STATe 1"),
    ],
)
def test_what_others_leave_behind_is_set(bench: Bench, front_panel: VisaLink, left: str) -> None:
    front_panel.write(left)
    front_panel.errors()
    with bench.emitting(1550.0):
        assert bench.laser.power() == pytest.approx(10e-3, rel=1e-3)
        front_panel.write(left)
        front_panel.errors()
        with pytest.raises((SettingChanged, OverLimit)):
            bench.require_unchanged()


def test_in_the_other_command_set_it_says_where_it_tunes_and_is_left_in_it(bench: Bench, front_panel: VisaLink) -> None:
    front_panel.write(":SYSTem:COMMunicate:CODe 1")
    wavelengths = bench.laser.examine().limits["wavelength"]
    assert (wavelengths.low, wavelengths.high) == pytest.approx((1500, 1630))
    assert bench.laser.settings()["wavelength_nm"] == pytest.approx(1550)
    assert front_panel.query(":SYSTem:COMMunicate:CODe?") == "1"


def test_it_is_found_by_its_own_terminator_and_recognised(santec: str) -> None:
    (answer,) = answers_at([santec])
    assert (answer.identity.model, answer.instrument, answer.driver) == ("TSL-570", "laser", "santec-tsl-570")


def test_a_station_with_the_driver_of_another_laser_is_told_who_is_there(santec: str) -> None:
    laser = {"driver": "alnair-tlg-220", "address": santec, "commands": "simulated"}
    found = check_bench(Station.model_validate({"mixed": True, "laser": laser}), lambda *_: None)["laser"]
    assert "is 'SANTEC TSL-570', which driver 'alnair-tlg-220' is not for: correct laser.address" in found.problem


def test_and_so_is_one_with_its_driver_at_another_laser() -> None:
    with SimulatedBench() as simulation:
        laser = {"driver": "santec-tsl-570", "address": simulation.resources["laser"]["socket"], "timeout": 0.3}
        found = check_bench(Station.model_validate({"mixed": True, "laser": laser}), lambda *_: None)["laser"]
    assert "is 'Alnair Labs TLG-220 (simulated)', which driver 'santec-tsl-570' is not for" in found.problem
