"""Curves that are sent for as long as nobody interrupts: `CURVEStream?` and `WAVFRMStream?`."""

import re
import socket
from collections.abc import Iterator

import pytest

from sim_backends.bench import SimulatedBench
from sim_backends.virtual import VirtualDpo72504dx
from tests.sim_backends.virtual.watched import Ask, Read


def test_each_acquisition_is_sent_once(ask: Ask, read: Read, scope: VirtualDpo72504dx) -> None:
    stream = scope.run(read("*OPC?;:CURVEStream?;*IDN?")[0])
    assert next(stream) == [], "nothing was acquired yet"
    ask(scope, "ACQuire:STATE RUN")
    first = next(stream)
    assert first is not None
    assert b"".join(first).startswith(b"1;#")
    assert next(stream) == []
    ask(scope, "ACQuire:STATE RUN")
    second = next(stream)
    assert second is not None
    assert b"".join(second) not in b"".join(first)
    ask(scope, "ACQuire:STOPAfter RUNSTop;STATE RUN")
    assert next(stream) != next(stream)
    ask(scope, "SELect:CH1 OFF")
    ask(scope, "DATa:SOUrce CH1")
    with pytest.raises(StopIteration):
        next(stream)
    assert ask(scope, "*ESR?;:ALLEv?").startswith(b"16;2244")


def test_preambles_go_with_the_curves(ask: Ask, read: Read, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN")
    preamble, curve = ask(scope, "WFMOutpre?"), ask(scope, "CURVe?")
    ask(scope, "ACQuire:STATE RUN")
    sent = next(scope.run(read("WAVFRMS?")[0]))
    assert sent is not None
    whole = b"".join(sent)
    assert whole.split(b";#")[0].count(b";") == preamble.count(b";")
    assert len(whole) - whole.index(b";#") - 1 == len(curve)


@pytest.fixture
def plug() -> Iterator[socket.socket]:
    with SimulatedBench() as bench:
        port = int(bench.resources["scope"]["socket"].split("::")[2])
        with socket.create_connection(("127.0.0.1", port), timeout=20) as plug:
            yield plug


def test_a_client_hears_curves_until_it_speaks(plug: socket.socket) -> None:
    plug.sendall(b"HORizontal:MODE MANual;:HORizontal:MODE:RECOrdlength 50;:DATa:STOP 50\n")
    plug.sendall(b"TRIGger:A:MODe AUTO;:ACQuire:STOPAfter RUNSTop;STATE RUN;:CURVEStream?\n")
    with plug.makefile("rb") as replies:
        curves = set()
        for _ in range(20):
            assert replies.read(4) == b"#250"
            curves.add(replies.read(50))
            assert replies.read(1) == b"\n"
        assert len(curves) == 20
        plug.sendall(b"*CLS\n*CLS\n*IDN?\n")
        while re.match(rb"#250", found := replies.readline()):
            while len(found) < 55:  # a code may look like a line end
                found += replies.readline()
        assert found.startswith(b"TEKTRONIX,DPO72504DX")
