"""The virtual generator's waveform list: upload, read-back, editing, errors."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.virtual import VirtualAwg70002a
from tests.sim_backends.virtual.awg70002a.session import MARKERS, SAMPLES, errors, float_block, start, upload
from tests.sim_backends.virtual.watched import Ask, Watched


def test_chunks_and_read_back(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, 'WLIS:WAV:NEW "w",2500,REAL,1')
    for first in (2000, 0, 1000):
        part = SAMPLES[first : first + 1000]
        ask(awg, f'WLIS:WAV:DATA:I "w",{first},{part.size},'.encode() + float_block(part))
    assert ask(awg, 'WLIS:WAV:DATA? "w"') == float_block(SAMPLES)
    assert ask(awg, 'WLIS:WAV:DATA? "w",2490') == float_block(SAMPLES[2490:])
    ask(awg, b'WLIS:WAV:MARK:DATA "w",1,2,#12\x40\xc0;*OPC')
    assert ask(awg, 'WLIS:WAV:MARK:DATA? "w",0,4') == b"#14\x00\x40\xc0\x00"
    assert ask(awg, 'WLIS:WAV:LENG? "w";TYPE? "w";SFOR? "w"') == b"2500;REAL;REAL"
    assert errors(ask, awg) == "0"


def test_the_list(ask: Ask, awg: VirtualAwg70002a) -> None:
    assert ask(awg, "WLIS:SIZE?;LIST?;LAST?") == b'0;"";""'
    upload(ask, awg, name="a")
    upload(ask, awg, SAMPLES[:2400], name="b")
    assert ask(awg, "WLIS:SIZE?;LIST?;LAST?;NAME? 1;NAME? 2") == b'2;"a,b";"b";"a";"b"'
    assert ask(awg, "WLIS:WAV:LMIN?;LMAX?;GRAN?") == b"2400;2000000000;1"
    assert ask(awg, 'WLIS:WAV:TST? "a"').startswith(b'"2024/01/01 ')
    ask(awg, 'WLIS:WAV:DEL "a"')
    assert ask(awg, "WLIS:LIST?;:SLIS:SIZE?") == b'"b";0'
    assert errors(ask, awg) == "0"


@pytest.mark.parametrize(
    "change",
    [
        'WLIS:WAV:INV "m"',
        'WLIS:WAV:ROT:POIN "m",5',
        'WLIS:WAV:RES "m",5000',
        'WLIS:WAV:SRAT "m",1e9',
        b'WLIS:WAV:DATA "m",0,1,#14\0\0\0\0',
        b'WLIS:WAV:MARK:DATA "m",1,2,#12\x40\xc0',
    ],
)
def test_whatever_changes_a_waveform_dates_it(
    change: str | bytes, ask: Ask, awg: VirtualAwg70002a, world: Watched
) -> None:
    upload(ask, awg, name="m")
    world.clock.advance(3600)
    assert ask(awg, 'WLIS:WAV:TST? "m"') == b'"2024/01/01 00:00:00"'
    ask(awg, change)
    world.clock.advance(60)
    assert ask(awg, 'WLIS:WAV:TST? "m"') == b'"2024/01/01 01:00:00"'
    assert errors(ask, awg) == "0"


def test_normalise(ask: Ask, awg: VirtualAwg70002a) -> None:
    samples = np.linspace(0, 0.5, 2500, dtype=np.float32)
    upload(ask, awg, samples)
    ask(awg, 'WLIS:WAV:NORM "m",ZREF')
    assert np.frombuffer(ask(awg, 'WLIS:WAV:DATA? "m"')[7:], "<f4")[[0, -1]].tolist() == [0.0, 1.0]
    ask(awg, 'WLIS:WAV:NORM "m",FSC')
    assert np.frombuffer(ask(awg, 'WLIS:WAV:DATA? "m"')[7:], "<f4")[[0, -1]].tolist() == [-1.0, 1.0]


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ('WLIS:WAV:NEW "m",2500', -224),
        ('WLIS:WAV:NEW "",2500', -224),
        ('WLIS:WAV:NEW "x",0', -222),
        ('WLIS:WAV:NEW "x",2500,COMPLEX', -224),
        ('WLIS:WAV:DATA:Q "m",0,1,#14abcd', -221),
        ('SOUR1:CASS:WAV "m",Q', -221),
        ('WLIS:WAV:ACF "C:\\no.csv","m"', -256),
        ('WLIS:WAV:SRAT "m",26e9', -222),
        ('WLIS:WAV:RES "m",0', -222),
        ("SOUR1:JUMP:FORC 1", -221),
        ('SOUR1:CASS:SEQ "s",1', -224),
        ('WLIS:WAV:LENG? "x"', -224),
        ("WLIS:NAME? 3", -222),
        ('WLIS:WAV:DATA "x",0,1,#14abcd', -224),
        ('WLIS:WAV:DATA "m",0,2,#14abcd', -161),
        ('WLIS:WAV:DATA "m",#13abc', -161),
        ('WLIS:WAV:DATA "m",2500,1,#14abcd', -222),
        ('WLIS:WAV:DATA "m",0,1,5', -160),
        ('WLIS:WAV:DATA "m",0,1,#2xx', -161),
        ('WLIS:WAV:DATA? "m",0,2501', -222),
        ('WLIS:WAV:DATA? "m",2501', -222),
        ('WLIS:WAV:DEL "x"', -224),
        ('SOUR1:CASS:WAV "x"', -224),
        ('SOUR1:CASS:WAV "short"', -222),
        ("SOUR3:VOLT 0.5", -114),
        ("SOUR1:VOLT 0.6", -222),
        ("SOUR1:VOLT 0.2", -222),
        ("CLOC:SRAT 26e9", -222),
        ("CLOC:SRAT fast", -104),
        ("SOUR1:DAC:RES 11", -222),
        ("SOUR1:VOLT:OFFS 0.1", -221),
        ("SOUR1:VOLT:OFFS?", -221),
        ("SOUR1:MARK1:VOLT:HIGH 0.2", -222),
        ("SOUR1:MARK1:VOLT:LOW -1", -222),
        ("SOUR1:MARK1:VOLT:OFFS 1.2", -222),
        ("SOUR1:RMOD FAST", -224),
        ("TRIG:IMP 75", -224),
        ("INST:MODE SCOPE", -224),
    ],
)
def test_errors_change_nothing(ask: Ask, awg: VirtualAwg70002a, world: Watched, command: str, code: int) -> None:
    start(ask, awg)
    upload(ask, awg, SAMPLES[:2399], name="short")
    world.played.clear()
    state = "SOUR1:VOLT?;:SOUR1:MARK1:VOLT:HIGH?;LOW?;:CLOC:SRAT?;:SOUR1:DAC:RES?;:WLIS:LIST?;:SOUR1:CASS?;:AWGC:RST?"
    before = ask(awg, state)
    assert ask(awg, command) == b""
    assert errors(ask, awg) == str(code)
    assert ask(awg, state) == before
    assert world.played == []


def test_memory_has_an_end(ask: Ask, awg: VirtualAwg70002a, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(np, "zeros", full)
    ask(awg, 'WLIS:WAV:NEW "x",2000000000')
    assert errors(ask, awg) == "-225"


def test_recommended_settings(ask: Ask, awg: VirtualAwg70002a) -> None:
    upload(ask, awg)
    assert ask(awg, 'WLIS:WAV:SRAT? "m"') == b"9.9100000000E+37"
    ask(awg, 'WLIS:WAV:SRAT "m",1e10;AMPL "m",0.3;OFFS "m",0.1')
    assert ask(awg, 'WLIS:WAV:AMPL? "m";OFFS? "m"') == b"3.0000000000E-01;1.0000000000E-01"
    ask(awg, 'SOUR1:CASS:WAV "m"')
    assert ask(awg, "CLOC:SRAT?;:SOUR1:VOLT?") == b"2.5000000000E+10;5.0000000000E-01"
    ask(awg, 'AWGC:ARS 1;:SOUR1:CASS:WAV "m"')
    assert ask(awg, "CLOC:SRAT?;:SOUR1:VOLT?;:AWGC:ARS?") == b"1.0000000000E+10;3.0000000000E-01;1"
    assert errors(ask, awg) == "0"


def test_complex_waveforms(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    ask(awg, 'WLIS:WAV:NEW "c",2500,IQ')
    ask(awg, b'WLIS:WAV:DATA:Q "c",' + float_block(SAMPLES))
    assert ask(awg, 'WLIS:WAV:TYPE? "c";SFOR? "c"') == b"IQ;IQ"
    assert ask(awg, 'WLIS:WAV:DATA:Q? "c"') == float_block(SAMPLES)
    ask(awg, 'SOUR1:CASS:WAV "c",Q;:OUTP1 1;:AWGC:RUN')
    playback = world.played[-1]
    assert playback is not None
    assert np.abs(playback.volts - 0.25 * SAMPLES).max() < 1e-3
    ask(awg, 'WLIS:WAV:ROT:POIN "c",1;:WLIS:WAV:RES "c",5000;:WLIS:WAV:SFOR "c",I')
    assert ask(awg, 'WLIS:WAV:LENG? "c";SFOR? "c"') == b"5000;I"
    assert errors(ask, awg) == "0"


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("INV", lambda x: x.max() + x.min() - x),
        ("SHIF", lambda x: np.roll(x, 625)),
        ("ROT:POIN", lambda x: np.roll(x, 90)),
    ],
)
def test_editing(
    ask: Ask,
    awg: VirtualAwg70002a,
    command: str,
    expected: Callable[[NDArray[np.float32]], NDArray[np.float32]],
) -> None:
    upload(ask, awg)
    ask(awg, f'WLIS:WAV:{command} "m"' + (",90" if command != "INV" else ""))
    block = ask(awg, 'WLIS:WAV:DATA? "m"')
    assert np.allclose(np.frombuffer(block[7:], "<f4"), expected(SAMPLES), atol=1e-6)
    assert errors(ask, awg) == "0"


def test_resampling(ask: Ask, awg: VirtualAwg70002a) -> None:
    turns = np.arange(2500) / 2500
    upload(ask, awg, np.sin(2 * np.pi * turns).astype(np.float32))
    ask(awg, b'WLIS:WAV:MARK:DATA "m",#42500' + MARKERS.tobytes())
    ask(awg, 'WLIS:WAV:RES "m",5000')
    samples = np.frombuffer(ask(awg, 'WLIS:WAV:DATA? "m"')[7:], "<f4")
    assert np.allclose(samples, np.sin(2 * np.pi * np.arange(5000) / 5000), atol=1e-5)
    assert ask(awg, 'WLIS:WAV:MARK:DATA? "m",0,101')[5:] == b"\x40" * 100 + b"\x00"


def test_further_edits(ask: Ask, awg: VirtualAwg70002a) -> None:
    upload(ask, awg)
    ask(awg, 'WLIS:WAV:REV "m"')
    assert np.array_equal(awg.waveforms["m"].samples, SAMPLES[::-1])
    ask(awg, 'WLIS:WAV:REV "m";SCAL "m",0.5;AOFF "m",0.25;ROT:DEGR "m",180')
    assert np.allclose(awg.waveforms["m"].samples, np.roll(SAMPLES / 2 + 0.25, 1250), atol=1e-6)
    assert errors(ask, awg) == "0"
