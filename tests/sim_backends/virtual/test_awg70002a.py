"""The virtual AWG: upload, assignment, run control, and what the world hears of it."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.virtual import VirtualAwg70002a, VirtualInstrument
from sim_backends.world import Playback, World

Ask = Callable[[VirtualInstrument, str | bytes], bytes]

SAMPLES = np.random.default_rng(7).uniform(-1, 1, 2500).astype(np.float32)
MARKERS = np.repeat(np.array([0x40, 0x00], np.uint8), [50, 2450])


def float_block(samples: NDArray[np.float32]) -> bytes:
    data = samples.astype("<f4").tobytes()
    return f"#{len(str(len(data)))}{len(data)}".encode() + data


class Heard(World):
    """A world that notes what it is told to play."""

    def __init__(self) -> None:
        super().__init__()
        self.played: list[Playback | None] = []
        self.triggers = 0
        self.level = (0.0, True)

    def play(self, playback: Playback | None) -> None:
        self.played.append(playback)
        super().play(playback)

    def trigger_awg(self) -> None:
        self.triggers += 1
        super().trigger_awg()

    def awg_trigger_level(self, level_v: float, *, rising: bool) -> None:
        self.level = level_v, rising
        super().awg_trigger_level(level_v, rising=rising)


@pytest.fixture(scope="module")
def quiet() -> Heard:
    return Heard()


@pytest.fixture
def heard(quiet: Heard) -> Heard:
    quiet.play(None)
    quiet.played.clear()
    quiet.triggers = 0
    return quiet


@pytest.fixture
def awg(heard: Heard) -> VirtualAwg70002a:
    return VirtualAwg70002a(heard)


def upload(ask: Ask, awg: VirtualAwg70002a, samples: NDArray[np.float32] = SAMPLES, name: str = "m") -> None:
    ask(awg, f'WLISt:WAVeform:NEW "{name}",{samples.size}')
    ask(awg, f'WLISt:WAVeform:DATA "{name}",0,{samples.size},'.encode() + float_block(samples))


def errors(ask: Ask, awg: VirtualAwg70002a) -> str:
    return ask(awg, "SYSTem:ERRor:CODE:ALL?").decode()


def start(ask: Ask, awg: VirtualAwg70002a, bits: int = 9) -> None:
    """The upload session of the instrument facts, 1.10."""
    ask(awg, f"*RST\n*WAI\n*CLS\nCLOCk:SRATe 2.5E10\nSOURce1:DAC:RESolution {bits}\nSOURce1:VOLTage 0.5")
    assert ask(awg, "*OPC?;:CLOCk:SRATe?") == b"1;2.5000000000E+10"
    ask(awg, "WLISt:WAVeform:DELete ALL")
    upload(ask, awg)
    ask(awg, b'WLISt:WAVeform:MARKer:DATA "m",0,2500,#42500' + MARKERS.tobytes())
    ask(awg, 'SOURce1:CASSet:WAVeform "m"')
    ask(awg, "SOURce1:MARKer1:VOLTage:HIGH 1.0;LOW 0.0\nSOURce1:RMODe CONTinuous\nAWGControl:RUN")
    ask(awg, "OUTPut:OFF 0\nOUTPut1:STATe 1")
    assert errors(ask, awg) == "0"


def test_the_session_of_the_manual_plays(ask: Ask, awg: VirtualAwg70002a, heard: Heard) -> None:
    start(ask, awg)
    assert ask(awg, "AWGControl:RSTate?;:OUTP?;:OUTP:OFF?") == b"2;1;0"
    (playback,) = heard.played
    assert playback is not None
    assert (playback.sample_rate, playback.marker_low_v, playback.marker_high_v) == (25e9, 0.0, 1.0)
    assert np.array_equal(playback.marker, MARKERS != 0)
    assert np.abs(playback.volts - 0.25 * SAMPLES).max() <= 0.25 / 255
    assert playback.period == pytest.approx(100e-9)


def test_the_clock_is_charged_for_run(ask: Ask, awg: VirtualAwg70002a, heard: Heard) -> None:
    start(ask, awg)
    before = heard.clock.now
    ask(awg, "AWGC:RUN;*OPC")
    assert ask(awg, "*ESR?") == b"0"  # a poll takes 0.1 s
    assert ask(awg, "*OPC?;*ESR?") == b"1;1"
    assert heard.clock.now - before == pytest.approx(1.0)
    ask(awg, "AWGC:RUN\n*WAI")
    assert heard.clock.now - before == pytest.approx(2.0)


@pytest.mark.parametrize(("bits", "marked"), [(8, True), (9, True), (10, False)])
def test_resolution(ask: Ask, awg: VirtualAwg70002a, heard: Heard, bits: int, marked: bool) -> None:
    start(ask, awg, bits)
    playback = heard.played[-1]
    assert playback is not None
    assert playback.marker.any() == marked
    steps = np.unique(playback.volts) / 0.25 * (2 ** (bits - 1) - 1)
    assert np.allclose(steps, np.rint(steps), atol=1e-3)
    assert len(steps) < 2**bits


def test_samples_beyond_full_scale_are_clipped(ask: Ask, awg: VirtualAwg70002a, heard: Heard) -> None:
    start(ask, awg)
    loud = np.tile(np.array([3.0, -np.inf, 1.0, -1.0, np.nan], np.float32), 500)
    ask(awg, b'WLIS:WAV:DATA "m",' + float_block(loud))
    playback = heard.played[-1]
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
        ("SOUR1:CASS:CLE", False),
        ('SOUR1:WAV ""', True),
        ("WLIS:WAV:DEL ALL", False),
        ("*RST", False),
    ],
)
def test_what_changes_the_output(ask: Ask, awg: VirtualAwg70002a, heard: Heard, command: str, plays: bool) -> None:
    start(ask, awg)
    heard.played.clear()
    ask(awg, command)
    assert [playback is not None for playback in heard.played] == ([plays] if command != 'SOUR1:WAV ""' else [])


@pytest.mark.parametrize(
    "command", ["SOUR1:VOLT 0.5", "OUTP1 1", "SOUR2:VOLT 0.3", "TRIG:LEV 1", "SOUR1:DAC:RES 7", "OUTP2 1", "SYST:ERR?"]
)
def test_what_does_not(ask: Ask, awg: VirtualAwg70002a, heard: Heard, command: str) -> None:
    start(ask, awg)
    heard.played.clear()
    ask(awg, command)
    assert heard.played == []


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
        ("SOUR1:POW 0", -221),
        ("SOUR1:POW?", -221),
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
def test_errors_change_nothing(ask: Ask, awg: VirtualAwg70002a, heard: Heard, command: str, code: int) -> None:
    start(ask, awg)
    upload(ask, awg, SAMPLES[:2399], name="short")
    heard.played.clear()
    state = "SOUR1:VOLT?;:SOUR1:MARK1:VOLT:HIGH?;LOW?;:CLOC:SRAT?;:SOUR1:DAC:RES?;:WLIS:LIST?;:SOUR1:CASS?;:AWGC:RST?"
    before = ask(awg, state)
    assert ask(awg, command) == b""
    assert errors(ask, awg) == str(code)
    assert ask(awg, state) == before
    assert heard.played == []


def test_running_needs_an_assignment(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "AWGC:RUN")
    assert ask(awg, "AWGC:RST?") == b"0"
    assert errors(ask, awg) == "-221"


def test_memory_has_an_end(ask: Ask, awg: VirtualAwg70002a, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(np, "zeros", full)
    ask(awg, 'WLIS:WAV:NEW "x",2000000000')
    assert errors(ask, awg) == "-225"


def test_deleting_what_plays_stops_the_run(ask: Ask, awg: VirtualAwg70002a) -> None:
    start(ask, awg)
    upload(ask, awg, name="other")
    ask(awg, 'WLIS:WAV:DEL "other"')
    assert ask(awg, "AWGC:RST?;:OUTP1?") == b"2;1"
    ask(awg, 'WLIS:WAV:DEL "m"')
    assert ask(awg, "AWGC:RST?;:OUTP1?;:SOUR1:CASS?;CASS:TYPE?") == b'0;0;"";NONE'


def test_triggered_modes(ask: Ask, awg: VirtualAwg70002a, heard: Heard) -> None:
    start(ask, awg)
    ask(awg, "*OPC?;:SOUR1:RMOD TCON")
    playback = heard.played[-1]
    assert playback is not None
    assert (playback.lengths, playback.runs_on) == ((2500,), True)
    assert ask(awg, "AWGC:RST?;:SOUR1:RMOD?") == b"1;TCON"
    ask(awg, "TRIG BTR")
    assert ask(awg, "AWGC:RST?") == b"1"
    assert heard.triggers == 0
    ask(awg, "TRIGger:SEQuence:IMMediate ATRigger")
    assert ask(awg, "AWGC:RST?") == b"2"
    assert heard.triggers == 1
    ask(awg, "AWGC:STOP;:AWGC:RUN;*OPC?")
    assert ask(awg, "AWGC:RST?") == b"1"
    ask(awg, "*TRG;*TRG")  # the second finds it running already
    assert ask(awg, "AWGC:RST?") == b"2"
    assert heard.triggers == 2
    heard.clock.advance(1.0)
    ask(awg, "AWGC:RMOD TRIG")
    assert ask(awg, "AWGC:RST?;RMOD?") == b"1;TRIG"
    playback = heard.played[-1]
    assert playback is not None
    assert (playback.lengths, playback.runs_on) == ((2500,), False)
    for _ in range(3):
        ask(awg, "*TRG")
        assert ask(awg, "AWGC:RST?") == b"2"
        heard.clock.advance(1e-6)
        assert ask(awg, "AWGC:RST?") == b"1"
    assert heard.triggers == 5
    ask(awg, "AWGC:STOP;*TRG")
    assert heard.triggers == 5


def test_what_the_trigger_input_listens_to(ask: Ask, awg: VirtualAwg70002a, heard: Heard) -> None:
    start(ask, awg)
    assert heard.level == (math.inf, True)
    ask(awg, "SOUR1:RMOD TRIG")
    assert heard.level == (1.4, True)
    ask(awg, "TRIG:LEV 0.5;SLOP NEG")
    assert heard.level == (0.5, False)
    ask(awg, "SOUR1:TINP BTR")
    assert heard.level == (math.inf, False)
    ask(awg, "TRIG ATR")
    assert heard.triggers == 0
    ask(awg, "TRIG BTR")
    assert heard.triggers == 1


@pytest.mark.parametrize("setting", ["SOUR1:TINP ITR", "TRIG:SOUR INT"])
def test_internal_triggers(ask: Ask, awg: VirtualAwg70002a, heard: Heard, setting: str) -> None:
    start(ask, awg)
    ask(awg, f"TRIG:INT 1e-6;:{setting};:SOUR1:RMOD TRIG")
    playback = heard.played[-1]
    assert playback is not None
    assert playback.lengths is None
    assert playback.period == pytest.approx(1e-6)
    assert not playback.volts[2500:].any()
    ask(awg, "SOUR1:RMOD TCON")
    playback = heard.played[-1]
    assert playback is not None
    assert playback.period == pytest.approx(1e-7)
    assert ask(awg, "TRIG:INT?;:AWGC:RST?") == b"1.0000000000E-06;2"
    assert errors(ask, awg) == "0"


def test_marker_delay_and_skew(ask: Ask, awg: VirtualAwg70002a, heard: Heard) -> None:
    start(ask, awg)
    plain = heard.played[-1]
    ask(awg, "SOUR1:MARK1:DEL 8e-11;:SOUR1:SKEW 1.2e-10")
    moved = heard.played[-1]
    assert plain is not None
    assert moved is not None
    assert np.array_equal(moved.marker, np.roll(plain.marker, 2))
    assert np.array_equal(moved.volts, np.roll(plain.volts, 3))


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


def test_waiting_values(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "TRIG:WVAL FIRS")
    assert ask(awg, "TRIG:WVAL?;:OUTP2:WVAL:ANAL?;MARK2?") == b"FIRS;FIRS;FIRS"
    ask(awg, "OUTP1:SVAL:ANAL:STAT OFF;:OUTP1:SVAL:MARK1 OFF;:OUTP1:WVAL:MARK1 HIGH")
    assert ask(awg, "OUTP1:SVAL:ANAL?;MARK1?;:OUTP1:WVAL:MARK1?") == b"OFF;OFF;HIGH"


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


def test_complex_waveforms(ask: Ask, awg: VirtualAwg70002a, heard: Heard) -> None:
    ask(awg, 'WLIS:WAV:NEW "c",2500,IQ')
    ask(awg, b'WLIS:WAV:DATA:Q "c",' + float_block(SAMPLES))
    assert ask(awg, 'WLIS:WAV:TYPE? "c";SFOR? "c"') == b"IQ;IQ"
    assert ask(awg, 'WLIS:WAV:DATA:Q? "c"') == float_block(SAMPLES)
    ask(awg, 'SOUR1:CASS:WAV "c",Q;:OUTP1 1;:AWGC:RUN')
    playback = heard.played[-1]
    assert playback is not None
    assert np.abs(playback.volts - 0.25 * SAMPLES).max() < 1e-3
    ask(awg, 'WLIS:WAV:ROT:POIN "c",1;:WLIS:WAV:RES "c",5000;:WLIS:WAV:SFOR "c",I')
    assert ask(awg, 'WLIS:WAV:LENG? "c";SFOR? "c"') == b"5000;I"
    assert errors(ask, awg) == "0"


def test_error_queue_overflow(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "NONSENSE\n" * 40)
    assert ask(awg, "SYST:ERR:COUN?") == b"32"
    assert errors(ask, awg).split(",")[-1] == "-350"


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("INV", lambda x: x.max() + x.min() - x),
        ("SHIF", lambda x: np.roll(x, 625)),
        ("ROT:DEGR", lambda x: np.roll(x, 625)),
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


def test_reset_state(ask: Ask, awg: VirtualAwg70002a) -> None:
    start(ask, awg)
    ask(awg, "TRIG:LEV 0.5,BTR;:TRIG:SLOP NEG;:TRIG:MODE SYNC;:TRIG:IMP 1000")
    assert ask(awg, "TRIG:LEV? BTR;LEV?;SLOP?;MODE?;IMP?") == b"5.0000000000E-01;1.4000000000E+00;NEG;SYNC;1000"
    ask(awg, "*RST")
    for query, reply in {
        "CLOC:SRAT?": "2.5000000000E+10",
        "CLOC:SOUR?": "INT",
        "SOUR1:RMOD?": "CONT",
        "OUTP1?": "0",
        "SOUR1:DAC:RES?": "10",
        "SOUR1:VOLT?": "5.0000000000E-01",
        "SOUR1:VOLT:LEV:IMM:HIGH?": "2.5000000000E-01",
        "SOUR1:VOLT:LOW?": "-2.5000000000E-01",
        "OUTP1:PATH?": "DIR",
        "SOUR1:TINP?": "ATR",
        "TRIG:LEV? BTR": "1.4000000000E+00",
        "TRIG:SLOP?": "POS",
        "TRIG:IMP?": "50",
        "TRIG:MODE?": "ASYN",
        "TRIG:SOUR?": "EXT",
        "OUTP1:WVAL:ANAL:STAT?": "ZERO",
        "OUTP1:WVAL:MARK1?": "LOW",
        "OUTP1:SVAL:ANAL:STAT?": "ZERO",
        "TRIG:WVAL?": "ZERO",
        "CLOC:JITT?": "0",
        "SLIS:SIZE?": "0",
        "SOUR1:MARK1:VOLT:HIGH?": "1.0000000000E+00",
        "SOUR1:MARK2:VOLT:LOW?": "0.0000000000E+00",
        "SOUR1:MARK1:VOLT?": "1.0000000000E+00",
        "SOUR1:MARK1:VOLT:OFFS?": "5.0000000000E-01",
        "SOUR1:SKEW?": "0.0000000000E+00",
        "INST:MODE?": "AWG",
        "WLIS:SIZE?": "0",
        "AWGC:CONF:CNUM?": "2",
        "SYST:ERR:DIAL?": "1",
    }.items():
        assert ask(awg, query).decode() == reply, query


def test_marker_levels_as_amplitude_and_offset(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "SOUR1:MARK1:VOLT 0.6;VOLT:OFFS 0.2")
    assert ask(awg, "SOUR1:MARK1:VOLT:HIGH?;LOW?") == b"5.0000000000E-01;-1.0000000000E-01"
    assert errors(ask, awg) == "0"


def test_an_error_text_that_holds_a_line_end(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "OUTPUT1:PATH DCA")
    assert ask(awg, "*ESR?") == b"16"
    assert ask(awg, "SYST:ERR?") == b'-222,"Data out of range;Data Out of Range - OUTPUT1:PATH DCA\r\n"'
    ask(awg, "OUTPUT1:PATH DIR")
    assert errors(ask, awg) == "0"


def test_system_tree(ask: Ask, awg: VirtualAwg70002a, heard: Heard) -> None:
    assert ask(awg, "SYST:VERS?") == b"1999.0"
    assert ask(awg, "SYST:DATE?") == b"2024,01,01"
    assert ask(awg, "*OPT?") == b"03,225"
    ask(awg, "SYST:DATE 2026,2,3")
    assert ask(awg, "SYST:DATE?") == b"2026,02,03"
    ask(awg, "SYST:TIME 10,20,30;:SYST:DATE 2026,2,31")
    assert ask(awg, "SYST:TIME?") == b"10,20,30"
    assert errors(ask, awg) == "-222"
    heard.clock.advance(60.0)
    minutes = int(ask(awg, "SYST:TIME?").split(b",")[1])
    heard.clock.advance(60.0)
    assert int(ask(awg, "SYST:TIME?").split(b",")[1]) == (minutes + 1) % 60
