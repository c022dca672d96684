"""Waveforms of the virtual oscilloscope: preamble, encodings, which part is sent."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backends.virtual import VirtualDpo72504dx
from sim_backends.world.signals import Emission
from tests.sim_backends.virtual.dpo72504dx.session import PERIOD, block, events, number, playback, volts
from tests.sim_backends.virtual.watched import Ask, Read, Watched


def test_curve_is_not_copied(ask: Ask, read: Read, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN")
    with pytest.raises(StopIteration) as end:
        next(scope.run(read("CURVe?")[0]))
    header, body = end.value.value
    assert header == b"#3500"
    assert np.shares_memory(np.asarray(body), scope._traces[1].codes)


def test_codes_are_the_volts_at_the_input(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    ask(scope, "CH1:SCAle 0.02;OFFSet 0.03;POSition -2;:ACQuire:STATE RUN")
    seen = volts(ask, scope)
    world.emit(None)
    world.emit(Emission(1550.0, 30e-3))
    acquisition, _ = world.records[-1]
    truth = world.record(acquisition, np.array([100e-9])).volts[0, 0]
    assert np.corrcoef(seen, truth)[0, 1] > 0.9
    assert abs(seen.mean() - truth.mean()) < 0.002
    assert number(ask, scope, "WFMOutpre:YMUlt?") == pytest.approx(0.02 / 25)
    assert number(ask, scope, "WFMOutpre:YZEro?") == pytest.approx(0.03 + 2 * 0.02)


@pytest.mark.parametrize("width", [1, 2])
@pytest.mark.parametrize("mode", ["SAMple", "AVErage"])
def test_every_encoding_means_the_same_volts(ask: Ask, scope: VirtualDpo72504dx, width: int, mode: str) -> None:
    ask(scope, f"ACQuire:MODe {mode};NUMAVg 4;STATE RUN;:DATa:WIDth {width};:DATa:STARt 11;STOP 60")
    wanted = volts(ask, scope, f"<i{width}")
    assert wanted.size == 50
    for encoding, dtype, offset in [
        ("RIBinary", f">i{width}", 0),
        ("FAStest", f">i{width}", 0),
        ("RPBinary", f">u{width}", 2 ** (8 * width - 1)),
        ("SRPbinary", f"<u{width}", 2 ** (8 * width - 1)),
    ]:
        ask(scope, f"DATa:ENCdg {encoding}")
        step = number(ask, scope, "WFMOutpre:YMUlt?")
        assert np.allclose(volts(ask, scope, dtype) - offset * step, wanted, atol=1e-9), encoding
    for encoding, dtype in [("FPBinary", f">i{width}"), ("SFPbinary", f"<i{width}")]:  # no floating point in a channel
        ask(scope, f"DATa:ENCdg {encoding}")
        assert np.allclose(volts(ask, scope, dtype), wanted, atol=1e-9), encoding
    ask(scope, "DATa:ENCdg SRIbinary;ENCdg ASCIi")
    assert ask(scope, "DATa:ENCdg?;:WFMOutpre:ENCdg?") == b"ASCII;ASCII"
    text = np.array([int(word) for word in ask(scope, "CURVe?").split(b",")])
    assert np.allclose(text * number(ask, scope, "WFMOutpre:YMUlt?") + 0.02, wanted, atol=1e-9)


def test_channels_have_no_other_widths_and_no_floating_point(ask: Ask, scope: VirtualDpo72504dx) -> None:
    widths = [ask(scope, f"WFMOutpre:BYT_Nr {asked};BYT_Nr?;BIT_Nr?") for asked in (0, 1, 2, 8)]
    assert widths == [b"1;8", b"1;8", b"2;16", b"2;16"]
    assert ask(scope, "DATa:ENCdg SFPbinary;ENCdg?;:WFMOutpre:BN_Fmt?;BYT_Nr?") == b"SRIBINARY;RI;2"
    assert events(ask, scope) == ""


def test_preamble_fields_choose_the_encoding(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "WFMOutpre:BN_Fmt RP;BYT_Or MSB;ENCdg BINary")
    assert ask(scope, "DATa:ENCdg?") == b"RPBINARY"
    assert ask(scope, "WFMOutpre:ENCdg?;BN_Fmt?;BYT_Or?") == b"BINARY;RP;MSB"
    ask(scope, "DATa INIT;:VERBose OFF")
    assert ask(scope, "DATa:ENCdg?;SOUrce?;:WFMOutpre:ENCdg?") == b"RIB;CH1;BIN"


def test_whole_preamble_with_and_without_headers(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN")
    fields = ask(scope, "WFMOutpre?").decode().split(";")
    assert fields[:5] == ["1", "8", "BINARY", "RI", "LSB"]
    assert fields[5] == '"Ch1, DC coupling, 0.01 V/div, 2e-09 s/div, 500 points, Sample mode"'
    ask(scope, "HEADer ON")
    assert ask(scope, "WFMOutpre?").startswith(b":WFMOUTPRE:BYT_NR 1;BIT_NR 8;ENCDG BINARY;")
    assert ask(scope, "CH1:SCAle?") == b":CH1:SCALE 1.0000000000E-02"
    assert ask(scope, "CURVe?").startswith(b":CURVE #3500")
    ask(scope, "VERBose OFF")
    assert ask(scope, "HORizontal:MODE?;*OPC?") == b":HOR:MODE MAN;1"


def test_stop_does_not_follow_a_longer_record(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "DATa:STOP 500;:HORizontal:MODE:RECOrdlength 1000;:ACQuire:STATE RUN")
    assert ask(scope, "WFMOutpre:NR_Pt?;:DATa:STOP?") == b"500;500"
    assert block(ask(scope, "CURVe?")).size == 500
    ask(scope, "DATa:STOP 1E12")
    assert ask(scope, "WFMOutpre:NR_Pt?") == b"1000"
    assert block(ask(scope, "CURVe?")).size == 1000
    ask(scope, "DATa:STARt 901")
    assert block(ask(scope, "CURVe?")).size == 100
    whole = block(ask(scope, "DATa:STARt 1;:CURVe?"))
    ask(scope, "DATa:STARt 1001;STOP 2000")
    assert ask(scope, "WFMOutpre:NR_Pt?") == b"1"
    assert list(block(ask(scope, "CURVe?"))) == [whole[-1]]
    ask(scope, "DATa:STARt 30;STOP 11")
    assert np.array_equal(block(ask(scope, "CURVe?")), whole[10:30])


def test_points_that_were_not_to_be_sent_are_there_all_the_same(
    ask: Ask, scope: VirtualDpo72504dx, world: Watched
) -> None:
    ask(scope, "ACQuire:STATE RUN")
    like = volts(ask, scope)
    ask(scope, "DATa:STOP 40;:ACQuire:STATE RUN")
    first = volts(ask, scope)
    world.emit(None)
    ask(scope, "DATa:STOP 500")
    whole = volts(ask, scope)
    assert np.array_equal(whole[:40], first)
    assert np.corrcoef(whole[40:], like[40:])[0, 1] > 0.9, "of the light as it was"
    assert np.std(whole[40:] - like[40:]) == pytest.approx(np.std(first - like[:40]), rel=0.5), "with its own noise"
    ask(scope, "DATa:SOUrce CH2;STARt 100;STOP 200")
    assert volts(ask, scope).size == 101


def test_points_sent_later_are_of_a_segment_that_runs_on(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    world.play(replace(playback(triggered=True), runs_on=True))
    ask(scope, "HORizontal:MODE:RECOrdlength 8000;:DATa:STOP 500;:ACQuire:STATE RUN")
    world.trigger_awg()
    assert volts(ask, scope).size == 500
    ask(scope, "DATa:STOP 8000")
    seen = volts(ask, scope)
    assert np.std(seen[-PERIOD:]) == pytest.approx(np.std(seen[:PERIOD]), rel=0.2)


def test_several_sources_follow_one_another(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN;:DATa:STOP 10")
    parts = [ask(scope, f"DATa:SOUrce CH{channel};:CURVe?") for channel in (1, 3)]
    assert ask(scope, "DATa:SOUrce CH1,CH3;SOUrce?;:CURVe?") == b"CH1,CH3;" + b",".join(parts)


def test_waveform_errors(ask: Ask, scope: VirtualDpo72504dx) -> None:
    assert ask(scope, "CURVe?") == b""
    assert events(ask, scope) == "2241"
    ask(scope, "ACQuire:STATE RUN")
    assert ask(scope, "DATa:SOUrce CH4;:CURVe?;*OPC?") == b"1"
    assert events(ask, scope) == "2244"
    ask(scope, "SELect:CH4 ON")
    assert ask(scope, "CURVe?") == b""
    assert events(ask, scope) == "2241"
    ask(scope, "DATa:SOUrce CH1;:CLEAR ALL")
    assert ask(scope, "CURVe?;:ACQuire:NUMACq?") == b"0"
    assert events(ask, scope) == "2241"


@pytest.mark.parametrize("source", ["MATH1", "REF4"])
def test_mathematics_and_references_are_not_active(ask: Ask, scope: VirtualDpo72504dx, source: str) -> None:
    assert ask(scope, f"DATa:SOUrce {source};SOUrce?;:CURVe?;:WFMOutpre:YMUlt?") == source.encode()
    assert events(ask, scope) == "2244,2244"


def test_nothing_selected_is_nothing_recorded(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    assert ask(scope, "SELect:CH1 OFF;CH2 OFF;CH3 OFF;:ACQuire:STATE RUN;*OPC?") == b"1"
    assert world.records == []


def test_the_preamble_says_what_to_expect_before_the_first_record(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "DATa:SOUrce CH4")
    assert ask(scope, "WFMOutpre:XUNit?;YUNit?;NR_Pt?;NR_FR?;PT_Fmt?;PT_ORder?") == b'"s";"V";500;1;Y;LINEAR'
    assert events(ask, scope) == ""
