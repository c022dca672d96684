"""The status registers of the virtual generator: `STATus` and the bits of the status byte."""

import pytest

from sim_backends.virtual import VirtualAwg70002a
from tests.sim_backends.virtual.awg70002a.session import errors, start
from tests.sim_backends.virtual.watched import Ask, Watched


def test_waiting_for_a_trigger_is_an_event(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    assert ask(awg, "STAT:OPER:COND?;EVEN?;ENAB?;PTR?;NTR?") == b"0;0;0;32767;0"
    ask(awg, "STAT:OPER:ENAB 32")
    start(ask, awg)
    assert ask(awg, "*OPC?;*STB?") == b"1;16"
    assert ask(awg, "STAT:OPER?") == b"0"
    ask(awg, "SOUR1:RMOD TRIG")
    assert ask(awg, "*STB?;STAT:OPER:COND?") == b"128;32"
    assert ask(awg, "STAT:OPER?;OPER?") == b"32;0"
    assert ask(awg, "*STB?") == b"0"
    ask(awg, "STAT:OPER:NTR 32;PTR 0;:*TRG")
    assert ask(awg, "STAT:OPER:COND?;EVEN?") == b"0;32"
    world.clock.advance(1e-3)
    assert ask(awg, "STAT:OPER:COND?;EVEN?") == b"32;0"


def test_a_clock_that_is_not_there_is_questionable(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "STAT:QUES:ENAB 32;:*SRE 8;:CLOC:SOUR EXT")
    assert ask(awg, "*STB?;STAT:QUES:COND?") == b"72;32"
    ask(awg, "CLOC:SOUR INT;:STAT:PRES")
    assert ask(awg, "STAT:QUES?;QUES:COND?;ENAB?;PTR?") == b"32;0;0;32767"
    assert ask(awg, "*STB?") == b"0"
    ask(awg, "CLOC:SOUR EXT;:*CLS")
    assert ask(awg, "STAT:QUES?") == b"0"


@pytest.mark.parametrize(("command", "code"), [("STAT:OPER:ENAB 65536", "-222"), ("STAT:OPER:COND 1", "-113")])
def test_errors(ask: Ask, awg: VirtualAwg70002a, command: str, code: str) -> None:
    ask(awg, command)
    assert errors(ask, awg) == code
