"""The virtual laser: the words of its table, darkness while tuning, corrected tables."""

import tomllib
from typing import Any

import pytest

from sim_backends.virtual import VirtualTlg220
from sim_backends.virtual.tlg220.instrument import default_table
from sim_backends.world.signals import Emission
from tests.sim_backends.virtual.watched import Ask, Watched


@pytest.fixture
def laser(world: Watched) -> VirtualTlg220:
    return VirtualTlg220(world)


def test_light(ask: Ask, laser: VirtualTlg220, world: Watched) -> None:
    assert ask(laser, "*IDN?").startswith(b"Alnair Labs,TLG-220")
    ask(laser, "WAVELENGTH 1550.0000\nPOWER 14.77")
    assert world.light is None
    ask(laser, "OUTPUT ON")
    assert world.light is not None
    assert world.light.wavelength_nm == 1550.0
    assert world.light.power_w == pytest.approx(30e-3, rel=1e-3)
    assert ask(laser, "OUTPUT?\nPOWER?\nWAVELENGTH?\nERROR?") == b'114.7715500,"No error"'
    ask(laser, "OUTPUT OFF")
    assert world.light is None
    assert ask(laser, "output?") == b"0"


def test_dark_while_tuning(ask: Ask, laser: VirtualTlg220, world: Watched) -> None:
    ask(laser, "OUTPUT ON")
    assert world.lit_from_s == 0.0
    ask(laser, "WAVELENGTH 1551.0")
    assert world.light == Emission(1551.0, 10e-3)
    assert world.lit_from_s == world.clock.now + 1.0
    polls = 1
    while ask(laser, "SETTLED?") == b"0":
        polls += 1
    assert polls == 10
    assert world.clock.now == pytest.approx(world.lit_from_s)


def test_setting_the_same_wavelength_does_not_tune(ask: Ask, laser: VirtualTlg220) -> None:
    ask(laser, "WAVELENGTH 1550.0;POWER 12")
    assert ask(laser, "SETTLED?") == b"1"


def test_completion_waits_in_virtual_time(ask: Ask, laser: VirtualTlg220, world: Watched) -> None:
    assert ask(laser, "WAVELENGTH 1552.5;*OPC?;SETTLED?") == b"1;1"
    assert world.clock.now == pytest.approx(1.1)


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("WAVELENGTH 1500", '-222,"Data out of range;WAVELENGTH 1500: 1528 to 1566 nm"'),
        ("POWER 20", '-222,"Data out of range;POWER 20: 6 to 16 dBm"'),
        ("WAVELENGTH", '-113,"Undefined header;WAVELENGTH"'),
        ("WAVELENGTH blue", '-113,"Undefined header;WAVELENGTH"'),
        ("FREQUENCY?", '-113,"Undefined header;FREQUENCY"'),
        ("WAVELENGTH #14abcd", '-113,"Undefined header;WAVELENGTH"'),
    ],
)
def test_refusals(ask: Ask, laser: VirtualTlg220, line: str, error: str) -> None:
    before = ask(laser, "WAVELENGTH?\nPOWER?\nOUTPUT?")
    assert ask(laser, line) == b""
    assert ask(laser, "ERROR?").decode() == error
    assert ask(laser, "WAVELENGTH?\nPOWER?\nOUTPUT?") == before


def test_values_are_rounded_to_the_step(ask: Ask, laser: VirtualTlg220) -> None:
    ask(laser, "WAVELENGTH 1550.12345\nPOWER 10.006")
    assert ask(laser, "WAVELENGTH?;POWER?") == b"1550.123;10.01"


def test_reset(ask: Ask, laser: VirtualTlg220, world: Watched) -> None:
    ask(laser, "OUTPUT ON;POWER 16;WAVELENGTH 1540;*RST")
    assert world.light is None
    assert ask(laser, "OUTPUT?;POWER?;WAVELENGTH?;*OPC?") == b"0;10;1550;1"


def test_a_corrected_table_can_be_rehearsed(ask: Ask, world: Watched) -> None:
    table = tomllib.loads(
        r"""
        model = "Alnair Labs TLG-220"
        [commands.identify]
        write = "ID?"
        reply = "TLG=(?P<text>.+)"
        [commands.set_wavelength]
        write = "FREQ {value:.4f} THZ;APPLY"
        unit = "THz"
        [commands.get_wavelength]
        write = "FREQ?"
        reply = "FREQ=(?P<value>[-+0-9.Ee]+) THz"
        unit = "THz"
        [commands.set_power]
        write = "P={value:.3f}"
        unit = "mW"
        min = 1.0
        [commands.get_power]
        write = "P?"
        reply = "(?P<value>[-+0-9.Ee]+)\\(mW\\)"
        unit = "mW"
        [commands.output_on]
        write = "<unknown>"
        """
    )
    laser = VirtualTlg220(world, table)
    assert ask(laser, "ID?").startswith(b"TLG=Alnair Labs")
    ask(laser, "freq  193.1 thz ; apply")
    assert ask(laser, "FREQ?") == b"FREQ=193.1 THz"
    ask(laser, "P=30.000")
    assert ask(laser, "P?") == b"30(mW)"
    assert ask(laser, "OUTPUT ON;*ESR?") == b"32"
    assert ask(laser, "*IDN?").startswith(b"Alnair Labs")


def entry(name: str, **changes: Any) -> dict[str, Any]:
    return {"commands": {name: {"write": "X?", "reply": "(?P<value>.+)", **changes}}}


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        (entry("get_power", unit="W", reply="P=.*(?P<value>.+)"), "plain text"),
        (entry("get_power", unit="W", reply=r"\d(?P<value>.+)"), "plain text"),
        (entry("get_power", unit="horses"), "unit"),
        (entry("get_wavelength", unit="dBm"), "unit"),
        (entry("sing"), "no command sing"),
        (entry("set_power", unit="W", write="P {value:.2f} {value}"), "more than one"),
    ],
)
def test_tables_that_cannot_be_simulated_are_refused(world: Watched, table: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        VirtualTlg220(world, table)


def test_the_default_table_is_complete() -> None:
    table = default_table()
    assert table["verified"] is True
    assert len(table["commands"]) == 10
