"""All instruments on one world: what one of them does, the oscilloscope's bytes follow."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.parameters import Parameters
from sim_backends.virtual import (
    VirtualAlp,
    VirtualAwg70002a,
    VirtualDpo72504dx,
    VirtualFibreSwitch,
    VirtualTlg220,
)
from sim_backends.world.world import World
from tests.sim_backends.virtual.watched import Ask

TOP = np.repeat(np.array([255, 0], np.uint8), 384)[:, None] * np.ones((1, 128), np.uint8)
BOTTOM = np.ascontiguousarray(TOP[::-1])


class Bench:
    """The instruments, set up so that light arrives."""

    def __init__(self, ask: Ask, twin_seed: int = 1) -> None:
        self.ask = ask
        world = World(Parameters(chip_modes=50), twin_seed=twin_seed)
        self.awg, self.scope, self.laser = VirtualAwg70002a(world), VirtualDpo72504dx(world), VirtualTlg220(world)
        self.dmd, self.switch = VirtualAlp(world), VirtualFibreSwitch(world)
        samples = np.random.default_rng(5).uniform(-1, 1, 2500).astype("<f4").tobytes()
        marker = bytes([0x40] * 50 + [0] * 2450)
        ask(self.awg, 'SOUR1:DAC:RES 9;:WLIS:WAV:NEW "m",2500')
        ask(self.awg, b'WLIS:WAV:DATA "m",0,2500,#510000' + samples)
        ask(self.awg, b'WLIS:WAV:MARK:DATA "m",#42500' + marker)
        ask(self.awg, 'SOUR1:CASS:WAV "m";:AWGC:RUN;:OUTP1 1')
        ask(self.laser, "POWER 14.8;OUTPUT ON")
        ask(self.switch, "ROUT:CLOS (@1!2,2!3)")
        ask(self.dmd, "ALP:DEVALLOC\nALP:SEQALLOC 1,1\nALP:SEQCONTROL 1,2110,2")
        ask(self.scope, "SEL:CH2 ON;:CH1:SCA 0.05;:CH2:SCA 0.05;:HOR:MODE MAN;MODE:RECO 500;:HOR:POS 0")
        ask(self.scope, "TRIG:A:EDGE:SOU AUX;:TRIG:AUXL 0.5;:TRIG:A:MOD NORM;:ACQ:STOPA SEQ;:DAT:ENC SRI")
        self.show(TOP)

    def show(self, mirrors: NDArray[np.uint8]) -> None:
        self.ask(self.dmd, "ALP:DEVHALT")
        assert self.ask(self.dmd, b"ALP:SEQPUT 1,0,1,#598304" + mirrors.tobytes()) == b"0"
        assert self.ask(self.dmd, "ALP:PROJSTARTCONT 1") == b"0"

    def curve(self, channel: int = 1) -> NDArray[np.int8]:
        assert self.ask(self.scope, "ACQ:STATE RUN;*OPC?") == b"1"
        return np.frombuffer(self.ask(self.scope, f"DAT:SOU CH{channel};:CURV?")[5:], np.int8)


@pytest.fixture
def bench(ask: Ask) -> Bench:
    return Bench(ask)


def likeness(first: NDArray[np.int8], second: NDArray[np.int8]) -> float:
    return float(np.corrcoef(first, second)[0, 1])


def test_the_same_state_looks_the_same_but_for_noise(bench: Bench) -> None:
    first, second = bench.curve(), bench.curve()
    assert likeness(first, second) > 0.8
    assert not np.array_equal(first, second)


@pytest.mark.parametrize(
    ("instrument", "command"),
    [
        ("laser", "WAVELENGTH 1552;*OPC?"),
        ("awg", 'WLIS:WAV:NORM "m",FSC;:SOUR1:VOLT 0.25'),
        ("switch", "ROUT:CLOS (@1!4)"),
    ],
)
def test_other_states_look_different(bench: Bench, instrument: str, command: str) -> None:
    before = bench.curve()
    bench.ask(getattr(bench, instrument), command)
    assert likeness(before, bench.curve()) < 0.8


def test_another_image_and_back(bench: Bench) -> None:
    before = bench.curve()
    bench.show(BOTTOM)
    assert likeness(before, bench.curve()) < 0.5
    bench.show(TOP)
    assert likeness(before, bench.curve()) > 0.85


@pytest.mark.parametrize(
    ("instrument", "command"),
    [("laser", "OUTPUT OFF"), ("dmd", "ALP:DEVHALT\nALP:DEVFREE"), ("switch", "ROUT:OPEN:ALL")],
)
def test_darkness(bench: Bench, instrument: str, command: str) -> None:
    lit = bench.curve().astype(float)
    bench.ask(getattr(bench, instrument), command)
    dark = bench.curve().astype(float)
    assert dark.std() < lit.std() / 2
    assert dark.mean() < lit.mean() / 2


def test_dark_until_tuned(bench: Bench) -> None:
    lit = bench.curve().astype(float)
    bench.ask(bench.laser, "WAVELENGTH 1552")
    assert bench.curve().std() < lit.std() / 2
    while bench.ask(bench.laser, "SETTLED?") == b"0":
        pass
    assert bench.curve().std() > lit.std() / 2


def test_without_the_generator_nothing_triggers(bench: Bench) -> None:
    bench.ask(bench.awg, "AWGC:STOP")
    with pytest.raises(BlockingIOError):
        bench.curve()


def test_same_seed_same_bytes(ask: Ask, bench: Bench) -> None:
    assert np.array_equal(bench.curve(2), Bench(ask).curve(2))
    assert not np.array_equal(bench.curve(2), Bench(ask, twin_seed=2).curve(2))
