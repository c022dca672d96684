"""The virtual oscilloscope's acquisition modes, free running, and other triggers."""

import numpy as np
import pytest

from sim_backends.virtual import VirtualDpo72504dx
from sim_backends.virtual.oscilloscope.modes import interleaved
from tests.sim_backends.virtual.dpo72504dx.session import PERIOD, SHORT_RECORDS, block, fast_frame
from tests.sim_backends.virtual.watched import Ask, Read, Watched


@pytest.fixture
def session() -> tuple[str, ...]:
    return SHORT_RECORDS


@pytest.mark.parametrize("mode", ["HIRes", "PEAKdetect"])
def test_oversampling_modes_exist_below_the_base_rate_only(
    ask: Ask, scope: VirtualDpo72504dx, world: Watched, mode: str
) -> None:
    ask(scope, f"ACQuire:MODe {mode}")
    assert ask(scope, "ACQuire:MODe?;MODe:ACTUal?").decode() == f"{mode.upper()};SAMPLE"
    ask(scope, "HORizontal:MODE:SAMPLERate 3.125e9;:HORizontal:MODE:RECOrdlength 500;:ACQuire:STATE RUN;*OPC?")
    assert ask(scope, "ACQuire:MODe:ACTUal?").decode() == mode.upper()
    acquisition, _ = world.records[0]
    assert (acquisition.sample_rate, acquisition.samples) == (6.25e9, 1000)
    assert acquisition.start_s == pytest.approx(-0.5 / 6.25e9)
    assert ask(scope, "WFMOutpre:PT_Fmt?;NR_Pt?") == (b"ENV;500" if mode == "PEAKdetect" else b"Y;500")
    ask(scope, "WFMOutpre:BYT_Nr 2")
    points = block(ask(scope, "CURVe?"), "<i2")
    if mode == "PEAKdetect":
        assert np.all(points[0::2] <= points[1::2])
    else:
        assert set(points % 256) == {0, 128}


def test_envelope(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    ask(scope, "ACQuire:MODe ENVelope;STATE RUN;*OPC?")
    assert ask(scope, "ACQuire:MODe:ACTUal?;:ACQuire:NUMACq?;:WFMOutpre:PT_Fmt?;NR_FR?") == b"ENVELOPE;10;ENV;1"
    wide = block(ask(scope, "CURVe?"))
    assert np.all(wide[0::2] < wide[1::2])


def test_an_odd_number_of_envelope_points() -> None:
    low, high = np.array([3, 1, 2], np.int8), np.array([4, 9, 5], np.int8)
    assert list(interleaved(low, high)) == [1, 9, 2]


def test_each_next_curve_is_new(ask: Ask, read: Read, scope: VirtualDpo72504dx, world: Watched) -> None:
    first = ask(scope, "ACQuire:STATE RUN;:CURVENext?")
    execution = scope.run(read("*OPC?;CURVENext?;*OPC?")[0])
    next(execution)
    next(execution)
    ask(scope, "ACQuire:STATE RUN")
    with pytest.raises(StopIteration) as end:
        next(execution)
    reply = b"".join(end.value.value)
    assert reply.startswith(b"1;#")
    assert reply.endswith(b";1")
    assert reply[2:-2] != first
    ask(scope, "ACQuire:STOPAfter RUNSTop;STATE RUN")
    assert ask(scope, "CURVENext?") != ask(scope, "CURVENext?")


def test_preamble_and_curve_in_one(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN")
    preamble, curve = ask(scope, "WFMOutpre?"), ask(scope, "CURVe?")
    assert ask(scope, "WAVFrm?") == preamble + b";" + curve
    ask(scope, "HEADer ON;VERBose OFF")
    reply = ask(scope, "WAVFrm?")
    assert reply.startswith(b":WFMO:BYT_N 1;BIT_N 8;")
    assert reply.endswith(b";:CURV " + curve)


def test_both_slopes(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    ask(scope, "TRIGger:A:EDGE:SLOpe EITher;:ACQuire:MODe AVErage;NUMAVg 6;STATE RUN;*OPC?")
    phases = world.records[0][1] * 25e9 % PERIOD
    assert set(np.rint(phases)) <= {0.0, 50.0, float(PERIOD)}
    world.play(None)
    with pytest.raises(BlockingIOError):
        ask(scope, "ACQuire:STATE RUN;*OPC?")


def test_mains_trigger(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    world.play(None)
    fast_frame(ask, scope, 3)
    ask(scope, "TRIGger:A:EDGE:SOUrce LINE;:ACQuire:STATE RUN;*OPC?")
    assert np.diff(world.records[0][1]) == pytest.approx(20e-3, rel=1e-3)


def test_free_running_in_automatic_mode(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    ask(scope, "TRIGger:A:MODe AUTO;:ACQuire:STOPAfter RUNSTop;STATE RUN")
    assert ask(scope, "TRIGger:STATE?") == b"TRIGGER"
    world.play(None)
    assert ask(scope, "TRIGger:STATE?") == b"AUTO"
    assert len(block(ask(scope, "CURVe?"))) == 500
    ask(scope, "TRIGger:A:MODe NORMal")
    assert ask(scope, "TRIGger:STATE?;:ACQuire:STATE STOP;:TRIGger:STATE?") == b"READY;SAVE"
