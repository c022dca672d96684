"""What sets the virtual 6 Series B apart from its elder cousin: its rules, its words, its digitiser."""

import re

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.parameters import Parameters
from sim_backends.virtual import VirtualMso6b
from tests.sim_backends.virtual.dpo72504dx.session import block, events, lit, number
from tests.sim_backends.virtual.watched import SMALL, Ask, Watched

SESSION = (
    "DISplay:GLObal:CH2:STATE ON;:CH1:SCAle 0.01;OFFSet 0.02;:CH2:SCAle 0.02",
    "TRIGger:A:EDGE:SOUrce AUXiliary;:TRIGger:AUXLevel 0.5;:TRIGger:A:MODe NORMal",
    "HORizontal:MODe MANual;MODe:SAMPLERate 25E9;RECOrdlength 1000;:HORizontal:POSition 0",
    "DATa:ENCdg SRIbinary;STOP 1e12;:WFMOutpre:BYT_Nr 2;:ACQuire:STOPAfter SEQuence",
)


def set_up(ask: Ask, world: Watched) -> VirtualMso6b:
    scope = VirtualMso6b(world)
    for line in SESSION:
        assert ask(scope, line) == b""
    assert ask(scope, "*ESR?;ALLEv?") == b'0;0,"No events to report - queue empty"'
    return scope


@pytest.fixture
def world() -> Watched:
    return lit()


@pytest.fixture
def scope(ask: Ask, world: Watched) -> VirtualMso6b:
    return set_up(ask, world)


def codes(ask: Ask, scope: VirtualMso6b) -> NDArray[np.float64]:
    return block(ask(scope, "ACQuire:STATE RUN;:CURVe?"), "<i2")


@pytest.mark.parametrize(("asked", "got"), [(1, 1000), (999, 1000), (1001, 1001), (62_500_000, 62_500_000)])
def test_record_lengths(ask: Ask, scope: VirtualMso6b, asked: int, got: int) -> None:
    for frames in ("OFF", "ON"):
        ask(scope, f"HORizontal:FASTframe:STATE {frames};:HORizontal:MODe:RECOrdlength {asked}")
        assert number(ask, scope, "HORizontal:RECOrdlength?") == got


def test_a_new_rate_changes_the_scale_or_the_record(ask: Ask, scope: VirtualMso6b) -> None:
    ask(scope, "HORizontal:MODe:RECOrdlength 4000;SAMPLERate 12.5e9")
    assert number(ask, scope, "HORizontal:RECOrdlength?") == 4000
    ask(scope, "HORizontal:MODe:MANual:CONFIGure RECORDLength;:HORizontal:SAMPLERate 25e9")
    assert number(ask, scope, "HORizontal:RECOrdlength?") == 8000
    ask(scope, "HORizontal:MODe CONStant")
    assert events(ask, scope) == "224"


def test_all_channels_have_the_highest_rate(ask: Ask, scope: VirtualMso6b) -> None:
    ask(scope, "DISplay:GLObal:CH3:STATE ON;:DISplay:GLObal:CH4:STATE ON")
    assert number(ask, scope, "HORizontal:MODe:SAMPLERate?") == number(ask, scope, "ACQuire:MAXSamplerate?") == 25e9
    assert ask(scope, "DATa:SOUrce:AVAILable?") == b"CH1,CH2,CH3,CH4"


def test_a_slope_is_that_of_every_source(ask: Ask, scope: VirtualMso6b) -> None:
    ask(scope, "TRIGger:A:EDGE:SLOpe FALL;SOUrce CH2")
    assert ask(scope, "TRIGger:A:EDGE:SLOpe?") == b"FALL"


def test_codes_are_in_steps_of_sixteen(ask: Ask, scope: VirtualMso6b) -> None:
    fine = codes(ask, scope)
    assert np.unique(fine).size > 100
    assert not (fine % 16).any()
    assert number(ask, scope, "WFMOutpre:YMUlt?") == pytest.approx(0.01 / 6400)
    coarse = block(ask(scope, "WFMOutpre:BYT_Nr 1;:CURVe?"))
    assert np.abs(fine / 256 - coarse).max() <= 0.5


def test_its_noise_is_that_of_its_effective_bits(ask: Ask) -> None:
    dark = {"detector_nep_w_per_rthz": 0.0, "booster_gain_db": 0.0, "amplifier_gain_db": 0.0}
    quiet = Watched(Parameters.model_validate({**SMALL.model_dump(), **dark, "enob_of_12_bits": 7.0}))
    scope = VirtualMso6b(quiet)
    for line in (*SESSION, "TRIGger:A:MODe AUTO", "CH1:SCAle 1;OFFSet 0"):
        ask(scope, line)
    assert codes(ask, scope).std() == pytest.approx(2**16 / 2**7 / np.sqrt(12), rel=0.1)


def test_an_average_is_in_the_same_codes(ask: Ask, scope: VirtualMso6b) -> None:
    single = codes(ask, scope)
    ask(scope, "ACQuire:MODe AVErage;NUMAVg 64")
    averaged = codes(ask, scope)
    assert np.corrcoef(single, averaged)[0, 1] > 0.8
    assert np.polyfit(averaged, single, 1)[0] == pytest.approx(1, abs=0.1)


def test_the_preamble_tells_when_the_first_point_is(ask: Ask, scope: VirtualMso6b) -> None:
    """And its points are counted from there, unlike those of the elder cousin."""
    ask(scope, "HORizontal:DELay:MODe OFF;:HORizontal:POSition 50;:DATa:STARt 101;:ACQuire:STATE RUN;*WAI")
    half = 0.5 * number(ask, scope, "HORizontal:RECOrdlength?")
    assert ask(scope, "WFMOutpre:PT_Off?") == b"0"
    step = number(ask, scope, "WFMOutpre:XINcr?")
    assert number(ask, scope, "WFMOutpre:XZEro?") == pytest.approx((100 - half) * step, abs=step)
    ask(scope, "HORizontal:FASTframe:STATE ON;COUNt 2;:ACQuire:STATE RUN;*WAI")
    for frame in ask(scope, "HORizontal:FASTframe:XZEro:ALL?").decode().split(", "):
        assert float(frame.split(": ")[1]) == pytest.approx((100 - half) * step, abs=step)


def test_lists_of_frames_are_those_of_the_source(ask: Ask, scope: VirtualMso6b) -> None:
    ask(scope, "HORizontal:FASTframe:STATE ON;COUNt 3;:ACQuire:STATE RUN;*WAI")
    stamps = ask(scope, "HORizontal:FASTframe:TIMEStamp:ALL?").decode()
    stamp = r"01\.01\.2026\.00:00::\d\d\.\d{12}"
    assert re.fullmatch(rf"1: {stamp}, 2: {stamp}, 3: {stamp}", stamps)
    assert len(ask(scope, "HORizontal:FASTframe:XZEro:ALL?").split(b", ")) == 3
    ask(scope, "DATa:SOUrce MATH1;:HORizontal:FASTframe:XZEro:ALL?")
    assert events(ask, scope) == "2244"


@pytest.mark.parametrize(
    ("command", "event"),
    [
        *(("ACQuire:FASTAcq:STATE ON", "221"), ("ACQuire:FASTAVerage:STATE ON", "221"), ("SELect:CH1 ON", "113")),
        *(("CH1:COUPling AC", "221"), ("TRIGger:A:HOLDoff:BY DEFAult", "224")),
    ],
)
def test_what_it_refuses(ask: Ask, scope: VirtualMso6b, command: str, event: str) -> None:
    ask(scope, command)
    assert events(ask, scope) == event
