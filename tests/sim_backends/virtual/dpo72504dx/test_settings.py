"""Settings of the virtual oscilloscope: horizontal, trigger levels, errors, events, reset."""

import numpy as np
import pytest

from sim_backends.virtual import VirtualDpo72504dx
from tests.sim_backends.virtual.dpo72504dx.session import events, number, volts
from tests.sim_backends.virtual.watched import Ask, Watched


@pytest.mark.parametrize(
    ("settings", "start", "offset"),
    [
        ("POSition 0", 0.0, 0),
        ("POSition 50", -10e-9, 250),
        ("POSition 100", -20e-9, 500),
        ("POSition 10;DELay:MODe ON;POSition 50;TIMe 0", -10e-9, 250),
        ("DELay:MODe ON;POSition 0;TIMe 40e-9", 40e-9, -1000),
        ("MAIn:DELay:MODe ON;POSition 0;TIMe 50e-12", 40e-12, -1),
        ("DELay:MODe ON;POSition 20;TIMe -20e-9", -24e-9, 600),
    ],
)
def test_where_the_record_begins(
    ask: Ask, scope: VirtualDpo72504dx, world: Watched, settings: str, start: float, offset: int
) -> None:
    ask(scope, f"HORizontal:{settings};:ACQuire:STATE RUN")
    acquisition, _ = world.records[-1]
    assert acquisition.start_s == pytest.approx(start, abs=1e-15)
    assert number(ask, scope, "WFMOutpre:PT_Off?") == offset
    assert number(ask, scope, "WFMOutpre:XINcr?") == pytest.approx(40e-12)
    assert number(ask, scope, "WFMOutpre:XZEro?") == 0.0
    ask(scope, "DATa:STARt 101")
    assert number(ask, scope, "WFMOutpre:PT_Off?") == offset - 100


def test_a_delayed_record_is_a_later_part_of_the_same_light(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN")
    first = volts(ask, scope)
    ask(scope, "HORizontal:DELay:MODe ON;POSition 0;TIMe 8e-9;:ACQuire:STATE RUN")
    assert number(ask, scope, "HORizontal:POSition?") == 50
    later = volts(ask, scope)
    assert np.corrcoef(first[200:], later[:300])[0, 1] > 0.9


def test_horizontal_modes(ask: Ask, scope: VirtualDpo72504dx) -> None:
    assert ask(scope, "HORizontal:MODE?;MODE:RECOrdlength?") == b"MANUAL;500"
    assert number(ask, scope, "HORizontal:MODE:SCAle?") == pytest.approx(2e-9)
    assert number(ask, scope, "HORizontal:ACQDURATION?") == pytest.approx(20e-9)
    assert ask(scope, "HORizontal:ACQLENGTH?;DIVisions?;MAIn:UNIts?;INTERPRatio?") == b'500;10;"s";1'
    ask(scope, "HORizontal:MODE:SCAle 1e-9")
    assert events(ask, scope) == "221"
    ask(scope, "HORizontal:MODE CONStant;MODE:SCAle 4e-9")
    assert ask(scope, "HORizontal:MODE:RECOrdlength?") == b"1000"
    ask(scope, "HORizontal:MODE:SAMPLERate 50e9")
    assert ask(scope, "HORizontal:MODE:RECOrdlength?") == b"2000"
    ask(scope, "HORizontal:MODE:RECOrdlength 700")
    assert events(ask, scope) == "221"
    ask(scope, "HORizontal:MODE AUTO;MODE:SCAle 100e-9")
    assert number(ask, scope, "HORizontal:MODE:SAMPLERate?") == pytest.approx(3.125e9)
    assert ask(scope, "HORizontal:MODE:RECOrdlength?") == b"3125"
    ask(scope, "HORizontal:MODE:SAMPLERate 25e9")
    assert events(ask, scope) == "221"
    ask(scope, "HORizontal:MODE:SCAle 1000")
    assert number(ask, scope, "HORizontal:MODE:RECOrdlength?") == 31_250_000


def test_rates_are_stepped_and_shared(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "HORizontal:MODE:SAMPLERate 24e9")
    assert number(ask, scope, "HORizontal:MODE:SAMPLERate?") == 25e9
    ask(scope, "HORizontal:MODE:SAMPLERate 100e9")
    assert number(ask, scope, "HORizontal:MODE:SAMPLERate?") == 50e9
    ask(scope, "SELect:CH3 OFF")
    assert number(ask, scope, "HORizontal:MODE:SAMPLERate?") == 50e9, "it does not come back by itself"
    ask(scope, "HORizontal:MODE:SAMPLERate 100e9")
    assert number(ask, scope, "HORizontal:MODE:SAMPLERate?") == 100e9
    ask(scope, "SELect:CH3 ON")
    assert number(ask, scope, "HORizontal:MODE:SAMPLERate?") == 50e9


def test_a_single_record_has_five_hundred_points_and_a_frame_fifty(ask: Ask, scope: VirtualDpo72504dx) -> None:
    def length(asked: int) -> bytes:
        return ask(scope, f"HORizontal:MODE:RECOrdlength {asked};RECOrdlength?")

    assert [length(asked) for asked in (1, 50, 499, 501)] == [b"500", b"500", b"500", b"501"]
    ask(scope, "HORizontal:FASTframe:STATE ON")
    assert [length(asked) for asked in (1, 51, 250, 251)] == [b"50", b"250", b"250", b"500"]
    assert ask(scope, "HORizontal:FASTframe:LENgth 50;LENgth?;STATE OFF;LENgth?") == b"50;500"
    assert ask(scope, "HORizontal:FASTframe:STATE ON;LENgth?") == b"500"
    assert events(ask, scope) == ""


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("FOO", "113"),
        ("CH5:SCAle 0.1", "114"),
        ("CH:SCAle 0.1", "113"),
        ("CH1:SCAle 1", "222"),
        ("CH1:SCAle 0.001", "222"),
        ("CH1:COUPling AC", "221"),
        ("CH1:COUPling DCREJect", "221"),
        ("CH1:COUPling 50", "224"),
        ("CH1:TERmination 1E6", "222"),
        ("CH1:BANdwidth 1e6", "222"),
        ("CH1:BANdwidth 26e9", "222"),
        ("CH1:DESKew 130e-9", "222"),
        ("CH1:POSition 9", "222"),
        ("CH1:VTERm:BIAS 4", "222"),
        ("ACQuire:NUMAVg 1", "222"),
        ("ACQuire:MODe WFMDB", "221"),
        ("ACQuire:MODe FOO", "224"),
        ("ACQuire:SAMPlingmode ET", "221"),
        ("HORizontal:FASTframe:COUNt 1e6", "222"),
        ("HORizontal:FASTframe:COUNt 0", "222"),
        ("HORizontal:FASTframe:TIMEStamp:FRAMe:CH1? 1", "2241"),
        ("HORizontal:FASTframe:XZEro:FRAme:CH1?", "109"),
        ("HORizontal:DELay:TIMe 2", "222"),
        ("TRIGger:A:HOLDoff:TIMe 11", "222"),
        ("TRIGger:A:EDGE:SOUrce D1", "224"),
        ("AUXout:SOUrce CLOCk", "224"),
        ("FASTAcq:STATE ON", "221"),
        ("HORizontal:MODE:RECOrdlength 1e9", "222"),
        ("DATa:SOUrce MATH5", "224"),
        ("TRIGger:A:EDGE:SOUrce", "109"),
        ("TRIGger:AUXLevel high", "104"),
        ("WFMOutpre:XINcr 1", "113"),
        ("CURVe", "113"),
        ("'", "102"),
    ],
)
def test_errors_change_nothing(ask: Ask, scope: VirtualDpo72504dx, command: str, code: str) -> None:
    state = "CH1:SCAle?;COUPling?;:HORizontal:MODE:RECOrdlength?;:DATa:SOUrce?;:WFMOutpre:BYT_Nr?;:ACQuire:MODe?"
    before = ask(scope, state)
    assert ask(scope, command) == b""
    assert events(ask, scope) == code
    assert ask(scope, state) == before


def test_events_are_released_by_the_register(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "FOO;BAR")
    assert ask(scope, "EVQty?;EVMsg?") == b'0;1,"No events to report - new events pending *ESR?"'
    assert ask(scope, "*ESR?;EVQty?") == b"32;2"
    assert ask(scope, "EVENT?;ALLEv?") == b'113;113,"Undefined header; BAR"'
    assert ask(scope, "DESE 0;DESE?") == b"0"
    assert ask(scope, "FOO;*ESR?") == b"0"


def test_event_queue_overflows_into_its_last_event(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, ";".join(["FOO"] * 40))
    assert ask(scope, "*ESR?;EVQty?") == b"32;32"
    assert ask(scope, "ALLEv?").endswith(b'113,"Undefined header; FOO",350,"Queue overflow"')


def test_levels_by_name(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "TRIGger:AUXLevel ECL;:TRIGger:A:EDGE:SOUrce CH2;:TRIGger:A:LEVel TTL")
    assert number(ask, scope, "TRIGger:AUXLevel?") == -1.3
    assert number(ask, scope, "TRIGger:A:LEVel:CH2?") == 1.4
    ask(scope, "TRIGger:A:EDGE:SOUrce AUXiliary;:TRIGger:A:LEVel 0.3")
    assert number(ask, scope, "TRIGger:AUXLevel?") == -1.3


def test_reset_keeps_headers_and_masks_factory_does_not(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "VERBose OFF;DESE 48;*RST")
    assert ask(scope, "HEADer?;VERBose?;DESE?;HORizontal:MODE?;:SELect:CH2?;:LOCk?") == b"0;0;48;AUTO;0;NON"
    ask(scope, "LOCk ALL;:FACtory")
    assert ask(scope, "HDR?") == b":HDR 1"
    assert ask(scope, "ID?") == b":ID TEKTRONIX,DPO72504DX,CF:91.1CT FV:10.8.3 Build 3"
    ask(scope, "HEADer OFF;:UNLock ALL")
    assert ask(scope, "LOCk?;*OPT?") == b"NONE;STD:Standard record length"
