"""The virtual power meter: what it sees of the laser, and how it shows that."""

import pytest

from sim_backends.virtual import VirtualPm100
from sim_backends.world.signals import Emission
from tests.sim_backends.virtual.watched import Ask, Watched


@pytest.fixture
def meter(world: Watched) -> VirtualPm100:
    world.emit(Emission(1550.0, 10e-3))
    return VirtualPm100(world, {"tap": 0.01})


def test_sees_its_part_of_the_laser_while_there_is_light(ask: Ask, meter: VirtualPm100, world: Watched) -> None:
    ask(meter, "SENS:CORR:WAV 1550")
    assert float(ask(meter, "MEAS:POW?")) == pytest.approx(100e-6)
    world.emit(Emission(1550.0, 10e-3), lit_from_s=world.clock.now + 1)  # it tunes
    assert float(ask(meter, "READ?")) == 0
    world.emit(None)
    assert float(ask(meter, "FETC?")) == 0


def test_shows_another_power_where_it_is_told_another_wavelength(ask: Ask, meter: VirtualPm100) -> None:
    assert float(ask(meter, "SENS:CORR:WAV 1000;:MEAS:POW?")) == pytest.approx(155e-6)


def test_whoever_sets_a_loss_or_dbm_reads_otherwise(ask: Ask, meter: VirtualPm100) -> None:
    ask(meter, "SENSe:CORRection:WAVelength 1550;LOSS:INPut:MAGNitude 3")
    assert float(ask(meter, "MEAS?")) == pytest.approx(199.5e-6, rel=1e-3)
    assert float(ask(meter, "CORR 0;POW:UNIT DBM;:MEAS:POW?")) == pytest.approx(-10)


def test_in_delta_mode_it_shows_the_rest_above_a_reference(ask: Ask, meter: VirtualPm100) -> None:
    ask(meter, "SENS:CORR:WAV 1550;:SENS:POW:REF 90e-6;REF:STAT ON")
    assert float(ask(meter, "MEAS:POW?")) == pytest.approx(10e-6)
    assert float(ask(meter, "SENS:POW:DC:REF:STAT OFF;:MEAS:POW?")) == pytest.approx(100e-6)


def test_more_than_the_sensor_or_the_range_holds_is_no_number(ask: Ask, meter: VirtualPm100, world: Watched) -> None:
    ask(meter, "POWer:RANGe:AUTO OFF;UPPer 50e-6")
    assert float(ask(meter, "MEAS:POW?")) == 9.9e37
    ask(meter, "POW:RANG:AUTO ON")
    assert float(ask(meter, "MEAS:POW?")) < 1
    world.emit(Emission(1550.0, 1.0))
    assert float(ask(meter, "MEAS:POW?")) == 9.9e37


def test_says_what_it_is_and_how_far_it_goes(ask: Ask, meter: VirtualPm100) -> None:
    assert b"Thorlabs,PM100D" in ask(meter, "*IDN?")
    assert ask(meter, "SYST:SENS:IDN?").startswith(b'"S154C"')
    low, high = ask(meter, "CORR:WAV? MIN;WAV? MAX").split(b";")
    assert (float(low), float(high)) == (800, 1700)
    assert ask(meter, "SENS:CORR:WAV 500;:SYST:ERR?").startswith(b"-222,")
