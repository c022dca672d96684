"""The power meter on a bench: it follows the laser, watches its limit, and is itself watched."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from instruments.bench import Bench
from instruments.errors import InstrumentError, SettingChanged
from instruments.limits import OverLimit
from instruments.visa import VisaLink
from labctl.bench.check import check_bench
from labctl.bench.opening import Access, OpenBench, opened
from labctl.bench.simulation import with_laser_commands
from labctl.bench.station import Station, read_station
from labctl.errors import StationError
from sim_backends.bench import SimulatedBench
from sim_backends.virtual import VirtualPm100
from sim_backends.world.signals import Emission

ARMED = Access(armed=True)


def with_meter(tap: float = 0.01, **more: Any) -> Station:
    return Station.model_validate({"power_meter": {"driver": "thorlabs-pm100", "tap": tap, **more}})


@pytest.fixture
def open_bench(log: Any) -> Iterator[OpenBench]:
    with opened(with_meter(), log) as found:
        yield found


def at(simulation: SimulatedBench, station: Station) -> Station:
    """`station` with its instruments where those of `simulation` are."""
    station = with_laser_commands(station)
    sections = {
        role: station.section_of(role).model_copy(update={"address": found["socket"]})
        for role, found in simulation.resources.items()
    }
    return station.model_copy(update=sections)


@pytest.fixture
def one_percent() -> Iterator[SimulatedBench]:
    with SimulatedBench(plugged_in={"power_meter": partial(VirtualPm100, section={"tap": 0.01})}) as simulation:
        yield simulation


def test_it_is_checked_with_the_rest() -> None:
    found = check_bench(with_meter(), lambda *_: None)["power_meter"]
    assert found.ok
    assert found.identity.model.startswith("PM100D")
    assert found.examination.options.startswith("S154C")
    assert found.examination.limits["wavelength"].high == 1700


def test_it_corrects_for_the_wavelength_that_the_laser_settled_on(bench: Bench) -> None:
    meter = bench.train.power_meter
    assert meter is not None
    with bench.emitting(1540.0):
        assert meter.settings()["wavelength_nm"] == 1540
        assert meter.power() == pytest.approx(0.3e-3, rel=1e-3)
        bench.tune(1560.0)
        assert meter.power() == pytest.approx(0.3e-3, rel=1e-3)
    assert meter.power() == 0


def test_more_than_the_limit_is_dark_before_it_is_measured_with(one_percent: SimulatedBench, log: Any) -> None:
    station = at(one_percent, with_meter(tap=0.004))
    with opened(station, log, ARMED) as found:
        with (
            pytest.raises(
                OverLimit, match=r"power_meter: the laser gives 7\S+ mW, above limits\.optical_power = 30 mW"
            ),
            found.bench.emitting(1550.0),
        ):
            raise AssertionError("lit")
        assert found.bench.laser.settings()["emitting"] == 0


def test_a_fibre_that_leads_elsewhere_is_told(one_percent: SimulatedBench, log: Any) -> None:
    station = at(one_percent, with_meter(tap=0.1))
    with (
        opened(station, log, ARMED) as found,
        pytest.raises(
            InstrumentError, match=r"power_meter: sees 2\.999 mW of the laser, which says it gives 29\.99 mW"
        ),
        found.bench.emitting(1550.0),
    ):
        raise AssertionError("lit")


def test_a_laser_that_gives_more_than_it_says_is_found_in_the_middle_of_a_run(
    bench: Bench, simulation: SimulatedBench
) -> None:
    with bench.emitting(1550.0):
        bench.require_unchanged()
        simulation.world.emit(Emission(1550.0, 60e-3))
        assert bench.laser.power() == pytest.approx(30e-3, rel=1e-3)
        with pytest.raises(OverLimit, match="power_meter: the laser gives 60 mW"):
            bench.require_unchanged()


@pytest.mark.parametrize(
    ("command", "setting"),
    [
        ("SENSe:CORRection:WAVelength 1310", "SENSe:CORRection:WAVelength"),
        ("SENSe:CORRection 3", "SENSe:CORRection:LOSS:INPut:MAGNitude"),
        ("SENSe:POWer:UNIT DBM", "SENSe:POWer:UNIT"),
        ("SENSe:POWer:RANGe:AUTO OFF", "SENSe:POWer:RANGe:AUTO"),
        ("SENSe:POWer:REFerence 250e-6;REFerence:STATe ON", "SENSe:POWer:REFerence:STATe"),
    ],
)
def test_what_somebody_changes_at_its_front_panel_is_found(
    one_percent: SimulatedBench, log: Any, command: str, setting: str
) -> None:
    meter = VisaLink(one_percent.resources["power_meter"]["socket"], name="they", timeout_s=5, transcript=log)
    meter.write(command)
    meter.errors()
    with (
        opened(at(one_percent, with_meter()), log, ARMED) as found,
        found.bench.emitting(1550.0),
    ):
        found.bench.require_unchanged()  # what was left behind was set
        meter.write(command)
        meter.errors()
        changes = found.bench.instruments["power_meter"].changes()
        assert [change.setting for change in changes] == [setting]
        with pytest.raises((SettingChanged, OverLimit)):
            found.bench.require_unchanged()
    meter.close()


def test_more_than_the_sensor_measures_is_no_reading(log: Any) -> None:
    with (
        opened(with_meter(tap=0.5), log) as found,
        pytest.raises(InstrumentError, match="there is more than the sensor measures"),
        found.bench.emitting(1550.0),
    ):
        raise AssertionError("lit")


def test_a_station_must_say_how_much_the_tap_gives(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text('[power_meter]\ndriver = "thorlabs-pm100"\n', encoding="utf-8")
    with pytest.raises(StationError, match=r"power_meter\.tap is missing: write it"):
        read_station(path)
