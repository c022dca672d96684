"""A session with the virtual oscilloscope: its world, how it is set up, and its replies taken apart."""

import numpy as np
from numpy.typing import NDArray

from sim_backends.parameters import Parameters
from sim_backends.virtual import VirtualDpo72504dx, VirtualInstrument
from sim_backends.world.signals import Emission, Playback
from tests.sim_backends.virtual.watched import SMALL, Ask, Watched

PERIOD = 2500
WHOLE_SESSION = (
    "ACQuire:STATE STOP",
    "HORizontal:FASTframe:STATE OFF",
    "*CLS",
    "HEADer OFF",
    "VERBose ON",
    "FASTAcq:STATE OFF;:ACQuire:SAMPlingmode RT;:ACQuire:MODe SAMple",
    "SELect:CH1 ON;:CH1:TERmination 50;COUPling DC;BANdwidth FULl;SCAle 0.01;POSition 0;OFFSet 0.02",
    "SELect:CH2 ON;CH3 ON;:CH2:SCAle 0.01;:CH3:SCAle 0.02",
    "TRIGger:A:TYPe EDGE;:TRIGger:A:EDGE:SOUrce AUXiliary;SLOpe:AUX RISe",
    "TRIGger:AUXLevel 0.5;:TRIGger:A:MODe NORMal",
    "HORizontal:MODE MANual;MODE:SAMPLERate 25E9;RECOrdlength 500",
    "HORizontal:POSition 0",
    "DATa:SOUrce CH1;STARt 1;STOP 1e10;ENCdg SRIbinary",
    "WFMOutpre:BYT_Nr 1",
    "ACQuire:STOPAfter SEQuence",
)
"""The order of the instrument facts, 2.9: three channels, 500 points."""
SHORT_RECORDS = (
    "SELect:CH2 ON;:CH1:SCAle 0.01;OFFSet 0.02;:CH2:SCAle 0.02;"
    ":TRIGger:A:EDGE:SOUrce AUXiliary;:TRIGger:AUXLevel 0.5;:TRIGger:A:MODe NORMal;"
    ":HORizontal:MODE MANual;MODE:SAMPLERate 25E9;RECOrdlength 500;:HORizontal:POSition 0;"
    ":DATa:ENCdg SRIbinary;STOP 1e12;:ACQuire:STOPAfter SEQuence",
)
"""Two channels, 500 points, the fewest of a single record."""


def playback(*, triggered: bool = False) -> Playback:
    volts = np.random.default_rng(1).uniform(-0.25, 0.25, PERIOD).astype(np.float32)
    marker = np.arange(PERIOD) < 50
    lengths = (PERIOD,) if triggered else None
    return Playback(volts, marker, marker_low_v=0.0, marker_high_v=1.0, sample_rate=25e9, lengths=lengths)


def lit(parameters: Parameters = SMALL) -> Watched:
    world = Watched(parameters)
    world.emit(Emission(1550.0, 30e-3))
    world.patch({1: 2, 2: 3, 3: 4, 4: 5})
    world.play(playback())
    return world


def set_up(ask: Ask, world: Watched, session: tuple[str, ...] = SHORT_RECORDS) -> VirtualDpo72504dx:
    scope = VirtualDpo72504dx(world)
    for line in session:
        assert ask(scope, line) == b""
    assert ask(scope, "*ESR?;ALLEv?") == b'0;0,"No events to report - queue empty"'
    return scope


def fast_frame(ask: Ask, scope: VirtualDpo72504dx, count: int, more: str = "") -> None:
    ask(scope, f"HORizontal:FASTframe:STATE ON;LENgth 50;COUNt {count};SEQuence FIRst;SUMFrame NONe" + more)


def events(ask: Ask, scope: VirtualInstrument) -> str:
    ask(scope, "*ESR?")
    codes = []
    while (code := ask(scope, "EVENT?")) != b"0":
        codes.append(code.decode())
    return ",".join(codes)


def block(reply: bytes, dtype: str = "i1") -> NDArray[np.float64]:
    digits = int(reply[1:2], 16)
    size = int(reply[2 : 2 + digits])
    assert len(reply) == 2 + digits + size
    return np.frombuffer(reply[2 + digits :], dtype).astype(np.float64)


def number(ask: Ask, scope: VirtualInstrument, query: str) -> float:
    return float(ask(scope, query))


def volts(ask: Ask, scope: VirtualDpo72504dx, dtype: str = "i1") -> NDArray[np.float64]:
    """A curve in volts, as every driver computes them."""
    levels = block(ask(scope, "CURVe?"), dtype)
    off, multiplier, zero = (number(ask, scope, f"WFMOutpre:{field}?") for field in ("YOFf", "YMUlt", "YZEro"))
    return (levels - off) * multiplier + zero


def frames(ask: Ask, scope: VirtualDpo72504dx, channel: int = 1, dtype: str = "i1") -> NDArray[np.float64]:
    ask(scope, f"DATa:SOUrce CH{channel}")
    shape = tuple(int(ask(scope, f"WFMOutpre:{name}?")) for name in ("NR_FR", "NR_Pt"))
    return block(ask(scope, "CURVe?"), dtype).reshape(shape)
