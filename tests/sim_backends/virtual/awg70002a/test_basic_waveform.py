"""The Basic Waveform editor of the virtual AWG."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.virtual import VirtualAwg70002a
from sim_backends.virtual.awg70002a.basic_waveform import BLOCK, BasicWaveform
from sim_backends.virtual.awg70002a.schedule import LONGEST_PLAYBACK
from tests.sim_backends.virtual.awg70002a.session import errors
from tests.sim_backends.virtual.watched import Ask, Watched


def samples(ask: Ask, awg: VirtualAwg70002a, name: str) -> NDArray[np.float32]:
    block = ask(awg, f'WLIS:WAV:DATA? "{name}"')
    return np.frombuffer(block[2 + int(block[1:2]) :], "<f4")


def test_a_sine_is_compiled_assigned_and_played(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    ask(awg, 'BWAV:FUNC "sine";FREQ 1e9;SRAT 25e9;LENG 2500;AMPL 0.4;COMP:NAME "tone";CHAN 1;CASS 1;PLAY 1')
    ask(awg, "AWGC:ARS 1;:OUTP1 1;:BWAV:COMP")
    assert ask(awg, "BWAV:CYCL?;:AWGC:RST?;:SOUR1:CASS?;VOLT?") == b'1.0000000000E+02;2;"tone";4.0000000000E-01'
    played = world.last
    assert played is not None
    assert played.volts.max() == pytest.approx(0.2, abs=1e-3)
    assert int(np.abs(np.fft.rfft(played.volts)).argmax()) == 100
    ask(awg, "BWAV:COMP")
    assert ask(awg, "WLIS:LIST?") == b'"tone,tone_1"'
    assert errors(ask, awg) == "0"


@pytest.mark.parametrize(("full", "peak", "recommended"), [("1", 1.0, 0.2), ("0", 0.8, 0.5)])
def test_the_range_is_filled_or_not(
    ask: Ask, awg: VirtualAwg70002a, full: str, peak: float, recommended: float
) -> None:
    ask(awg, f'BWAV:FUNC SQU;HIGH 0.2;LOW 0;FDR {full};COMP:NAME "s";:BWAV:COMP')
    assert samples(ask, awg, "s").max() == pytest.approx(peak)
    assert samples(ask, awg, "s").min() == pytest.approx(-1.0 if full == "1" else 0.0, abs=1e-6)
    assert float(ask(awg, 'WLIS:WAV:AMPL? "s"')) == pytest.approx(recommended)
    assert [float(ask(awg, f"BWAV:{node}?")) for node in ("AMPL", "OFFS")] == pytest.approx([0.2, 0.1])


@pytest.mark.parametrize("word", ["TRIangle", "RAMP", "NOISe", "DC", "sine"])
def test_shapes(ask: Ask, awg: VirtualAwg70002a, word: str) -> None:
    ask(awg, f'BWAV:FUNC {word};COMP:NAME "x";:BWAV:COMP')
    assert samples(ask, awg, "x").size == 25000
    assert np.abs(samples(ask, awg, "x")).max() <= 1.0
    assert errors(ask, awg) == "0"


@pytest.mark.parametrize(
    ("auto", "sent", "asked", "value"),
    [
        ("LEN", "FREQ 1e8;CYCL 2;SRAT 1e10", "LENG", 200),
        ("DUR", "FREQ 1e8;CYCL 2;SRAT 1e10", "LENG", 200),
        ("CYCL", "FREQ 1e8;LENG 500;SRAT 1e10", "CYCL", 5),
        ("FREQ", "LENG 500;CYCL 5;SRAT 1e10", "FREQ", 1e8),
        ("SR", "LENG 500;CYCL 5;FREQ 1e8", "SRAT", 1e10),
    ],
)
def test_one_follows_from_the_others(
    ask: Ask, awg: VirtualAwg70002a, auto: str, sent: str, asked: str, value: float
) -> None:
    ask(awg, f"BWAV:AUTO {auto};{sent}")
    assert float(ask(awg, f"BWAV:{asked}?")) == pytest.approx(value)
    assert errors(ask, awg) == "0"
    ask(awg, f"BWAV:{asked} {value}")
    assert errors(ask, awg) == "-221"


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("BWAV:AMPL 0.6", "-222"),
        ("BWAV:OFFS 0.1", "-222"),
        ("BWAV:FUNC saw", "-224"),
        ("BWAV:AUTO SR;FREQ 1e9", "-222"),
        ("BWAV:LENG 100;COMP:CHAN 1;CASS 1;:BWAV:COMP", "-222"),
    ],
)
def test_errors(ask: Ask, awg: VirtualAwg70002a, command: str, code: str) -> None:
    ask(awg, command)
    assert errors(ask, awg) == code


def test_reset(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "BWAV:FUNC DC;FREQ 5e6;AUTO FREQ;RES")
    assert ask(awg, "BWAV:FUNC?;AUTO?;FREQ?;FDR?;:BWAV:COMP:CHAN?") == b"SINE;CYCL;1.0000000000E+06;1;NONE"


def test_a_waveform_larger_than_memory_is_an_error_and_no_end(
    ask: Ask, awg: VirtualAwg70002a, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_basic: BasicWaveform, _noise: np.random.Generator, _points: NDArray[np.float64]) -> NDArray[np.float64]:
        raise MemoryError

    monkeypatch.setattr(BasicWaveform, "_unit", full)
    ask(awg, "BWAVeform:LENGth 2500000;:BWAVeform:COMPile")
    assert errors(ask, awg).startswith("-225")
    assert ask(awg, "*IDN?").startswith(b"TEKTRONIX")


def test_a_waveform_longer_than_is_played_is_refused_at_once(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, f"BWAV:AUTO CYCL;LENG {LONGEST_PLAYBACK + 1};:BWAV:COMP")
    assert errors(ask, awg) == "-225"
    assert ask(awg, "WLIS:LIST?") == b'""'


def test_a_long_waveform_goes_on_where_one_block_ends(ask: Ask, awg: VirtualAwg70002a) -> None:
    points = 3 * BLOCK + 1
    ask(awg, f'BWAV:AUTO CYCL;FREQ 7e6;SRAT 25e9;LENG {points};COMP:NAME "long";:BWAV:COMP')
    sine = np.sin(2 * np.pi * 7e6 / 25e9 * np.arange(points))
    np.testing.assert_allclose(samples(ask, awg, "long"), sine, atol=1e-6)
