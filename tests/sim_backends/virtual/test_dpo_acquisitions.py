"""The virtual oscilloscope's FastFrame, acquisition modes, triggers and vertical extras."""

import re
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.parameters import Parameters
from sim_backends.scpi.messages import Message
from sim_backends.virtual import VirtualDpo72504dx, VirtualInstrument
from sim_backends.virtual.dpo_acquisition import interleaved, summarised
from sim_backends.virtual.dpo_fastframe import date_stamp, duration_stamp
from sim_backends.world import Acquisition, Emission, Playback, Projection, Record, World

Ask = Callable[[VirtualInstrument, str | bytes], bytes]
Read = Callable[[str | bytes], list[Message]]

PERIOD = 2500
STAMP = re.compile(rb'"\d{2} [A-Z]{3} \d{4} \d{2}:\d{2}:\d{2}\.(\d{3} \d{3} \d{3} \d{3})"')


class Counted(World):
    """A world that notes the records asked of it."""

    def __init__(self, parameters: Parameters) -> None:
        super().__init__(parameters)
        self.records: list[tuple[Acquisition, NDArray[np.float64]]] = []

    def record(self, acquisition: Acquisition, trigger_times: NDArray[np.float64], *, setting: bytes = b"") -> Record:
        self.records.append((acquisition, trigger_times))
        return super().record(acquisition, trigger_times, setting=setting)


def playback(*, triggered: bool = False) -> Playback:
    volts = np.random.default_rng(1).uniform(-0.25, 0.25, PERIOD).astype(np.float32)
    marker = np.arange(PERIOD) < 50
    lengths = (PERIOD,) if triggered else None
    return Playback(volts, marker, marker_low_v=0.0, marker_high_v=1.0, sample_rate=25e9, lengths=lengths)


def lit(parameters: Parameters | None = None) -> Counted:
    world = Counted(parameters or Parameters(light_path="direct", chip_modes=50))
    world.emit(Emission(1550.0, 30e-3))
    world.patch({1: 2, 2: 3, 3: 4, 4: 5})
    world.play(playback())
    return world


@pytest.fixture
def world() -> Counted:
    return lit()


def set_up(ask: Ask, world: World) -> VirtualDpo72504dx:
    scope = VirtualDpo72504dx(world)
    ask(
        scope,
        "SELect:CH2 ON;:CH1:SCAle 0.01;OFFSet 0.02;:CH2:SCAle 0.02;"
        ":TRIGger:A:EDGE:SOUrce AUXiliary;:TRIGger:AUXLevel 0.5;:TRIGger:A:MODe NORMal;"
        ":HORizontal:MODE MANual;MODE:SAMPLERate 25E9;RECOrdlength 50;:HORizontal:POSition 0;"
        ":DATa:ENCdg SRIbinary;STOP 1e12;:ACQuire:STOPAfter SEQuence",
    )
    assert ask(scope, "*ESR?") == b"0"
    return scope


@pytest.fixture
def scope(ask: Ask, world: Counted) -> VirtualDpo72504dx:
    return set_up(ask, world)


def fast_frame(ask: Ask, scope: VirtualDpo72504dx, count: int, more: str = "") -> None:
    ask(scope, f"HORizontal:FASTframe:STATE ON;COUNt {count};SEQuence FIRst;SUMFrame NONe" + more)


def events(ask: Ask, scope: VirtualDpo72504dx) -> str:
    ask(scope, "*ESR?")
    codes = []
    while (code := ask(scope, "EVENT?")) != b"0":
        codes.append(code.decode())
    return ",".join(codes)


def block(reply: bytes, dtype: str = "i1") -> NDArray[np.float64]:
    digits = int(reply[1:2], 16)
    assert len(reply) == 2 + digits + int(reply[2 : 2 + digits])
    return np.frombuffer(reply[2 + digits :], dtype).astype(np.float64)


def frames(ask: Ask, scope: VirtualDpo72504dx, channel: int = 1, dtype: str = "i1") -> NDArray[np.float64]:
    ask(scope, f"DATa:SOUrce CH{channel}")
    shape = tuple(int(ask(scope, f"WFMOutpre:{name}?")) for name in ("NR_FR", "NR_Pt"))
    return block(ask(scope, "CURVe?"), dtype).reshape(shape)


def picoseconds(reply: bytes) -> list[int]:
    return [int(found.replace(b" ", b"")) for found in STAMP.findall(reply)]


# --- FastFrame


def test_frames_of_one_record(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    fast_frame(ask, scope, 20)
    began = world.clock.now
    assert ask(scope, "ACQuire:STATE RUN;:TRIGger:A:READY?") == b"1"
    assert world.clock.now - began == pytest.approx(0.4, abs=1e-3)
    assert ask(scope, "*OPC?;:ACQuire:NUMFRAMESACQuired?;NUMACq?;STATE?;:BUSY?;:TRIGger:A:READY?") == b"1;20;1;0;0;0"
    ((acquisition, times),) = world.records
    assert (acquisition.channels, acquisition.samples, times.size) == ((1, 2), 50, 20)
    assert times[0] >= began + 0.4 - 1e-9
    assert np.diff(times).min() >= 2e-9
    first, second = frames(ask, scope, 1), frames(ask, scope, 2)
    assert first.shape == second.shape == (20, 50)
    assert not np.array_equal(first[0], first[1])
    assert np.corrcoef(first[0], first[1])[0, 1] > 0.9


def test_one_block_that_is_not_copied(ask: Ask, read: Read, scope: VirtualDpo72504dx) -> None:
    fast_frame(ask, scope, 20)
    ask(scope, "ACQuire:STATE RUN;*OPC?")
    with pytest.raises(StopIteration) as end:
        next(scope.run(read("CURVe?")[0]))
    header, body = end.value.value
    assert header == b"#41000"
    assert np.shares_memory(np.asarray(body), scope._traces[1].codes)


def test_a_frame_does_not_depend_on_how_many_are_taken_together(ask: Ask) -> None:
    few, many = lit(), lit()
    scopes = [set_up(ask, world) for world in (few, many)]
    for count, scope in zip((3, 9), scopes, strict=True):
        fast_frame(ask, scope, count)
        ask(scope, "ACQuire:STATE RUN;*OPC?")
    assert np.array_equal(frames(ask, scopes[0]), frames(ask, scopes[1])[:3])
    assert np.array_equal(frames(ask, scopes[0], 2), frames(ask, scopes[1], 2)[:3])
    single = set_up(ask, world := lit())
    world.clock.advance(0.38)
    ask(single, "ACQuire:STATE RUN;*OPC?")
    assert np.array_equal(frames(ask, single)[0], frames(ask, scopes[0])[0])


def test_which_frames_are_sent(ask: Ask, scope: VirtualDpo72504dx) -> None:
    fast_frame(ask, scope, 6)
    ask(scope, "ACQuire:STATE RUN;*OPC?")
    whole = frames(ask, scope)
    for start, stop, part in [
        (2, 4, whole[1:4]),
        (4, 2, whole[1:4]),
        (5, 100, whole[4:]),
        (100000, 100000, whole[-1:]),
        (1, 1, whole[:1]),
    ]:
        ask(scope, f"DATa:FRAMESTARt {start};FRAMESTOP {stop}")
        assert np.array_equal(frames(ask, scope), part)
    ask(scope, "DATa:FRAMESTARt 2;FRAMESTOP 3;STARt 11;STOP 20;ENCdg ASCIi")
    text = [int(word) for word in ask(scope, "CURVe?").split(b",")]
    assert text == list(whole[1:3, 10:20].ravel())
    ask(scope, "DATa INIT")
    assert ask(scope, "DATa:STARt?;STOP?;FRAMESTARt?;:WFMOutpre:NR_FR?") == b"1;50;1;6"
    ask(scope, "DATa:STARt 5;STOP 9;:DATa SNAp")
    assert ask(scope, "DATa:STARt?;STOP?") == b"1;50"


def test_time_stamps(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    fast_frame(ask, scope, 5)
    ask(scope, "TRIGger:A:HOLDoff:BY TIMe;TIMe 1e-3;:ACQuire:STATE RUN;*OPC?")
    _, times = world.records[0]
    stamps = "HORizontal:FASTframe:TIMEStamp:"
    reply = ask(scope, f"{stamps}ALL:CH2? 5,1")
    assert re.fullmatch(rb'(?:\d,"[^"]*",?){5}', reply)
    assert picoseconds(reply) == pytest.approx(times * 1e12, abs=1)
    one = ask(scope, f"{stamps}FRAMe:CH1? 3")
    assert one.startswith(b'"01 JAN 2026 00:00:00.4')
    assert picoseconds(one) == [picoseconds(reply)[2]]
    assert ask(scope, f"{stamps}BETWeen:CH1? 1,2") == b'"00:00:00.001 000 000 000"'
    assert ask(scope, f"{stamps}BETWeen:CH1? 3,1") == b'"-00:00:00.002 000 000 000"'
    ask(scope, "HORizontal:FASTframe:SELECTED:CH1 3;:HORizontal:FASTframe:REF:FRAme 2")
    assert ask(scope, f"{stamps}DELTa:CH1?") == b'"00:00:00.001 000 000 000"'
    assert ask(scope, f"{stamps}SELECTED:CH1?") == one
    assert picoseconds(ask(scope, f"{stamps}REF?")) == [picoseconds(reply)[1]]
    for query in (f"{stamps}FRAMe:CH1? 6", f"{stamps}ALL:CH1? 1,6", "HORizontal:FASTframe:XZEro:FRAme:CH1? 6"):
        assert ask(scope, query) == b""
        assert events(ask, scope) == "222"
    ask(scope, "HEADer ON")
    assert ask(scope, f"{stamps}FRAMe:CH1? 3") == b":HORIZONTAL:FASTFRAME:TIMESTAMP:FRAME:CH1 " + one


def test_stamps_in_words() -> None:
    assert date_stamp(0.4000000125) == "01 JAN 2026 00:00:00.400 000 012 500"
    assert date_stamp(86400 * 31 + 3661) == "01 FEB 2026 01:01:01.000 000 000 000"
    assert duration_stamp(-3661.5) == "-01:01:01.500 000 000 000"


def test_trigger_offsets_of_frames(ask: Ask) -> None:
    world = lit(Parameters(light_path="direct", chip_modes=50, shared_reference=False))
    scope = set_up(ask, world)
    fast_frame(ask, scope, 8)
    ask(scope, "ACQuire:STATE RUN;*OPC?")
    every = ask(scope, "HORizontal:FASTframe:XZEro:ALL:CH1? 1,8").decode().split(",")
    assert every[0::2] == [str(number) for number in range(1, 9)]
    offsets = [float(word) for word in every[1::2]]
    assert len(set(offsets)) == 8
    assert max(map(abs, offsets)) <= 20e-12
    assert float(ask(scope, "HORizontal:FASTframe:XZEro:FRAme:CH1? 4")) == offsets[3]
    ask(scope, "HORizontal:FASTframe:SELECTED:CH1 5")
    assert float(ask(scope, "HORizontal:FASTframe:XZEro:SELECTED:CH1?")) == offsets[4]
    ask(scope, "DATa:FRAMESTARt 6")
    assert float(ask(scope, "WFMOutpre:XZEro?")) == offsets[5]
    ask(scope, "ACQuire:SYNcsamples ON;STATE RUN;*OPC?")
    assert float(ask(scope, "WFMOutpre:XZEro?")) == 0.0


def test_forced_frames_and_a_stop_before_the_last(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    world.play(None)
    fast_frame(ask, scope, 5)
    assert ask(scope, "ACQuire:STATE RUN;:CURVe?;:BUSY?") == b"1"
    assert events(ask, scope) == "2241"
    for taken in (1, 2, 3):
        assert ask(scope, "TRIGger FORCe;:ACQuire:NUMFRAMESACQuired?;STATE?").split(b";") == [b"%d" % taken, b"1"]
    assert frames(ask, scope).shape == (3, 50)
    with pytest.raises(BlockingIOError):
        ask(scope, "*OPC?")
    assert ask(scope, "ACQuire:STATE STOP;STATE?;NUMFRAMESACQuired?;*OPC?") == b"0;3;1"
    assert frames(ask, scope).shape == (3, 50)
    world.play(playback())
    ask(scope, "ACQuire:STATE RUN;*OPC?")
    assert frames(ask, scope).shape == (5, 50)


def test_frames_that_come_later(ask: Ask, read: Read, scope: VirtualDpo72504dx, world: Counted) -> None:
    world.play(None)
    fast_frame(ask, scope, 4)
    execution = scope.run(read("ACQuire:STATE RUN;:TRIGger FORCe;*OPC?")[0])
    next(execution)
    next(execution)
    world.play(playback())
    with pytest.raises(StopIteration):
        next(execution)
    assert [times.size for _, times in world.records] == [1, 3]
    assert frames(ask, scope).shape == (4, 50)


def test_a_burst_of_pictures(ask: Ask) -> None:
    """The frames of a projection are found even by a client that waited for the mirrors first."""
    world = lit(Parameters(simulated_modes_limit=20, chip_modes=50))
    scope = set_up(ask, world)
    world.play(playback(triggered=True))
    fast_frame(ask, scope, 5)
    ask(scope, "HORizontal:DELay:MODe ON;POSition 0;TIMe 50e-9")
    assert ask(scope, "ACQuire:STATE RUN;:TRIGger:A:READY?") == b"1"
    patterns = np.zeros((3, 768, 128), np.uint8)
    patterns[[0, 2]] = 255
    start_s = world.clock.now + 1e-3
    world.project(Projection(patterns, start_s, 1e-4))
    world.clock.advance(0.1)
    assert ask(scope, "ACQuire:NUMFRAMESACQuired?;STATE?") == b"3;1"
    assert ask(scope, "WFMOutpre:NR_FR?") == b"3"
    assert [times.size for _, times in world.records] == [3]
    assert world.records[0][1] == pytest.approx(start_s + 1e-4 * np.arange(3), abs=1e-6)
    seen = frames(ask, scope)
    world.project(Projection(patterns, world.clock.now + 1e-3, 1e-4))
    assert ask(scope, "*OPC?;:ACQuire:NUMFRAMESACQuired?;NUMACq?") == b"1;5;1"
    again = frames(ask, scope)
    assert np.array_equal(again[:3], seen)
    bright = again.mean(axis=1)
    assert min(bright[[1, 3, 4]]) > max(bright[[0, 2]]) + 5  # mirrors move after the pulse: the picture before


def test_running_until_stopped_keeps_the_last_frames(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    fast_frame(ask, scope, 4, ";SEQuence LAST")
    ask(scope, "TRIGger:A:HOLDoff:BY TIMe;TIMe 1e-3;:ACQuire:STATE RUN")
    world.clock.advance(0.0205)
    counted = int(ask(scope, "ACQuire:NUMFRAMESACQuired?"))
    assert counted in (20, 21)
    assert world.records == []
    with pytest.raises(BlockingIOError):
        ask(scope, "*OPC?")
    assert int(ask(scope, "ACQuire:STATE STOP;NUMFRAMESACQuired?")) == counted
    ((_, times),) = world.records
    assert times.size == 4
    assert world.clock.now - times[-1] < 1e-3
    world.clock.advance(1e-8)
    ask(scope, "ACQuire:STATE RUN;STATE STOP")
    assert frames(ask, scope).shape == (4, 50)
    world.play(None)
    ask(scope, "ACQuire:STATE RUN;STATE STOP")
    assert len(world.records) == 2


def test_summary_frames(ask: Ask, scope: VirtualDpo72504dx) -> None:
    fast_frame(ask, scope, 9, ";SUMFrame AVErage")
    ask(scope, "ACQuire:STATE RUN;*OPC?")
    whole = frames(ask, scope)
    assert whole.shape == (9, 50)
    assert np.abs(whole[-1] - whole[:-1].mean(axis=0)).max() <= 0.5
    ask(scope, "HORizontal:FASTframe:SIXteenbit ON;:WFMOutpre:BYT_Nr 2;:ACQuire:STATE RUN;*OPC?")
    fine = frames(ask, scope, dtype="<i2")
    assert not np.any(fine[:-1] % 256)
    assert np.abs(fine[-1] - fine[:-1].mean(axis=0)).max() <= 0.5
    ask(scope, "HORizontal:FASTframe:SUMFrame ENVelope;:WFMOutpre:BYT_Nr 1;:ACQuire:STATE RUN;*OPC?")
    whole = frames(ask, scope)
    assert whole[-1, 0] == whole[:-1, :2].min()
    assert whole[-1, 1] == whole[:-1, :2].max()


def test_a_single_frame_has_no_summary() -> None:
    codes = np.zeros((2, 1, 5), np.int8)
    assert summarised(codes, "AVErage", fine=True) is codes


def test_frames_and_memory(ask: Ask, scope: VirtualDpo72504dx) -> None:
    assert ask(scope, "HORizontal:FASTframe:MAXFRames?;LENgth?") == b"625000;50"
    ask(scope, "HORizontal:FASTframe:COUNt 625000;LENgth 250")
    assert ask(scope, "HORizontal:FASTframe:COUNt?;MAXFRames?;:HORizontal:MODE:RECOrdlength?") == b"125000;125000;250"
    ask(scope, "HORizontal:FASTframe:COUNt 125001")
    assert events(ask, scope) == "222"
    ask(scope, "*RST")
    state = ask(scope, "HORizontal:FASTframe:STATE?;SEQuence?;SUMFrame?;SIXteenbit?;TRACk?;FRAMELock?")
    assert state == b"0;FIRST;NONE;0;LIVE;1"


def test_frames_look_behind_the_trigger(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    fast_frame(ask, scope, 3)
    ask(scope, "HORizontal:MAIn:DELay:MODe ON;POSition 0;TIMe 200e-9;:ACQuire:STATE RUN;*OPC?")
    acquisition, _ = world.records[0]
    assert acquisition.start_s == pytest.approx(200e-9, abs=1e-15)
    assert ask(scope, "WFMOutpre:PT_Off?") == b"-5000"


def test_free_running_frames_are_new_with_each_transfer(ask: Ask, scope: VirtualDpo72504dx) -> None:
    fast_frame(ask, scope, 3)
    ask(scope, "ACQuire:STOPAfter RUNSTop;STATE RUN")
    assert ask(scope, "CURVe?") != ask(scope, "CURVe?")
    assert ask(scope, "ACQuire:NUMFRAMESACQuired?;NUMACq?") == b"2;2"


# --- acquisition modes


@pytest.mark.parametrize("mode", ["HIRes", "PEAKdetect"])
def test_oversampling_modes_exist_below_the_base_rate_only(
    ask: Ask, scope: VirtualDpo72504dx, world: Counted, mode: str
) -> None:
    ask(scope, f"ACQuire:MODe {mode}")
    assert ask(scope, "ACQuire:MODe?;MODe:ACTUal?").decode() == f"{mode.upper()};SAMPLE"
    ask(scope, "HORizontal:MODE:SAMPLERate 3.125e9;:HORizontal:MODE:RECOrdlength 64;:ACQuire:STATE RUN;*OPC?")
    assert ask(scope, "ACQuire:MODe:ACTUal?").decode() == mode.upper()
    acquisition, _ = world.records[0]
    assert (acquisition.sample_rate, acquisition.samples) == (6.25e9, 128)
    assert acquisition.start_s == pytest.approx(-0.5 / 6.25e9)
    assert ask(scope, "WFMOutpre:PT_Fmt?;NR_Pt?") == (b"ENV;64" if mode == "PEAKdetect" else b"Y;64")
    ask(scope, "WFMOutpre:BYT_Nr 2")
    points = block(ask(scope, "CURVe?"), "<i2")
    if mode == "PEAKdetect":
        assert np.all(points[0::2] <= points[1::2])
    else:
        assert set(points % 256) == {0, 128}


def test_envelope(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    ask(scope, "ACQuire:MODe ENVelope;NUMEnv 30;STATE RUN;*OPC?")
    assert (
        ask(scope, "ACQuire:MODe:ACTUal?;:ACQuire:NUMACq?;NUMEnv?;:WFMOutpre:PT_Fmt?;NR_FR?") == b"ENVELOPE;30;30;ENV;1"
    )
    wide = block(ask(scope, "CURVe?"))
    assert np.all(wide[0::2] < wide[1::2])
    ask(scope, "ACQuire:NUMEnv 2001")
    assert ask(scope, "ACQuire:NUMEnv?") == b"INFINITE"
    ask(scope, "ACQuire:STATE RUN;*OPC?")
    assert ask(scope, "ACQuire:NUMACq?") == b"2000"


def test_an_odd_number_of_envelope_points() -> None:
    low, high = np.array([3, 1, 2], np.int8), np.array([4, 9, 5], np.int8)
    assert list(interleaved(low, high)) == [1, 9, 2]


def test_each_next_curve_is_new(ask: Ask, read: Read, scope: VirtualDpo72504dx, world: Counted) -> None:
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


# --- triggers


def test_both_slopes(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    ask(scope, "TRIGger:A:EDGE:SLOpe EITher;:ACQuire:MODe AVErage;NUMAVg 6;STATE RUN;*OPC?")
    phases = world.records[0][1] * 25e9 % PERIOD
    assert set(np.rint(phases)) <= {0.0, 50.0, float(PERIOD)}
    world.play(None)
    with pytest.raises(BlockingIOError):
        ask(scope, "ACQuire:STATE RUN;*OPC?")


def test_mains_trigger(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    world.play(None)
    fast_frame(ask, scope, 3)
    ask(scope, "TRIGger:A:EDGE:SOUrce LINE;:ACQuire:STATE RUN;*OPC?")
    assert np.diff(world.records[0][1]) == pytest.approx(20e-3)


def test_free_running_in_automatic_mode(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    ask(scope, "TRIGger:A:MODe AUTO;:ACQuire:STOPAfter RUNSTop;STATE RUN")
    assert ask(scope, "TRIGger:STATE?") == b"TRIGGER"
    world.play(None)
    assert ask(scope, "TRIGger:STATE?") == b"AUTO"
    assert len(block(ask(scope, "CURVe?"))) == 50
    ask(scope, "TRIGger:A:MODe NORMal")
    assert ask(scope, "TRIGger:STATE?;:ACQuire:STATE STOP;:TRIGger:STATE?") == b"READY;SAVE"


def test_words_that_change_no_light(ask: Ask, scope: VirtualDpo72504dx) -> None:
    for command, word in [
        ("TRIGger:A:EDGE:COUPling", "NOISEREJ"),
        ("TRIGger:A:HOLDoff:BY", "RANDOM"),
        ("AUXout:SOUrce", "EVENT"),
        ("AUXout:EDGE", "FALLING"),
        ("ACQuire:SAMPlingmode", "IT"),
        ("ACQuire:INTERPEightbit", "ON"),
        ("ACQuire:ENHANCEDEnob", "AUTO"),
        ("DATa:SYNCSOUrces", "1"),
        ("HORizontal:ROLL", "ON"),
        ("HORizontal:FASTframe:TRACk", "ALL"),
        ("HORizontal:FASTframe:REF:SOUrce", "CH2"),
        ("HORizontal:FASTframe:MULtipleframes:MODe", "OVERLAY"),
        ("HORizontal:FASTframe:MULtipleframes:NUMFRames:CH2", "3"),
        ("CH1:BANdwidth:ENHanced", "OFF"),
        ("CH1:BANdwidth:ENHanced:FORCe", "1"),
        ("CH1:BANdwidth:ENHanced:APPLYtoall", "1"),
    ]:
        assert ask(scope, f"{command} {word}\n{command}?").decode() == word, command
    assert events(ask, scope) == ""


# --- vertical


def test_vertical_reply_forms(ask: Ask, scope: VirtualDpo72504dx) -> None:
    assert ask(scope, "CH1:TERmination?;BANdwidth:ENHanced:STATE?") == b"50.0000;1"
    for word, realised in [("TWEnty", 20e6), ("ONEfifty", 150e6), ("TWOfifty", 250e6), ("FIVe", 5e6), ("FULl", 25e9)]:
        assert float(ask(scope, f"CH1:BANdwidth {word}\nCH1:BANdwidth?")) == realised
    ask(scope, "CH1:VTERm:BIAS 0.5;:CH1:DESKew 90e-12")
    assert [float(ask(scope, query)) for query in ("CH1:VTERm:BIAS?", "CH1:DESKew?")] == pytest.approx([0.5, 80e-12])


def test_a_lower_bandwidth_smooths(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "HORizontal:MODE:RECOrdlength 1000;:ACQuire:STATE RUN")
    full = block(ask(scope, "CURVe?"))
    ask(scope, "CH1:BANdwidth 1e9;:ACQuire:STATE RUN")
    limited = block(ask(scope, "CURVe?"))
    assert limited.std() < 0.7 * full.std()
    assert limited.mean() == pytest.approx(full.mean(), abs=2)


def test_a_grounded_input_shows_noise_about_zero(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "CH1:COUPling GND;OFFSet 0;:ACQuire:STATE RUN;:HORizontal:MODE:RECOrdlength 1000")
    codes = block(ask(scope, "CURVe?"))
    assert abs(codes.mean()) < 1
    assert 0.5 < codes.std() < 3


def test_external_attenuation_scales_the_volts(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "CH1:OFFSet 0;SCAle 0.02;:ACQuire:STATE RUN")
    plain = block(ask(scope, "CURVe?"))
    ask(scope, "CH1:PROBEFunc:EXTDBatten 20;:CH1:SCAle 0.2;:ACQuire:STATE RUN")
    assert float(ask(scope, "CH1:PROBEFunc:EXTAtten?")) == pytest.approx(10)
    assert float(ask(scope, "CH1:PROBEFunc:EXTDBatten?")) == pytest.approx(20)
    assert np.abs(block(ask(scope, "CURVe?")) - plain).mean() < 5


def test_deskew_samples_later(ask: Ask, scope: VirtualDpo72504dx, world: Counted) -> None:
    ask(scope, "HORizontal:MODE:RECOrdlength 500;:ACQuire:STATE RUN")
    plain = block(ask(scope, "CURVe?"))
    ask(scope, "CH1:DESKew 4e-9;:ACQuire:STATE RUN")
    later = block(ask(scope, "CURVe?"))
    assert [acquisition.channels for acquisition, _ in world.records] == [(1, 2), (1,), (2,)]
    assert np.corrcoef(plain[100:], later[:-100])[0, 1] > 0.9
