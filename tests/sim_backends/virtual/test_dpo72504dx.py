"""The virtual oscilloscope: settings, arming, records, transfer, events."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.parameters import Parameters
from sim_backends.scpi.messages import Message
from sim_backends.virtual import VirtualDpo72504dx, VirtualInstrument
from sim_backends.world import Acquisition, Emission, Playback, Record, World

Ask = Callable[[VirtualInstrument, str | bytes], bytes]
Read = Callable[[str | bytes], list[Message]]

PERIOD = 2500


class Counted(World):
    """A world that counts the records asked of it."""

    def __init__(self) -> None:
        super().__init__(Parameters(light_path="direct", chip_modes=50))
        self.records: list[tuple[Acquisition, int]] = []

    def record(self, acquisition: Acquisition, trigger_times: NDArray[np.float64], *, setting: bytes = b"") -> Record:
        self.records.append((acquisition, len(trigger_times)))
        return super().record(acquisition, trigger_times, setting=setting)


def playback(marked: int = 50) -> Playback:
    volts = np.random.default_rng(1).uniform(-0.25, 0.25, PERIOD).astype(np.float32)
    marker = np.arange(PERIOD) < marked
    return Playback(volts, marker, marker_low_v=0.0, marker_high_v=1.0, sample_rate=25e9)


@pytest.fixture
def world() -> Counted:
    world = Counted()
    world.emit(Emission(1550.0, 30e-3))
    world.patch({1: 2, 2: 3, 3: 4, 4: 5})
    world.play(playback())
    return world


@pytest.fixture
def scope(ask: Ask, world: Counted) -> VirtualDpo72504dx:
    """Set up in the order of the instrument facts, 2.9."""
    scope = VirtualDpo72504dx(world)
    for line in (
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
    ):
        assert ask(scope, line) == b""
    assert ask(scope, "*ESR?;ALLEv?") == b'0;0,"No events to report - queue empty"'
    return scope


def events(ask: Ask, scope: VirtualDpo72504dx) -> str:
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


def number(ask: Ask, scope: VirtualDpo72504dx, query: str) -> float:
    return float(ask(scope, query))


def volts(ask: Ask, scope: VirtualDpo72504dx, dtype: str = "i1") -> NDArray[np.float64]:
    """A curve in volts, as every driver computes them."""
    levels = block(ask(scope, "CURVe?"), dtype)
    off, multiplier, zero = (number(ask, scope, f"WFMOutpre:{field}?") for field in ("YOFf", "YMUlt", "YZEro"))
    return (levels - off) * multiplier + zero


def test_single_acquisition(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    assert ask(scope, "ACQuire:STATE RUN;*OPC?") == b"1"
    assert ask(scope, "ACQuire:STATE?;NUMACq?;:BUSY?;:TRIGger:STATE?") == b"0;1;0;SAVE"
    (acquisition, triggers) = world.records[-1]
    assert (acquisition.channels, acquisition.samples, acquisition.start_s, triggers) == ((1, 2, 3), 500, 0.0, 1)
    assert block(ask(scope, "CURVe?")).size == 500
    ask(scope, "DATa:SOUrce CH2;:CURVe?\nDISplay:WAVEform OFF\nCH1:LABel:NAMe 'a'\nCH1:SCAle 0.02")
    assert len(world.records) == 1


def test_curve_is_not_copied(ask: Ask, read: Read, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN")
    with pytest.raises(StopIteration) as end:
        next(scope.run(read("CURVe?")[0]))
    header, body = end.value.value
    assert header == b"#3500"
    assert np.shares_memory(np.asarray(body), scope._traces[1].codes)


def test_codes_are_the_volts_at_the_input(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
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


def test_records_belong_to_the_settings_they_were_taken_with(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN")
    before = volts(ask, scope)
    ask(scope, "CH1:SCAle 0.5;OFFSet 1;:HORizontal:POSition 50")
    assert np.array_equal(volts(ask, scope), before)
    assert number(ask, scope, "WFMOutpre:PT_Off?") == 0


def test_two_acquisitions_differ_by_noise_only(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN")
    first = volts(ask, scope)
    ask(scope, "ACQuire:STATE RUN")
    second = volts(ask, scope)
    assert not np.array_equal(first, second)
    assert np.corrcoef(first, second)[0, 1] > 0.9


def test_inversion_and_clipping(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "CH1:INVert ON;OFFSet 0;:ACQuire:STATE RUN")
    assert volts(ask, scope).mean() < 0
    ask(scope, "CH1:INVert OFF;SCAle 0.00625;OFFSet -0.2;:ACQuire:STATE RUN")
    assert set(block(ask(scope, "CURVe?"))) == {127.0}


def test_average(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    ask(scope, "ACQuire:MODe AVErage;NUMAVg 100;STATE RUN")
    assert ask(scope, "ACQuire:NUMACq?;MODe:ACTUal?") == b"100;AVERAGE"
    assert [count for _, count in world.records] == [100]
    coarse = volts(ask, scope)
    ask(scope, "WFMOutpre:BYT_Nr 2")
    assert ask(scope, "WFMOutpre:BIT_Nr?") == b"16"
    fine = volts(ask, scope, "<i2")
    step = number(ask, scope, "WFMOutpre:YMUlt?")
    assert step == pytest.approx(0.01 / 25 / 256)
    assert np.abs(coarse - fine).max() <= 0.01 / 25 * 0.51
    assert len(set(np.rint((fine - fine[0]) / step) % 256)) > 20
    ask(scope, "ACQuire:MODe SAMple;STATE RUN;:WFMOutpre:BYT_Nr 2")
    single = block(ask(scope, "CURVe?"), "<i2")
    assert not np.any(single % 256)
    noise = np.std(volts(ask, scope, "<i2") - fine)
    ask(scope, "ACQuire:MODe AVErage;STATE RUN")
    assert np.std(volts(ask, scope, "<i2") - fine) < noise / 4


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
    for encoding, dtype in [("FPBinary", ">f4"), ("SFPbinary", "<f4")]:
        ask(scope, f"DATa:ENCdg {encoding}")
        assert ask(scope, "WFMOutpre:BYT_Nr?;BN_Fmt?") == b"4;FP"
        tolerance = 0.01 / 25 if mode == "AVErage" and width == 1 else 1e-9
        assert np.allclose(volts(ask, scope, dtype), wanted, atol=tolerance), encoding
    ask(scope, "DATa:ENCdg SRIbinary;ENCdg ASCIi")
    assert ask(scope, "DATa:ENCdg?;:WFMOutpre:ENCdg?") == b"ASCII;ASCII"
    text = np.array([int(word) for word in ask(scope, "CURVe?").split(b",")])
    assert np.allclose(text * number(ask, scope, "WFMOutpre:YMUlt?") + 0.02, wanted, atol=1e-9)


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


def test_nothing_selected_is_nothing_recorded(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    assert ask(scope, "SELect:CH1 OFF;CH2 OFF;CH3 OFF;:ACQuire:STATE RUN;*OPC?") == b"1"
    assert world.records == []


def test_waits_for_a_trigger_that_another_client_causes(
    ask: Ask, read: Read, scope: VirtualDpo72504dx, world: Counted
) -> None:
    world.play(None)
    execution = scope.run(read("ACQuire:STATE RUN;*OPC?")[0])
    next(execution)
    next(execution)
    assert ask(scope, "BUSY?;:ACQuire:STATE?;:TRIGger:A:READY?;:TRIGger:STATE?") == b"1;1;1;READY"
    assert ask(scope, "CURVe?") == b""
    world.play(playback())
    with pytest.raises(StopIteration) as end:
        next(execution)
    assert end.value.value == [b"1"]
    assert ask(scope, "BUSY?;:TRIGger:A:READY?") == b"0;0"


@pytest.mark.parametrize("settings", ["AUXLevel 1.5", "A:EDGE:SOUrce CH1;:TRIGger:A:LEVel 4"])
def test_a_level_out_of_reach_never_triggers(ask: Ask, scope: VirtualDpo72504dx, settings: str) -> None:
    ask(scope, f"TRIGger:{settings}")
    with pytest.raises(BlockingIOError):
        ask(scope, "ACQuire:STATE RUN;*OPC?")
    ask(scope, "ACQuire:STATE STOP")
    assert ask(scope, "BUSY?;*OPC?") == b"0;1"
    assert ask(scope, "CURVe?") == b""
    assert events(ask, scope) == "2241"


def test_forced_trigger(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    ask(scope, "TRIGger FORCe")
    assert world.records == []
    world.play(None)
    ask(scope, "ACQuire:STATE RUN")
    ask(scope, "TRIGger FORCe")
    assert ask(scope, "ACQuire:STATE?;*OPC?") == b"0;1"
    assert block(ask(scope, "CURVe?")).size == 500


def test_auto_mode_does_without_a_trigger(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    world.play(None)
    before = world.clock.now
    assert ask(scope, "TRIGger:A:MODe AUTO;:ACQuire:STATE RUN;*OPC?") == b"1"
    assert world.clock.now - before == pytest.approx(0.12, rel=0.01)


def test_channel_trigger(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    ask(scope, "ACQuire:STATE RUN")
    middle = float(np.median(volts(ask, scope)))
    ask(scope, f"TRIGger:A:EDGE:SOUrce CH1;SLOpe FALL;:TRIGger:A:LEVel {middle};:HORizontal:POSition 50")
    assert ask(scope, "TRIGger:A:EDGE:SOUrce?;SLOpe?;SLOpe:CH1?;AUX?") == b"CH1;FALL;FALL;RISE"
    assert number(ask, scope, "TRIGger:A:LEVel:CH1?") == pytest.approx(middle)
    assert ask(scope, "ACQuire:STATE RUN;*OPC?") == b"1"
    assert number(ask, scope, "WFMOutpre:PT_Off?") == 250
    around = volts(ask, scope)[245:256]
    assert around[:5].mean() > middle > around[-5:].mean()


def test_running_freely_each_transfer_is_new(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    ask(scope, "ACQuire:STOPAfter RUNSTop;STATE RUN")
    assert ask(scope, "*OPC?;:ACQuire:STATE?;:BUSY?;:TRIGger:STATE?;:TRIGger:A:READY?") == b"1;1;1;TRIGGER;0"
    assert ask(scope, "CURVe?") != ask(scope, "CURVe?")
    ask(scope, "ACQuire:STATE STOP")
    assert ask(scope, "CURVe?") == ask(scope, "CURVe?")
    assert ask(scope, "ACQuire:NUMACq?;STATE?") == b"3;0"
    world.play(None)
    kept = ask(scope, "CURVe?")
    assert ask(scope, "ACQuire:STATE RUN;:CURVe?") == kept


def test_opc_bit_after_the_acquisition(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    world.play(None)
    ask(scope, "ACQuire:STATE RUN;*OPC")
    assert ask(scope, "*ESR?") == b"0"
    world.play(playback())
    assert ask(scope, "*ESR?;EVMsg?") == b'1;402,"Operation complete"'


def test_time_costs(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    before = world.clock.now
    ask(scope, "ACQuire:STATE RUN;*OPC?")
    assert world.clock.now - before == pytest.approx(20e-3, abs=1e-6)
    before = world.clock.now
    ask(scope, "CURVe?")
    assert world.clock.now - before == pytest.approx(5e-3)
    before = world.clock.now
    ask(scope, "ACQuire:MODe AVErage;NUMAVg 1000;STATE RUN")
    assert world.clock.now - before == pytest.approx(20e-3 + 1000 * 10e-6, rel=0.05)
    before = world.clock.now
    ask(scope, "TRIGger:A:HOLDoff:BY TIMe;TIMe 1e-3;:ACQuire:NUMAVg 10;STATE RUN")
    assert world.clock.now - before == pytest.approx(20e-3 + 9 * 1e-3, rel=0.01)


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
    ask: Ask, scope: VirtualDpo72504dx, world: Counted, settings: str, start: float, offset: int
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
    assert number(ask, scope, "HORizontal:MODE:SAMPLERate?") == 100e9


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
        ("ACQuire:NUMEnv 0", "222"),
        ("ACQuire:NUMEnv few", "224"),
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
        ("WFMOutpre:BIT_Nr 12", "224"),
        ("WFMOutpre:BYT_Nr 8", "222"),
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


def test_the_preamble_says_what_to_expect_before_the_first_record(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "DATa:SOUrce CH4")
    assert ask(scope, "WFMOutpre:XUNit?;YUNit?;NR_Pt?;NR_FR?;PT_Fmt?;PT_ORder?") == b'"s";"V";500;1;Y;LINEAR'
    assert events(ask, scope) == ""
