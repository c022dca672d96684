"""Group queries, setups as text, in memory and in files, waveforms in references and files, AUTOSet."""

import numpy as np
import pytest

from sim_backends.virtual import VirtualDpo72504dx
from tests.sim_backends.virtual.dpo72504dx.session import block, events, number, volts
from tests.sim_backends.virtual.watched import Ask

CHANGES = (
    "CH1:PROBEFunc:EXTAtten 2;:CH1:SCAle 0.04;OFFSet -0.01;DESKew 80e-12;LABel:NAMe 'light; \"red\"'",
    "SELect:CH2 OFF;CH3 OFF;CH4 ON;:HORizontal:MODE:SAMPLERate 100e9;RECOrdlength 5000;:HORizontal:MODE CONStant",
    "HORizontal:FASTframe:STATE ON;COUNt 7;SELECTED:CH4 3;:TRIGger:A:EDGE:SOUrce CH4;:TRIGger:A:LEVel:CH4 0.125",
    "DATa:SOUrce CH4,CH1;ENCdg RPBinary;STARt 3;:MATH2:DEFine 'CH1+CH4';:SELect:MATH2 ON",
    "MEASUrement:MEAS3:TYPe RISe;SOUrce1 CH4;STATE ON;:MEASUrement:MEAS3:REFLevel:PERCent:MID2 40",
    "MEASUrement:METHod MINMax;:ACQuire:MODe AVErage;NUMAVg 32",
)


@pytest.mark.parametrize(
    ("query", "headers", "reply"),
    [
        ("SELect?", "OFF", "1;1;1;0;0;0;0;0;0;0;0;0"),
        (
            "SELect?",
            "ON",
            ":SELECT:CH1 1;CH2 1;CH3 1;CH4 0;MATH1 0;MATH2 0;MATH3 0;MATH4 0;REF1 0;REF2 0;REF3 0;REF4 0",
        ),
        ("TRIGger:A:HOLDoff?", "ON", ":TRIGGER:A:HOLDOFF:BY DEFAULT;TIME 0.0000000000E+00"),
        ("FASTAcq?", "ON", ":FASTACQ:STATE 0"),
    ],
)
def test_a_group_of_settings(ask: Ask, scope: VirtualDpo72504dx, query: str, headers: str, reply: str) -> None:
    ask(scope, f"HEADer {headers}")
    assert ask(scope, query).decode() == reply


@pytest.mark.parametrize("group", ["ACQuire", "CH2", "DATa", "HORizontal", "MEASUrement:MEAS3", "TRIGger:A", "TRIGger"])
def test_a_group_is_what_its_settings_are_one_by_one(ask: Ask, scope: VirtualDpo72504dx, group: str) -> None:
    for line in CHANGES:
        ask(scope, line)
    ask(scope, "HEADer ON")
    path = ""
    for part in ask(scope, f"{group}?").decode().split(";:"):
        for item in part.split(";"):
            header, _, value = item.partition(" ")
            path, _, leaf = header.rpartition(":") if ":" in header else (path, "", header)
            assert ask(scope, f":{path.lstrip(':')}:{leaf}?").decode().partition(" ")[2] == value


@pytest.mark.parametrize("query", ["SET?", "*LRN?"])
def test_a_setup_that_is_sent_back_restores_every_setting(ask: Ask, scope: VirtualDpo72504dx, query: str) -> None:
    for line in CHANGES:
        ask(scope, line)
    assert events(ask, scope) == ""
    learned = ask(scope, query)
    ask(scope, "*RST")
    assert ask(scope, query) != learned
    assert ask(scope, learned) == b""
    assert events(ask, scope) == ""
    assert ask(scope, query) == learned


@pytest.mark.parametrize(
    ("save", "recall"),
    [
        ("*SAV 3", "*RCL 3"),
        ("SAVe:SETUp 10", "RECAll:SETUp 10"),
        ('SAVe:SETUp "mine.set"', 'RECAll:SETUp "C:/Users/Public/Tektronix/TekScope/mine.set"'),
    ],
)
def test_a_setup_is_stored_and_recalled(ask: Ask, scope: VirtualDpo72504dx, save: str, recall: str) -> None:
    before = ask(scope, "SET?")
    ask(scope, save)
    for line in CHANGES:
        ask(scope, line)
    ask(scope, "*RST")
    ask(scope, recall)
    assert events(ask, scope) == ""
    assert ask(scope, "SET?") == before


def test_what_is_no_setup_is_refused(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "*SAV 4;:SAVe:SETUp 'gone.set';:DELEte:SETUp ALL;:DELEte:SETUp 'gone.set';:SAVe:SETUp 5;:DELEte:SETUp 5")
    assert events(ask, scope) == ""
    for line in (
        "*RCL 4",
        "*RCL 5",
        "RECAll:SETUp 'gone.set'",
        "*SAV 11",
        'RECAll:SETUp "none.set"',
        "RECAll:SETUp NONSENSE",
        "AUTOSet UNDo",
        "AUTOSet VIDeo",
    ):
        ask(scope, line)
    assert events(ask, scope) == "200,200,256,222,256,224,221,221"
    ask(scope, "CH1:SCAle 0.05;:RECAll:SETUp FACtory")
    assert number(ask, scope, "CH1:SCAle?") == 0.1


@pytest.mark.parametrize("place", ["", '"one.wfm"'])
@pytest.mark.parametrize("source", ["CH1", "MATH1"])
def test_a_waveform_is_stored_as_it_was(ask: Ask, scope: VirtualDpo72504dx, source: str, place: str) -> None:
    ask(scope, "MATH1:DEFine 'CH1*CH2';:SELect:MATH1 ON;:ACQuire:STATE RUN")
    ask(scope, f"DATa:SOUrce {source}")
    acquired = ask(scope, "WFMOutpre?"), volts(ask, scope)
    ask(scope, f"SAVe:WAVEform {source},{place or 'REF2'}" + (f";:RECAll:WAVEform {place},REF2" if place else ""))
    ask(scope, "ACQuire:STATE RUN;:SELect:REF2 ON;:DATa:SOUrce REF2")
    stored = ask(scope, "WFMOutpre?"), volts(ask, scope)
    assert events(ask, scope) == ""
    assert stored[0] == acquired[0]
    assert np.array_equal(stored[1], acquired[1])


def test_a_waveform_as_a_spreadsheet(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN;:SAVe:WAVEform:FILEFormat SPREADSHEETCsv;:SAVe:WAVEform CH1,'one.csv'")
    assert ask(scope, "FILESystem:DIR?") == b'"one.csv"'
    table = np.loadtxt(ask(scope, "FILESystem:READFile 'one.csv'").decode().splitlines(), delimiter=",")
    assert np.diff(table[:, 0]) == pytest.approx(40e-12, rel=1e-3)
    assert table[:, 1] == pytest.approx(volts(ask, scope), abs=1e-7)
    ask(scope, "RECAll:WAVEform 'one.csv',REF1;:SAVe:WAVEform REF3,REF4")
    assert events(ask, scope) == "200,2241"


def test_an_expression_of_two_channels(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN;:SELect:MATH1 ON")
    channels = {}
    for name in ("CH1", "CH2"):
        ask(scope, f"DATa:SOUrce {name}")
        channels[name] = volts(ask, scope)
    ask(scope, "DATa:SOUrce MATH1")
    for expression, wanted in (
        ("CH1-CH2", channels["CH1"] - channels["CH2"]),
        ("Ch1 * Ch2", channels["CH1"] * channels["CH2"]),
        ("(CH1+CH2)/2", (channels["CH1"] + channels["CH2"]) / 2),
        ("-CH1", -channels["CH1"]),
    ):
        ask(scope, f'MATH1:DEFine "{expression}";:DATa:ENCdg FPBinary')
        assert ask(scope, "MATH1:DEFine?").decode() == f'"{expression}"'
        assert block(ask(scope, "CURVe?"), ">f4") == pytest.approx(wanted, rel=1e-6)
        assert (number(ask, scope, "WFMOutpre:YMUlt?"), number(ask, scope, "WFMOutpre:YZEro?")) == (1, 0)
        ask(scope, "DATa:ENCdg SRIbinary;:WFMOutpre:BYT_Nr 2")
        assert volts(ask, scope, "<i2") == pytest.approx(wanted, abs=np.ptp(wanted) / 6 / 25 / 256)
        ask(scope, "DATa:ENCdg ASCIi")
        assert np.array(ask(scope, "CURVe?").split(b","), float) == pytest.approx(wanted, rel=1e-6)
    for expression in ("CH1/0", "CH1/(CH1-CH1)", "1e308*(CH1+9)*1e308", "CH1+1e99"):
        ask(scope, f'MATH1:DEFine "{expression}";:DATa:ENCdg FPBinary')
        assert np.isfinite(block(ask(scope, "CURVe?"), ">f4")).all()
    assert events(ask, scope) == ""


def test_expressions_that_are_not_simulated(ask: Ask, scope: VirtualDpo72504dx) -> None:
    for text in (
        "Log(CH1)",
        "CH5",
        "CH1 +",
        "2*3",
        "(" * 150,
        "CH1" + "+CH1" * 100,
        "CH1.real",
        "CH1 if 1 else CH2",
        "CH1+True",
    ):
        ask(scope, f"MATH1:DEFine '{text}'")
        assert events(ask, scope) == "221", text
    ask(scope, "SELect:MATH1 ON;:DATa:SOUrce MATH1;:CURVe?;:SELect:MATH1 OFF;:CURVe?")
    assert events(ask, scope) == "2241,2244"


def test_autoset_fills_the_screen_and_is_undone(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "CH1:SCAle 0.4;OFFSet -1")
    before = ask(scope, "SET?")
    ask(scope, "AUTOSet EXECute")
    assert ask(scope, "ACQuire:STATE?;STOPAfter?;:TRIGger:A:EDGE:SOUrce?") == b"1;RUNSTOP;CH1"
    ask(scope, "MEASUrement:IMMed:TYPe PK2Pk;SOUrce1 CH1")
    divisions = number(ask, scope, "MEASUrement:IMMed:VALue?") / number(ask, scope, "CH1:SCAle?")
    assert 3 < divisions < 8
    assert events(ask, scope) == ""
    ask(scope, "MEASUrement:IMMed:TYPe UNDEFINED;:AUTOSet UNDo")
    assert ask(scope, "SET?") == before
