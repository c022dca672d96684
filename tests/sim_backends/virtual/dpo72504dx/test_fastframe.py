"""FastFrame of the virtual oscilloscope: frames, their time stamps and offsets, summaries."""

import re

import numpy as np
import pytest

from sim_backends.parameters import Parameters
from sim_backends.virtual import VirtualDpo72504dx
from sim_backends.virtual.oscilloscope.fastframe import date_stamp, duration_stamp
from sim_backends.virtual.oscilloscope.modes import summarised
from sim_backends.world.signals import Projection
from tests.sim_backends.virtual.dpo72504dx.session import (
    SHORT_RECORDS,
    events,
    fast_frame,
    frames,
    lit,
    playback,
    set_up,
)
from tests.sim_backends.virtual.watched import Ask, Read, Watched


@pytest.fixture
def session() -> tuple[str, ...]:
    return SHORT_RECORDS


STAMP = re.compile(rb'\d{2} [A-Z]{3} \d{4} \d{2}:\d{2}:\d{2}\.(\d{3} \d{3} \d{3} \d{3})"')


def picoseconds(reply: bytes) -> list[int]:
    return [int(found.replace(b" ", b"")) for found in STAMP.findall(reply)]


def test_frames_of_one_record(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
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


def test_there_is_room_for_a_frame_however_long_it_is(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "HORizontal:MODE MANual;:HORizontal:FASTframe:STATE ON;:HORizontal:FASTframe:SUMFrame AVErage")
    ask(scope, "HORizontal:MODE:RECOrdlength 31250000")
    assert ask(scope, "HORizontal:FASTframe:MAXFRames?;COUNt?") == b"1;1"


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


def test_time_stamps(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    fast_frame(ask, scope, 5)
    ask(scope, "TRIGger:A:HOLDoff:BY TIMe;TIMe 1e-3;:ACQuire:STATE RUN;*OPC?")
    _, times = world.records[0]
    stamps = "HORizontal:FASTframe:TIMEStamp:"
    reply = ask(scope, f"{stamps}ALL:CH2? 5,1")
    assert re.fullmatch(rb'(?:"\d: [^"]*",?){5}', reply)
    assert picoseconds(reply) == pytest.approx(times * 1e12, abs=1)
    one = ask(scope, f"{stamps}FRAMe:CH1? 3")
    assert one.startswith(b'"01 JAN 2026 00:00:00.4')
    assert picoseconds(one) == [picoseconds(reply)[2]]
    assert ask(scope, f"{stamps}BETWeen:CH1? 1,2") == b'"00:00:00.001 000 000 000"'
    assert ask(scope, f"{stamps}BETWeen:CH1? 3,1") == b'"-00:00:00.002 000 000 000"'
    ask(scope, "HORizontal:FASTframe:SELECTED:CH1 3;:HORizontal:FASTframe:REF:FRAme 2")
    assert ask(scope, f"{stamps}DELTa:CH1?") == b'"00:00:00.001 000 000 000"'
    assert ask(scope, f"{stamps}SELECTED:CH1?") == one
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
    every = [item.split(": ") for item in ask(scope, "HORizontal:FASTframe:XZEro:ALL:CH1? 1,8").decode().split(",")]
    assert [number for number, _ in every] == [f'"{number}' for number in range(1, 9)]
    offsets = [float(word.removesuffix('"')) for _, word in every]
    assert len(set(offsets)) == 8
    assert max(map(abs, offsets)) <= 20e-12
    assert float(ask(scope, "HORizontal:FASTframe:XZEro:FRAme:CH1? 4")) == offsets[3]
    ask(scope, "DATa:FRAMESTARt 6")
    assert float(ask(scope, "WFMOutpre:XZEro?")) == offsets[5]
    ask(scope, "ACQuire:SYNcsamples ON;STATE RUN;*OPC?")
    assert float(ask(scope, "WFMOutpre:XZEro?")) == 0.0


def test_forced_frames_and_a_stop_before_the_last(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
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


def test_frames_that_come_later(ask: Ask, read: Read, scope: VirtualDpo72504dx, world: Watched) -> None:
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
    world = lit(Parameters(chip_modes=50))
    scope = set_up(ask, world)
    world.play(playback(triggered=True))
    fast_frame(ask, scope, 5)
    ask(scope, "HORizontal:DELay:MODe ON;POSition 0;TIMe 50e-9")
    assert ask(scope, "ACQuire:STATE RUN;:TRIGger:A:READY?") == b"1"
    pictures = np.zeros((3, 784), np.uint16)
    pictures[[0, 2]] = 729
    start_s = world.clock.now + 1e-3
    world.project(Projection(pictures, start_s, 1e-4))
    world.clock.advance(0.1)
    assert ask(scope, "ACQuire:NUMFRAMESACQuired?;STATE?") == b"3;1"
    assert ask(scope, "WFMOutpre:NR_FR?") == b"3"
    assert [times.size for _, times in world.records] == [3]
    assert world.records[0][1] == pytest.approx(start_s + 1e-4 * np.arange(3), abs=1e-6)
    seen = frames(ask, scope)
    world.project(Projection(pictures, world.clock.now + 1e-3, 1e-4))
    assert ask(scope, "*OPC?;:ACQuire:NUMFRAMESACQuired?;NUMACq?") == b"1;5;1"
    again = frames(ask, scope)
    assert np.array_equal(again[:3], seen)
    bright = again.mean(axis=1)
    assert min(bright[[1, 3, 4]]) > max(bright[[0, 2]]) + 5  # mirrors move after the pulse: the picture before


def test_running_until_stopped_keeps_the_last_frames(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
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
    assert ask(scope, "HORizontal:FASTframe:MAXFRames?;LENgth?") == b"62500;500"
    ask(scope, "HORizontal:FASTframe:STATE ON;LENgth 50")
    assert ask(scope, "HORizontal:FASTframe:MAXFRames?;LENgth?") == b"625000;50"
    ask(scope, "HORizontal:FASTframe:COUNt 625000;LENgth 250")
    assert ask(scope, "HORizontal:FASTframe:COUNt?;MAXFRames?;:HORizontal:MODE:RECOrdlength?") == b"125000;125000;250"
    ask(scope, "HORizontal:FASTframe:COUNt 125001")
    assert events(ask, scope) == "222"
    ask(scope, "HORizontal:FASTframe:COUNt 125000;SUMFrame AVErage")
    assert ask(scope, "HORizontal:FASTframe:COUNt?") == b"124998", "a summary takes the memory of two frames"
    ask(scope, "HORizontal:FASTframe:COUNt 124999")
    assert events(ask, scope) == "222"
    ask(scope, "*RST")
    state = ask(scope, "HORizontal:FASTframe:STATE?;SEQuence?;SUMFrame?;SIXteenbit?;TRACk?;FRAMELock?")
    assert state == b"0;FIRST;NONE;0;LIVE;1"


def test_frames_look_behind_the_trigger(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
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


def test_frames_of_pictures_that_are_forgotten_are_refused(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    fast_frame(ask, scope, 10)
    patterns = np.random.default_rng(1).integers(0, 256, (17, 768, 128), np.uint8)
    for shown, taken in ((patterns[:3], 10), (patterns, 0)):
        ask(scope, "CLEAR ALL;:ACQuire:STATE RUN")
        for pattern in shown:
            world.clock.advance(1e-3)
            world.show(pattern)
        assert ask(scope, "ACQuire:NUMFRAMESACQuired?") == (b"%d" % taken if taken else b"")
    assert events(ask, scope) == "225"
    assert ask(scope, "ACQuire:STATE?") == b"0"
