"""The virtual generator's run control: assignment, run modes, triggers, and what the world hears of it."""

import math

import numpy as np
import pytest

from sim_backends.virtual import VirtualAwg70002a
from sim_backends.virtual.awg70002a.schedule import Schedule
from tests.sim_backends.virtual.awg70002a.session import MARKERS, SAMPLES, errors, float_block, start, upload
from tests.sim_backends.virtual.watched import Ask, Watched


def test_the_session_of_the_manual_plays(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    start(ask, awg)
    assert ask(awg, "AWGControl:RSTate?;:OUTP?;:OUTP:OFF?") == b"2;1;0"
    (playback,) = world.played
    assert playback is not None
    assert (playback.sample_rate, playback.marker_low_v, playback.marker_high_v) == (25e9, 0.0, 1.0)
    assert np.array_equal(playback.marker, MARKERS != 0)
    assert np.abs(playback.volts - 0.25 * SAMPLES).max() <= 0.25 / 255
    assert playback.period == pytest.approx(100e-9)


def test_the_clock_is_charged_for_run(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    start(ask, awg)
    before = world.clock.now
    ask(awg, "AWGC:RUN;*OPC")
    assert ask(awg, "*ESR?") == b"0"  # a poll takes 0.1 s
    assert ask(awg, "*OPC?;*ESR?") == b"1;1"
    assert world.clock.now - before == pytest.approx(1.0)
    ask(awg, "AWGC:RUN\n*WAI")
    assert world.clock.now - before == pytest.approx(2.0)


@pytest.mark.parametrize(("bits", "marked"), [(8, True), (9, True), (10, False)])
def test_resolution(ask: Ask, awg: VirtualAwg70002a, world: Watched, bits: int, marked: bool) -> None:
    start(ask, awg, bits)
    playback = world.played[-1]
    assert playback is not None
    assert playback.marker.any() == marked
    steps = np.unique(playback.volts) / 0.25 * (2 ** (bits - 1) - 1)
    assert np.allclose(steps, np.rint(steps), atol=1e-3)
    assert len(steps) < 2**bits


def test_samples_beyond_full_scale_are_clipped(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    start(ask, awg)
    loud = np.tile(np.array([3.0, -np.inf, 1.0, -1.0, np.nan], np.float32), 500)
    ask(awg, b'WLIS:WAV:DATA "m",' + float_block(loud))
    playback = world.played[-1]
    assert playback is not None
    assert playback.volts[:5].tolist() == [0.25, -0.25, 0.25, -0.25, 0.0]
    block = ask(awg, 'WLIS:WAV:DATA? "m",0,3')
    assert np.frombuffer(block[4:], "<f4").tolist() == [3.0, -np.inf, 1.0]


@pytest.mark.parametrize(
    ("command", "plays"),
    [
        ("SOUR1:VOLT 0.3", True),
        ("SOUR1:VOLT:HIGH 0.2", True),
        ("SOUR1:VOLT:LOW -0.15", True),
        ("CLOC:SRAT 12.5e9", True),
        ("SOUR:FREQ 10e9", True),
        ("SOUR1:MARK1:VOLT:HIGH 1.2", True),
        ('WLIS:WAV:NORM "m",FSC', True),
        ("OUTP1 0", False),
        ("OUTP:OFF 1", False),
        ("AWGC:STOP", False),
        ("SOUR1:RMOD TRIG", True),
        ("INST:MODE FGEN", True),
        ("SOUR1:MARK1:DEL 1e-10", True),
        ("SOUR1:SKEW 2e-10", True),
        ("CLOC:SOUR EXT", False),
        ("CLOC:SOUR EFIX", False),
        ("SOUR1:CASS:CLE", False),
        ('SOUR1:WAV ""', True),
        ("WLIS:WAV:DEL ALL", False),
        ("*RST", False),
    ],
)
def test_what_changes_the_output(ask: Ask, awg: VirtualAwg70002a, world: Watched, command: str, plays: bool) -> None:
    start(ask, awg)
    world.played.clear()
    ask(awg, command)
    assert [playback is not None for playback in world.played] == ([plays] if command != 'SOUR1:WAV ""' else [])


@pytest.mark.parametrize(
    "command", ["SOUR1:VOLT 0.5", "OUTP1 1", "SOUR2:VOLT 0.3", "TRIG:LEV 1", "SOUR1:DAC:RES 7", "OUTP2 1", "SYST:ERR?"]
)
def test_what_does_not(ask: Ask, awg: VirtualAwg70002a, world: Watched, command: str) -> None:
    start(ask, awg)
    world.played.clear()
    ask(awg, command)
    assert world.played == []


def test_running_needs_an_assignment(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "AWGC:RUN")
    assert ask(awg, "AWGC:RST?") == b"0"
    assert errors(ask, awg) == "-221"


def test_deleting_what_plays_stops_the_run(ask: Ask, awg: VirtualAwg70002a) -> None:
    start(ask, awg)
    upload(ask, awg, name="other")
    ask(awg, 'WLIS:WAV:DEL "other"')
    assert ask(awg, "AWGC:RST?;:OUTP1?") == b"2;1"
    ask(awg, 'WLIS:WAV:DEL "m"')
    assert ask(awg, "AWGC:RST?;:OUTP1?;:SOUR1:CASS?;CASS:TYPE?") == b'0;0;"";NONE'


def test_triggered_modes(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    start(ask, awg)
    ask(awg, "*OPC?;:SOUR1:RMOD TCON")
    playback = world.played[-1]
    assert playback is not None
    assert (playback.lengths, playback.runs_on) == ((2500,), True)
    assert ask(awg, "AWGC:RST?;:SOUR1:RMOD?") == b"1;TCON"
    ask(awg, "TRIG BTR")
    assert ask(awg, "AWGC:RST?") == b"1"
    assert world.triggers == 0
    ask(awg, "TRIGger:SEQuence:IMMediate ATRigger")
    assert ask(awg, "AWGC:RST?") == b"2"
    assert world.triggers == 1
    ask(awg, "AWGC:STOP;:AWGC:RUN;*OPC?")
    assert ask(awg, "AWGC:RST?") == b"1"
    ask(awg, "*TRG;*TRG")  # the second finds it running already
    assert ask(awg, "AWGC:RST?") == b"2"
    assert world.triggers == 2
    world.clock.advance(1.0)
    ask(awg, "AWGC:RMOD TRIG")
    assert ask(awg, "AWGC:RST?;RMOD?") == b"1;TRIG"
    playback = world.played[-1]
    assert playback is not None
    assert (playback.lengths, playback.runs_on) == ((2500,), False)
    for _ in range(3):
        ask(awg, "*TRG")
        assert ask(awg, "AWGC:RST?") == b"2"
        world.clock.advance(1e-6)
        assert ask(awg, "AWGC:RST?") == b"1"
    assert world.triggers == 5
    ask(awg, "AWGC:STOP;*TRG")
    assert world.triggers == 5


def test_every_change_of_the_run_mode_is_played(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    """However often: what was compiled for a mode may lie where in memory that of the mode before lay."""
    start(ask, awg)
    others: list[Schedule] = []
    for turn in range(2000):
        others = [Schedule(()) for _ in range(turn % 7)] + others[: turn % 19]
        ask(awg, f"*OPC?;:SOUR1:RMOD {('TCON', 'TRIG')[turn % 2]}")
        assert world.last is not None
        assert world.last.runs_on == (turn % 2 == 0), turn


def test_what_the_trigger_input_listens_to(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    start(ask, awg)
    assert world.level == (math.inf, True)
    ask(awg, "SOUR1:RMOD TRIG")
    assert world.level == (2.8, True), "50 ohm from 50 ohm: half of it is there"
    ask(awg, "TRIG:LEV 0.5;SLOP NEG")
    assert world.level == (1.0, False)
    ask(awg, "TRIG:IMP 1000")
    assert world.level[0] == pytest.approx(0.525)
    ask(awg, "SOUR1:TINP BTR")
    assert world.level == (math.inf, False)
    ask(awg, "TRIG ATR")
    assert world.triggers == 0
    ask(awg, "TRIG BTR")
    assert world.triggers == 1


@pytest.mark.parametrize("setting", ["SOUR1:TINP ITR", "TRIG:SOUR INT"])
def test_internal_triggers(ask: Ask, awg: VirtualAwg70002a, world: Watched, setting: str) -> None:
    start(ask, awg)
    ask(awg, f"TRIG:INT 1e-6;:{setting};:SOUR1:RMOD TRIG")
    playback = world.played[-1]
    assert playback is not None
    assert playback.lengths is None
    assert playback.period == pytest.approx(1e-6)
    assert not playback.volts[2500:].any()
    ask(awg, "SOUR1:RMOD TCON")
    playback = world.played[-1]
    assert playback is not None
    assert playback.period == pytest.approx(1e-7)
    assert ask(awg, "TRIG:INT?;:AWGC:RST?") == b"1.0000000000E-06;2"
    assert errors(ask, awg) == "0"


@pytest.mark.parametrize("mode", ["CONT", "TRIG", "TCON"])
def test_marker_delay_and_skew(mode: str, ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    start(ask, awg)
    ask(awg, f"SOUR1:RMOD {mode};:SOUR1:MARK1:DEL 85e-12;:SOUR1:SKEW -12e-12")
    moved = world.played[-1]
    assert moved is not None
    assert (moved.marker_delay_s, moved.skew_s) == (85e-12, -12e-12)


def test_coupled_run_modes(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "SOUR2:RMOD TRIG")
    assert ask(awg, "SOUR1:RMOD?;:SOUR2:RMOD?") == b"CONT;TRIG"
    ask(awg, "SOUR:RCC 1;:SOUR2:RMOD TCON")
    assert ask(awg, "SOUR1:RMOD?;:SOUR2:RMOD?;:SOUR:RCC?") == b"TCON;TCON;1"
    ask(awg, "SOUR:RCC 0;:SOUR1:TINP BTR;:SOUR1:RMOD CONT")
    assert ask(awg, "SOUR2:TINP?;RMOD?") == b"ATR;TCON"
    ask(awg, "SOUR:RCC 1")
    assert ask(awg, "SOUR2:TINP?;RMOD?") == b"BTR;CONT"


def test_coupled_channels(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "INST:COUP:SOUR 1;:SOUR1:VOLT 0.3;:SOUR1:DAC:RES 8;:SOUR1:MARK2:VOLT:HIGH 1.2")
    assert ask(awg, "SOUR2:DAC:RES?;:SOUR2:VOLT?;:SOUR2:MARK2:VOLT:HIGH?") == b"8;3.0000000000E-01;1.2000000000E+00"
