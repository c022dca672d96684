"""The function-generator mode of the virtual AWG."""

import numpy as np
import pytest

from sim_backends.virtual import VirtualAwg70002a
from sim_backends.virtual.awg70002a.function_generator import Function, SharedFrequency
from tests.sim_backends.virtual.awg70002a.session import errors
from tests.sim_backends.virtual.watched import Ask

NOISE = np.random.default_rng(1)


def test_reset_state(ask: Ask, awg: VirtualAwg70002a) -> None:
    for query, reply in {
        "TYPE?": "SINE",
        "FREQ?": "1.2000000000E+06",
        "PER?": "8.3333333333E-07",
        "AMPL?": "5.0000000000E-01",
        "AMPL:VOLT?": "5.0000000000E-01",
        "OFFS?": "0.0000000000E+00",
        "DCL?": "0.0000000000E+00",
        "PHAS?": "0.0000000000E+00",
        "SYMM?": "100",
        "PATH?": "DIR",
    }.items():
        assert ask(awg, f"FGEN:CHAN2:{query}").decode() == reply, query


def test_levels(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "FGEN:CHAN1:AMPL 0.2;OFFS 0.3")
    assert ask(awg, "FGEN:CHAN1:OFFS?;AMPL?") == b"1.5000000000E-01;2.0000000000E-01"
    ask(awg, "FGEN:CHAN1:AMPL 0.4")
    assert [float(ask(awg, f"FGEN:CHAN1:{node}?")) for node in ("AMPL", "OFFS")] == pytest.approx([0.4, 0.05])
    assert errors(ask, awg) == "0"


def test_levels_and_power_say_the_same(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "FGEN:CHAN1:LOW -0.05;HIGH 0.15")
    assert [float(ask(awg, f"FGEN:CHAN1:{node}?")) for node in ("AMPL", "OFFS")] == pytest.approx([0.2, 0.05])
    ask(awg, "FGEN:CHAN1:AMPL:POW -2.0412")
    assert float(ask(awg, "FGEN:CHAN1:AMPL?")) == pytest.approx(0.5, rel=1e-4)
    assert errors(ask, awg) == "0"
    ask(awg, "FGEN:CHAN1:LOW 0;HIGH -0.1")
    assert errors(ask, awg) == "-222"


@pytest.mark.parametrize(
    ("sent", "reply"), [("GAUS", "GAUSS"), ("GAUSS", "GAUSS"), ("SQUARE", "SQU"), ("EXPR", "EXPR")]
)
def test_shapes_by_name(ask: Ask, awg: VirtualAwg70002a, sent: str, reply: str) -> None:
    ask(awg, f"FGEN:CHAN1:TYPE {sent}")
    assert ask(awg, "FGEN:CHAN1:TYPE?").decode() == reply
    assert errors(ask, awg) == "0"


def test_the_frequency_is_shared_and_limited(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "FGEN:CHAN1:FREQ 12.5e9")
    assert ask(awg, "FGEN:CHAN2:FREQ?") == b"1.2500000000E+10"
    ask(awg, "FGEN:CHAN1:TYPE TRI")
    assert ask(awg, "FGEN:CHAN2:FREQ?") == b"6.2500000000E+09"
    ask(awg, "FGEN:CHAN1:FREQ 1e10")
    assert errors(ask, awg) == "-222"


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("FGEN:CHAN1:AMPL 0.6", -222),
        ("FGEN:CHAN1:DCL 0.3", -222),
        ("FGEN:CHAN1:PHAS 181", -222),
        ("FGEN:CHAN1:TYPE SAW", -224),
        ("FGEN:CHAN1:FREQ 0.5", -222),
        ("FGEN:CHAN1:PATH AC", -222),
        ("FGEN:CHAN3:TYPE SINE", -114),
    ],
)
def test_errors(ask: Ask, awg: VirtualAwg70002a, command: str, code: int) -> None:
    ask(awg, command)
    assert errors(ask, awg) == str(code)


def test_it_plays(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "INST:MODE FGEN;:FGEN:CHAN1:FREQ 1e9;:OUTP1 1;:AWGC:RUN;*OPC?;*TRG")
    assert ask(awg, "AWGC:RST?;:INST:MODE?") == b"2;FGEN"
    assert errors(ask, awg) == "0"


def function(shape: str, hz: float = 1e9, **settings: float) -> Function:
    made = Function(SharedFrequency(hz))
    made.shape = shape
    for name, value in settings.items():
        setattr(made, name, value)
    return made


@pytest.mark.parametrize("hz", [1.0, 3e3, 1.2e6, 7e8, 12.5e9])
def test_a_period_has_the_right_frequency(hz: float) -> None:
    volts, rate = function("SINE", hz, amplitude_v=0.4).rendered(NOISE)
    assert rate <= 25e9 * (1 + 1e-12)
    periods = volts.size / rate * hz
    assert periods == pytest.approx(round(periods))
    spectrum = np.abs(np.fft.rfft(volts)) / volts.size
    assert int(spectrum.argmax()) == round(periods)
    if hz < 1e10:
        assert volts.max() == pytest.approx(0.2, abs=0.005)


@pytest.mark.parametrize("shape", ["SQUare", "TRIangle", "GAUSSian", "EXPRise", "EXPDecay", "NOISe"])
def test_shapes_fill_their_range(shape: str) -> None:
    volts, _ = function(shape, 1e6, amplitude_v=0.2, offset_v=0.1, symmetry=50).rendered(NOISE)
    assert volts.min() == pytest.approx(0.0, abs=0.01)
    assert volts.max() == pytest.approx(0.2, abs=0.01)
    assert volts.dtype == np.float32


def test_shapes() -> None:
    square, _ = function("SQUare", 1e6).rendered(NOISE)
    assert square[: square.size // 2].min() == 0.25
    ramp, _ = function("TRIangle", 1e6, symmetry=100).rendered(NOISE)
    assert np.all(np.diff(ramp) > 0)
    late, _ = function("SINE", 1e6, phase_deg=90).rendered(NOISE)
    assert late[0] == pytest.approx(0.25)
    level, _ = function("DC", dc_level_v=0.1).rendered(NOISE)
    assert np.all(level == np.float32(0.1))
    none, _ = function("NONE", dc_level_v=0.1).rendered(NOISE)
    assert not none.any()
