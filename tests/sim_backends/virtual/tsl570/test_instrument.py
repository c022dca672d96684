"""The virtual TSL-570: its light, its two command sets, and that it is dark while it tunes."""

import pytest

from sim_backends.virtual import VirtualTsl570
from sim_backends.virtual.tsl570.instrument import FINE_NM
from tests.sim_backends.virtual.watched import Ask, Watched


@pytest.fixture
def laser(world: Watched) -> VirtualTsl570:
    return VirtualTsl570(world)


def test_emits_with_the_shutter_open(ask: Ask, laser: VirtualTsl570, world: Watched) -> None:
    ask(laser, ":POW 3;:POW:STAT 1")
    assert world.light is None
    ask(laser, ":POW:SHUT 0")
    assert world.light is not None
    assert (world.light.wavelength_nm, world.light.power_w) == (1550.0, pytest.approx(1.995e-3, rel=1e-3))
    assert float(ask(laser, ":POW:ACT?")) == 3
    ask(laser, ":POW:STAT 0")
    assert world.light is None
    assert float(ask(laser, ":POW:ACT?")) == -50


def test_rests_a_while_after_it_was_tuned(ask: Ask, laser: VirtualTsl570, world: Watched) -> None:
    ask(laser, ":POW:SHUT 0;STAT 1;:WAV 1560")
    assert ask(laser, "*OPC?") == b"0"
    assert world.laser_light is None
    while ask(laser, "*OPC?") == b"0":
        pass
    assert world.laser_light is not None
    assert world.laser_light.wavelength_nm == 1560


def test_the_other_command_set_is_in_metres(ask: Ask, laser: VirtualTsl570) -> None:
    ask(laser, ":SYST:COMM:COD 1;:WAV 1.56e-6")
    assert float(ask(laser, ":WAV?")) == pytest.approx(1.56e-6)
    assert ask(laser, ":WAV 1560;:SYST:ERR?").startswith(b"-222,")
    assert float(ask(laser, ":SYST:COMM:COD 0;:WAV?")) == pytest.approx(1560)


@pytest.mark.parametrize("line", [":WAV 1499", ":WAV 1631", ":POW 13.1", ":POW -16", ":POW:UNIT 1;:POW 0"])
def test_what_is_out_of_range_is_refused(ask: Ask, laser: VirtualTsl570, line: str) -> None:
    assert ask(laser, f"{line};:SYST:ERR?").startswith(b"-222,")
    assert ask(laser, ":SYST:ALER?") == b"No alerts."


def test_fine_tuning_moves_its_light_until_it_is_ended(ask: Ask, laser: VirtualTsl570, world: Watched) -> None:
    ask(laser, ":POW:SHUT 0;STAT 1;:WAV:FIN -40")
    assert world.light is not None
    assert world.light.wavelength_nm == pytest.approx(1550 - 40 * FINE_NM)
    assert float(ask(laser, ":WAV?")) == 1550
    ask(laser, ":WAV:FINETUNING:DIS")
    assert float(ask(laser, ":WAV:FINE?")) == 0
    assert world.light.wavelength_nm == 1550
