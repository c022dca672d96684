"""Automatic measurements: their definitions on waveforms that are known, and as clients set them up."""

import numpy as np
import pytest

from sim_backends.scpi.status import ScpiError
from sim_backends.virtual import VirtualDpo72504dx
from sim_backends.virtual.dpo72504dx.measurements import (
    MEASURED,
    References,
    Waveform,
    delay,
    phase,
)
from tests.sim_backends.virtual.dpo72504dx.session import events, number, volts
from tests.sim_backends.virtual.watched import Ask

STEP_S = 1e-11
TIMES = np.arange(1000) * STEP_S
SINE = 0.3 + 0.1 * np.sin(2 * np.pi * 5e8 * TIMES)  # five cycles
PULSES = np.interp((TIMES * 1e9) % 2.0, [0, 0.4, 0.6, 1.0, 1.2, 2.0], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
"""Cycles of 2 ns: up in 0.2 ns at 0.5 ns, down in 0.2 ns at 1.1 ns."""


def waveform(points: np.ndarray[tuple[int], np.dtype[np.float64]], method: str = "MINMax") -> Waveform:
    return Waveform(points, -1e-9, STEP_S, "V", method)


@pytest.mark.parametrize(
    ("kind", "points", "value"),
    [
        ("AMPlitude", PULSES, 1.0),
        ("AREa", PULSES, 0.6e-9 * 5),
        ("BURst", PULSES, 8.6e-9),
        ("CARea", PULSES, 0.6e-9),
        ("CMEan", PULSES, 0.3),
        ("CRMs", SINE, np.hypot(0.3, 0.1 / np.sqrt(2))),
        ("FALL", PULSES, 0.16e-9),
        ("FREQuency", SINE, 5e8),
        ("HIGH", PULSES, 1.0),
        ("LOW", SINE, 0.2),
        ("MAXimum", SINE, 0.4),
        ("MEAN", SINE, 0.3),
        ("MINImum", SINE, 0.2),
        ("NCROss", PULSES, 1.1e-9 - 1e-9),
        ("NDUty", PULSES, 70.0),
        ("NOVershoot", PULSES, 0.0),
        ("NWIdth", PULSES, 1.4e-9),
        ("PCROss", PULSES, 0.5e-9 - 1e-9),
        ("PDUty", PULSES, 30.0),
        ("PERIod", PULSES, 2e-9),
        ("PK2Pk", SINE, 0.2),
        ("POVershoot", PULSES, 0.0),
        ("PWIdth", PULSES, 0.6e-9),
        ("RISe", PULSES, 0.16e-9),
        ("RMS", SINE, np.hypot(0.3, 0.1 / np.sqrt(2))),
    ],
)
def test_a_measurement_is_what_the_manual_says(
    kind: str, points: np.ndarray[tuple[int], np.dtype[np.float64]], value: float
) -> None:
    assert MEASURED[kind](waveform(points)) == pytest.approx(value, rel=0.01, abs=1e-12)


@pytest.mark.parametrize(("method", "high"), [("MINMax", 1.2), ("HIStogram", 1.0), ("MEAN", 1.0)])
def test_how_high_is_found(method: str, high: float) -> None:
    overshooting = np.where(np.arange(1000) % 200 < 100, 1.0, 0.0)
    overshooting[::200] = 1.2
    assert waveform(overshooting, method).levels[1] == pytest.approx(high, abs=0.005)
    overshoot = MEASURED["POVershoot"](waveform(overshooting, method))
    assert overshoot == pytest.approx(0 if method == "MINMax" else 20, abs=0.6)


def test_between_two_waveforms() -> None:
    late = Waveform(SINE, -1e-9 + 0.25e-9, STEP_S, "V", "MINMax")
    rising = (True, True)
    assert delay(waveform(SINE), late, rising=rising, forwards=True) == pytest.approx(0.25e-9, abs=1e-12)
    assert delay(waveform(SINE), late, rising=rising, forwards=False) == pytest.approx(6.25e-9, abs=1e-12)
    assert phase(waveform(SINE), late) == pytest.approx(45, abs=0.2)


def test_levels_in_volts() -> None:
    absolute = Waveform(PULSES, 0.0, STEP_S, "V", references=References(0.25, 0.5, 0.75, absolute=True))
    assert MEASURED["RISe"](absolute) == pytest.approx(0.1e-9, rel=1e-3)


def test_noise_makes_no_edges() -> None:
    noisy = SINE + np.random.default_rng(1).normal(0, 0.002, SINE.size)
    assert MEASURED["FREQuency"](waveform(noisy)) == pytest.approx(5e8, rel=0.02)


@pytest.mark.parametrize("kind", ["FREQuency", "RISe", "PWIdth", "CMEan", "POVershoot", "BURst"])
def test_a_constant_waveform_has_none(kind: str) -> None:
    with pytest.raises(ScpiError):
        MEASURED[kind](waveform(np.full(100, 0.25)))


def test_the_immediate_measurement(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN")
    acquired = volts(ask, scope)
    for kind, value in (("MEAN", acquired.mean()), ("PK2Pk", np.ptp(acquired)), ("MAXimum", acquired.max())):
        ask(scope, f"MEASUrement:IMMed:TYPe {kind};SOUrce1 CH1")
        assert number(ask, scope, "MEASUrement:IMMed:VALue?") == pytest.approx(value, rel=1e-6)
        assert ask(scope, "MEASUrement:IMMed:UNIts?") == b'"V"'
    assert events(ask, scope) == ""


@pytest.mark.parametrize(
    ("settings", "event"),
    [
        ("TYPe MEAN;SOUrce1 CH4", "2225"),
        ("TYPe MEAN;SOUrce1 MATH1", "2225"),
        ("TYPe UNDEFINED", "2225"),
        ("TYPe EYEHeight;SOUrce1 CH1", "2225"),
        ("TYPe FREQuency;SOUrce1 CH1;REFLevel:METHod ABSolute;ABSolute:MID1 5", "2202"),
    ],
)
def test_a_measurement_that_is_undefined(ask: Ask, scope: VirtualDpo72504dx, settings: str, event: str) -> None:
    ask(scope, f"ACQuire:STATE RUN;:MEASUrement:IMMed:{settings}")
    assert events(ask, scope) == ""
    assert number(ask, scope, "MEASUrement:IMMed:VALue?") == 9.91e37
    assert events(ask, scope) == event


def test_the_whole_record_is_measured_whatever_is_sent_of_it(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "DATa:STOP 10;:ACQuire:STATE RUN;:MEASUrement:IMMed:TYPe MAXimum")
    highest = number(ask, scope, "MEASUrement:IMMed:VALue?")
    assert volts(ask, scope).size == 10
    ask(scope, "DATa:STOP 1e10")
    assert highest == pytest.approx(volts(ask, scope).max(), rel=1e-6)


def test_a_slot_and_its_statistics(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STOPAfter RUNSTop;STATE RUN;:MEASUrement:MEAS8:TYPe MEAN;SOUrce1 CH1")
    assert number(ask, scope, "MEASUrement:MEAS8:VALue?") == 9.91e37
    ask(scope, "MEASUrement:MEAS8:STATE ON")
    values = [number(ask, scope, "MEASUrement:MEAS8:VALue?") for _ in range(4)]
    assert len(set(values)) == 4, "each look is at a new acquisition"
    ask(scope, "ACQuire:STATE STOP")
    counted = int(ask(scope, "MEASUrement:MEAS8:COUNt?"))
    assert counted >= 4
    found = {
        name: number(ask, scope, f"MEASUrement:MEAS8:{name}?") for name in ("MINImum", "MEAN", "MAXimum", "STDdev")
    }
    assert found["MINImum"] <= min(values) < max(values) <= found["MAXimum"]
    assert found["MINImum"] < found["MEAN"] < found["MAXimum"]
    assert 0 < found["STDdev"] < found["MAXimum"] - found["MINImum"]
    assert int(ask(scope, "MEASUrement:MEAS8:COUNt?")) == counted, "nothing new was acquired"
    ask(scope, "MEASUrement:STATIstics:COUNt RESET")
    assert int(ask(scope, "MEASUrement:MEAS8:COUNt?")) == 1
    assert events(ask, scope) == ""


def test_a_common_setting_reaches_every_measurement(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "MEASUrement:METHod MEAN;:MEASUrement:REFLevel:PERCent:MID2 30;:MEASUrement:MEAS2:METHod MINMax")
    assert (
        ask(scope, "MEASUrement:IMMed:METHod?;:MEASUrement:MEAS1:METHod?;:MEASUrement:MEAS2:METHod?")
        == b"MEAN;MEAN;MINMAX"
    )
    assert number(ask, scope, "MEASUrement:MEAS7:REFLevel:PERCent:MID2?") == 30
    assert number(ask, scope, "MEASUrement:REFLevel:PERCent:MID1?") == 50
