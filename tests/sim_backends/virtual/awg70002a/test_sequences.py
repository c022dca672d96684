"""Sequences of the virtual AWG: the list, and how they play."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.virtual import VirtualAwg70002a
from sim_backends.world.signals import Playback
from tests.sim_backends.virtual.awg70002a.session import errors, float_block
from tests.sim_backends.virtual.watched import Ask, Watched

LENGTHS = {"a": 2400, "b": 2500, "c": 2600}
LEVELS = {"a": 0.25, "b": 0.5, "c": 1.0}


@pytest.fixture
def awg(awg: VirtualAwg70002a, ask: Ask) -> VirtualAwg70002a:
    """Three constant waveforms whose level tells which one plays."""
    for name, length in LENGTHS.items():
        ask(awg, f'WLIS:WAV:NEW "{name}",{length}')
        ask(awg, f'WLIS:WAV:DATA "{name}",'.encode() + float_block(np.full(length, LEVELS[name], np.float32)))
    return awg


def make(ask: Ask, awg: VirtualAwg70002a, *steps: str, name: str = "s") -> None:
    """A sequence: each step is a waveform's name, behind it commands of the step: `"a RCO INF"`."""
    ask(awg, f'SLIS:SEQ:NEW "{name}",{len(steps)}')
    for number, (asset, *rest) in enumerate((step.split() for step in steps), 1):
        kind = "WAV" if asset in LENGTHS else "SEQ"
        ask(awg, f'SLIS:SEQ:STEP{number}:TASS:{kind} "{name}","{asset}"')
        for node, value in zip(rest[::2], rest[1::2], strict=True):
            ask(awg, f'SLIS:SEQ:STEP{number}:{node} "{name}",{value}')


def run(ask: Ask, awg: VirtualAwg70002a, mode: str = "CONT") -> None:
    ask(awg, f'SOUR1:CASS:SEQ "s",1;:SOUR1:RMOD {mode};:OUTP1 1;:AWGC:RUN;*OPC?')
    assert errors(ask, awg) == "0"


def parts(playback: Playback | None) -> list[str]:
    """The segments of a playback, each as the names of what plays, one a whole waveform; 0 is silence."""
    assert playback is not None
    lengths = playback.lengths or (playback.volts.size,)
    return ["".join(_names(segment)) for segment in np.split(playback.volts, np.cumsum(lengths)[:-1])]


def _names(segment: NDArray[np.float32]) -> list[str]:
    names = []
    while segment.size:
        name = next((n for n, level in LEVELS.items() if abs(segment[0] - level / 4) < 1e-2), "0")
        length = LENGTHS.get(name, segment.size)
        assert np.ptp(segment[:length]) == 0
        names.append(name)
        segment = segment[length:]
    return names


def test_the_list(ask: Ask, awg: VirtualAwg70002a) -> None:
    make(ask, awg, "a", "b", "c")
    ask(awg, 'SLIS:SEQ:NEW "t",2,2')
    assert ask(awg, "SLIS:SIZE?;NAME? 1;NAME? 2") == b'2;"s";"t"'
    assert ask(awg, 'SLIS:SEQ:LENG? "s";TRAC? "t"') == b"3;2"
    assert ask(awg, "SLIS:SEQ:STEP:MAX?;RCO:MAX?;:SLIS:SEQ:TRAC:MAX?") == b"16383;1048576;8"
    assert ask(awg, 'SLIS:SEQ:STEP2:TASS1? "s";TASS1:TYPE? "s"') == b'"b";WAV'
    assert ask(awg, 'SLIS:SEQ:STEP1:TASS2? "t";TASS2:TYPE? "t"') == b'"";NONE'
    ask(awg, 'SLIS:SEQ:DEL "s"')
    assert ask(awg, "SLIS:SIZE?;NAME? 1") == b'1;"t"'
    ask(awg, "SLIS:SEQ:DEL ALL")
    assert ask(awg, "SLIS:SIZE?") == b"0"
    assert errors(ask, awg) == "0"


@pytest.mark.parametrize(
    ("node", "default", "value", "reply"),
    [
        ("STEP1:WINP", "OFF", "ATRigger", "ATR"),
        ("STEP1:RCO", "ONCE", "INFinite", "INF"),
        ("STEP2:RCO", "ONCE", "1048576", "1048576"),
        ("STEP1:GOTO", "NEXT", "FIRS", "FIRS"),
        ("STEP1:GOTO", "NEXT", "2", "2"),
        ("STEP1:EJIN", "OFF", "BTR", "BTR"),
        ("STEP1:EJUM", "NEXT", "LAST", "LAST"),
        ("STEP1:TFL1:AFL", "NCH", "TOGG", "TOGG"),
        ("STEP2:TFL1:DFL", "NCH", "PULS", "PULS"),
        ("EVEN:JTIM", "END", "IMM", "IMM"),
        ("SRAT", "9.9100000000E+37", "1e10", "1.0000000000E+10"),
        ("AMPL", "9.9100000000E+37", "0.3", "3.0000000000E-01"),
        ("OFFS", "9.9100000000E+37", "0.1", "1.0000000000E-01"),
    ],
)
def test_settings(ask: Ask, awg: VirtualAwg70002a, node: str, default: str, value: str, reply: str) -> None:
    make(ask, awg, "a", "b")
    assert ask(awg, f'SLIS:SEQ:{node}? "s"').decode() == default
    ask(awg, f'SLIS:SEQ:{node} "s",{value}')
    assert ask(awg, f'SLIS:SEQ:{node}? "s"').decode() == reply
    assert errors(ask, awg) == "0"


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ('SLIS:SEQ:NEW "s",3', -224),
        ('SLIS:SEQ:NEW "",3', -224),
        ('SLIS:SEQ:NEW "x",0', -222),
        ('SLIS:SEQ:NEW "x",16384', -222),
        ('SLIS:SEQ:LENG? "x"', -224),
        ("SLIS:NAME? 2", -222),
        ('SLIS:SEQ:STEP3:WINP "s",ATR', -222),
        ('SLIS:SEQ:STEP1:WINP "s",CTR', -224),
        ('SLIS:SEQ:STEP1:RCO "s",1048577', -222),
        ('SLIS:SEQ:STEP1:GOTO "s",BACK', -224),
        ('SLIS:SEQ:STEP1:TASS2:WAV "s","a"', -222),
        ('SLIS:SEQ:STEP1:TASS1:WAV "s","x"', -224),
        ('SLIS:SEQ:STEP1:TASS:SEQ "s","s"', -221),
        ('SLIS:SEQ:STEP1:TASS:SEQ "s","x"', -224),
        ('SLIS:SEQ:STEP1:TFL2:AFL "s",HIGH', -222),
        ('SLIS:SEQ:STEP16384:WINP "s",OFF', -114),
        ('SLIS:SEQ:STEP:ADD "s",16383,2', -222),
        ('SOUR1:CASS:SEQ "s",2', -222),
        ('SLIS:SEQ:SRAT "s",1', -222),
    ],
)
def test_errors(ask: Ask, awg: VirtualAwg70002a, command: str, code: int) -> None:
    make(ask, awg, "a", "b")
    assert ask(awg, command) == b""
    assert errors(ask, awg) == str(code)


def test_adding_steps(ask: Ask, awg: VirtualAwg70002a) -> None:
    make(ask, awg, "a", "b")
    ask(awg, 'SLIS:SEQ:STEP:ADD "s",2')
    assert ask(awg, 'SLIS:SEQ:LENG? "s";STEP2:TASS1? "s";:SLIS:SEQ:STEP3:TASS1? "s"') == b'3;"";"b"'
    ask(awg, 'SLIS:SEQ:STEP:ADD "s",7,2')
    assert ask(awg, 'SLIS:SEQ:LENG? "s"') == b"8"
    assert errors(ask, awg) == "0"


@pytest.mark.parametrize(
    ("steps", "mode", "expected", "runs_on"),
    [
        (("a", "b", "c"), "CONT", ["abc"], None),
        (("a", "b RCO 3"), "CONT", ["abbb"], None),
        (("a", "b RCO INF"), "CONT", ["b"], None),
        (("a", "b", "c GOTO 2"), "CONT", ["bc"], None),
        (("a GOTO LAST", "b", "c"), "CONT", ["ac"], None),
        (("a GOTO END", "b"), "CONT", None, None),
        (("a WINP ATR", "b WINP ATR", "c WINP ATR"), "CONT", ["a", "b", "c"], False),
        (("a", "b WINP ATR", "c"), "CONT", ["bca"], False),
        (("a WINP ATR", "b RCO INF"), "CONT", ["b"], True),
        (("a WINP ATR RCO INF", "b"), "CONT", ["a"], True),
        (("a WINP ATR", "b WINP ATR RCO INF"), "CONT", ["a", "b"], True),
        (("a WINP ATR", "b GOTO END", "c"), "CONT", ["ab", "0"], True),
        (("a", "b"), "TRIG", ["ab"], False),
        (("a", "b WINP ATR"), "TRIG", ["a", "b"], False),
        (("a GOTO END", "b"), "TRIG", ["a", "0"], True),
        (("a", "b"), "TCON", ["ab"], True),
    ],
)
def test_playing(
    ask: Ask,
    awg: VirtualAwg70002a,
    world: Watched,
    steps: tuple[str, ...],
    mode: str,
    expected: list[str] | None,
    runs_on: bool | None,
) -> None:
    make(ask, awg, *steps)
    run(ask, awg, mode)
    if expected is None:
        assert world.last is None
        assert ask(awg, "AWGC:RST?") == b"2"
        return
    assert world.last is not None
    assert parts(world.last) == expected
    assert (world.last.lengths is None) == (runs_on is None)
    assert world.last.runs_on == bool(runs_on)
    assert ask(awg, "AWGC:RST?") == (b"2" if runs_on is None else b"1")


def test_a_loop_behind_a_triggered_beginning_is_written_out(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    make(ask, awg, "a WINP ATR", "b WINP ATR", "c WINP ATR GOTO 2")
    run(ask, awg)
    found = parts(world.last)
    assert found[:5] == ["a", "b", "c", "b", "c"]
    assert len(found) > 500


def test_triggers_step_through(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    make(ask, awg, "a WINP ATR", "b WINP BTR", "c WINP ATR")
    run(ask, awg)
    assert ask(awg, "SOUR1:SCST?") == b"1"
    for trigger, step in (("BTR", b"1"), ("ATR", b"2"), ("ATR", b"2"), ("BTR", b"3"), ("ATR", b"1")):
        ask(awg, f"TRIG {trigger}")
        world.clock.advance(1e-3)
        assert ask(awg, "SOUR1:SCST?;:AWGC:RST?") == step + b";1"
    assert world.triggers == 3
    ask(awg, "TRIG ATR")
    assert ask(awg, "SOUR1:SCST?;:AWGC:RST?") == b"1;2"
    assert ask(awg, "AWGC:STOP;:SOUR1:SCST?") == b"0"


def test_forced_jumps(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    make(ask, awg, "a RCO INF", "b RCO INF", "c RCO INF")
    run(ask, awg)
    assert parts(world.last) == ["a"]
    for where, name, step in (("2", "b", "2"), ("LAST", "c", "3"), ("CURR", "c", "3"), ("FIRS", "a", "1")):
        ask(awg, f"SOUR1:JUMP:FORC {where}")
        assert parts(world.last) == [name]
        assert ask(awg, "SOUR1:SCST?").decode() == step
    ask(awg, "SOUR1:JUMP:FORC 4")
    assert errors(ask, awg) == "-222"
    ask(awg, "SOUR1:JUMP:FORC END")
    assert world.last is None
    assert ask(awg, "SOUR1:SCST?;:AWGC:RST?") == b"0;2"
    ask(awg, 'AWGC:RUN;*OPC?;:SOUR1:CASS:WAV "a";:SOUR1:JUMP:FORC 1')
    assert errors(ask, awg) == "-221"


def test_event_jumps(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    make(ask, awg, "a RCO INF EJIN ATR EJUM 3", "b", "c RCO INF EJIN BTR EJUM END")
    run(ask, awg)
    ask(awg, "TRIG BTR")
    assert parts(world.last) == ["a"]
    ask(awg, "*TRG")
    assert parts(world.last) == ["c"]
    ask(awg, "TRIG BTR")
    assert world.last is None
    assert world.triggers == 0


def test_subsequences(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    make(ask, awg, "a", "b", name="sub")
    make(ask, awg, "c", "sub RCO 2")
    assert ask(awg, 'SLIS:SEQ:STEP2:TASS1? "s";TASS1:TYPE? "s"') == b'"sub";SEQ'
    run(ask, awg)
    assert parts(world.last) == ["cabab"]
    assert ask(awg, "SOUR1:CASS?;CASS:TYPE?") == b'"s,1";SEQ'
    ask(awg, 'SLIS:SEQ:STEP2:RCO "s",INF')
    assert parts(world.last) == ["ab"]
    ask(awg, 'SLIS:SEQ:STEP2:WINP "s",ATR')
    assert parts(world.last) == ["ab"]
    ask(awg, 'SLIS:SEQ:STEP2:RCO "sub",INF')
    assert parts(world.last) == ["b"]
    make(ask, awg, "a", name="t")
    ask(awg, 'SLIS:SEQ:STEP1:TASS:SEQ "t","s"')
    assert errors(ask, awg) == "-221"
    ask(awg, 'SLIS:SEQ:STEP2:TASS1:WAV "s","c"')
    assert ask(awg, 'SLIS:SEQ:STEP2:TASS1? "s";TASS1:TYPE? "s"') == b'"c";WAV'


def test_steps_time_the_current_step(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    make(ask, awg, "a", "b")
    run(ask, awg)
    ask(awg, "CLOC:SRAT 1e4")
    period = 0.49
    world.clock.advance(period - world.clock.now % period + 0.1)
    assert ask(awg, "SOUR1:SCST?") == b"1"
    world.clock.advance(0.24)
    assert ask(awg, "SOUR1:SCST?") == b"2"


def test_internal_waits(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    make(ask, awg, "a WINP ITR", "b WINP ITR")
    run(ask, awg)
    ask(awg, "TRIG:INT 1e-6")
    assert world.last is not None
    assert world.last.lengths is None
    assert world.last.period == pytest.approx(2e-6)


def test_what_cannot_be_played(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    make(ask, awg, "a", "b")
    ask(awg, 'SLIS:SEQ:STEP:ADD "s",3;:SOUR1:CASS:SEQ "s",1;:AWGC:RUN')
    assert errors(ask, awg) == "-221"
    ask(awg, 'SLIS:SEQ:STEP3:TASS1:WAV "s","c";:OUTP1 1;:AWGC:RUN;*OPC?')
    assert parts(world.last) == ["abc"]
    ask(awg, 'WLIS:WAV:DEL "b"')
    assert world.last is None
    assert ask(awg, 'AWGC:RST?;:SLIS:SEQ:STEP2:TASS1? "s"') == b'0;""'
    assert errors(ask, awg) == "-221"
    ask(awg, 'SLIS:SEQ:STEP2:TASS1:WAV "s","c";:SLIS:SEQ:STEP2:RCO "s",1048576;:AWGC:RUN')
    assert errors(ask, awg) == "-225"
    ask(awg, "SLIS:SEQ:DEL ALL")
    assert ask(awg, "SOUR1:CASS?;CASS:TYPE?") == b'"";NONE'


def test_many_short_subsequences(ask: Ask, awg: VirtualAwg70002a) -> None:
    make(ask, awg, "a", "b", name="sub")
    make(ask, awg, "sub RCO 1048576")
    ask(awg, 'SOUR1:CASS:SEQ "s",1;:AWGC:RUN')
    assert errors(ask, awg) == "-225"


def test_recommended_settings_are_applied(ask: Ask, awg: VirtualAwg70002a) -> None:
    make(ask, awg, "a")
    ask(awg, 'SLIS:SEQ:SRAT "s",1e10;AMPL "s",0.3;:AWGC:ARS 1;:SOUR1:CASS:SEQ "s",1')
    assert ask(awg, "CLOC:SRAT?;:SOUR1:VOLT?") == b"1.0000000000E+10;3.0000000000E-01"


def test_names_without_quotes(ask: Ask, awg: VirtualAwg70002a) -> None:
    make(ask, awg, "a", "b")
    ask(awg, "SLISt:SEQuence:STEP1:EJUMp s, 2")
    assert ask(awg, 'SLIS:SEQ:STEP1:EJUM? "s"') == b"2"
