"""The clock settings of the virtual AWG."""

import pytest

from sim_backends.virtual import VirtualAwg70002a
from tests.sim_backends.virtual.awg70002a.session import errors
from tests.sim_backends.virtual.watched import Ask


def test_clock(ask: Ask, awg: VirtualAwg70002a) -> None:
    assert ask(awg, "CLOC:ECL:FREQ?;:CLOC:EREF:FREQ?") == b"6.2500000000E+09;3.5000000000E+07"
    ask(awg, "CLOC:SOUR EXT")
    assert ask(awg, "CLOC:SRAT?;:CLOC:OUTP:FREQ?") == b"1.2500000000E+10;6.2500000000E+09"
    ask(awg, "CLOC:SRAT 2e10")
    assert errors(ask, awg) == "-222"
    ask(awg, "CLOC:ECL:FREQ 1e10;:CLOC:SRAT 2e10")
    assert ask(awg, "CLOC:SRAT?;:SOUR:FREQ?") == b"2.0000000000E+10;2.0000000000E+10"
    ask(awg, "AWGC:RUN")
    assert (ask(awg, "AWGC:RST?"), errors(ask, awg)) == (b"0", "-241"), "nothing is wired to Clock In"
    ask(awg, "CLOC:JITT 1;OUTP 1;SOUT:STAT 1;:CLOC:PHAS:ADJ:DEGR 10;TIM 1e-12;:CLOC:ECL:FREQ:ADJ")
    assert ask(awg, "CLOC:JITT?;OUTP?;SOUT?;PHAS:ADJ:DEGR?") == b"1;1;1;10"
    assert ask(awg, "CLOC:PHAS:ADJ:TIM?") == b"1.0000000000E-12"
    assert errors(ask, awg) == "0"


@pytest.mark.parametrize(
    ("command", "code"), [("CLOC:ECL:FREQ 1e9", -222), ("CLOC:ECL:FREQ:DET", -241), ("CLOC:EREF:FREQ:DET", -241)]
)
def test_errors(ask: Ask, awg: VirtualAwg70002a, command: str, code: int) -> None:
    ask(awg, command)
    assert errors(ask, awg) == str(code)
