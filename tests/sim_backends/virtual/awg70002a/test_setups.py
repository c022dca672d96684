"""Setups, sequences and texts that the virtual AWG writes to its disk, and reads again."""

import pytest

from sim_backends.virtual import VirtualAwg70002a
from tests.sim_backends.virtual.awg70002a.session import block, errors, start, upload
from tests.sim_backends.virtual.watched import Ask, Watched

FOLDER = "C:\\Users\\OEM\\Documents\\"
LEFT = (
    "SOUR1:VOLT 0.3;SKEW 1e-10;TINP BTR;RMOD TRIG;MARK1:VOLT:LOW -0.2;HIGH 0.4;:SOUR1:MARK1:DEL 5e-11;"
    ":TRIG:IMP 1000;LEV 0.7,BTR;SOUR INT;:CLOC:SRAT 1e10;:FGEN:CHAN2:TYPE TRI;FREQ 2e6;:AWGC:ARS 1"
)
ASKED = (
    "SOUR1:VOLT?;SKEW?;TINP?;RMOD?;MARK1:VOLT:HIGH?;LOW?;:SOUR1:MARK1:DEL?;:TRIG:IMP?;LEV? BTR;SOUR?;"
    ':CLOC:SRAT?;:FGEN:CHAN2:TYPE?;FREQ?;:AWGC:ARS?;:SOUR1:CASS?;:WLIS:LIST?;:WLIS:WAV:TYPE? "m"'
)


@pytest.mark.parametrize(
    ("save", "again"),
    [("MMEM:SAVE:SET", "MMEM:OPEN:SET"), ("AWGC:SSAV", "AWGC:SRES"), ("AWGC:SSAV", "MMEM:OPEN:SET")],
)
def test_a_setup_comes_back(ask: Ask, awg: VirtualAwg70002a, world: Watched, save: str, again: str) -> None:
    start(ask, awg)
    ask(awg, LEFT)
    assert errors(ask, awg) == "0"
    before = ask(awg, ASKED)
    ask(awg, f'{save} "{FOLDER}mine.awgx"')
    assert ask(awg, "AWGC:SNAM?").decode() == f'"{FOLDER}mine.awgx"'
    ask(awg, f'*RST\n{again} "{FOLDER}mine.awgx"')
    assert ask(awg, ASKED) == before
    assert ask(awg, "OUTP1?;:AWGC:RST?") == b"0;0"
    assert errors(ask, awg) == "0"
    ask(awg, "AWGC:RUN;:OUTP1 1")
    assert world.last is not None


def test_a_setup_without_assets_assigns_nothing_that_is_not_there(ask: Ask, awg: VirtualAwg70002a) -> None:
    start(ask, awg)
    ask(awg, f'MMEM:SAVE:SET "{FOLDER}mine.awgx",0')
    ask(awg, f'MMEM:OPEN:SET "{FOLDER}mine.awgx"')
    assert ask(awg, "WLIS:SIZE?;:SOUR1:CASS:TYPE?") == b"0;NONE"
    assert errors(ask, awg) == "-224"


def test_a_sequence_comes_back_with_what_it_uses(ask: Ask, awg: VirtualAwg70002a) -> None:
    for name in ("a", "b", "unused"):
        upload(ask, awg, name=name)
    ask(awg, 'SLIS:SEQ:NEW "s",3,2;:SLIS:SEQ:NEW "below",1,2;:SLIS:SEQ:STEP1:TASS1:WAV "below","b"')
    ask(awg, 'SLIS:SEQ:STEP1:TASS2:WAV "s","a";:SLIS:SEQ:STEP2:TASS:SEQ "s","below"')
    ask(awg, 'SLIS:SEQ:STEP1:RCO "s",7;WINP "s",BTR;GOTO "s",3;EJIN "s",ATR;EJUM "s",END;TFL2:CFL "s",PULS')
    asked = (
        'SLIS:SEQ:LENG? "s";TRAC? "s";STEP1:RCO? "s";WINP? "s";GOTO? "s";EJIN? "s";EJUM? "s";TFL2:CFL? "s";:'
        'SLIS:SEQ:STEP1:TASS2? "s";:SLIS:SEQ:STEP2:TASS1:TYPE? "s"'
    )
    before = ask(awg, asked)
    ask(awg, f'MMEM:SAVE:SEQ "s","{FOLDER}s.seqx"\n*RST\nMMEM:OPEN "{FOLDER}s.seqx"')
    assert ask(awg, asked) == before
    assert ask(awg, "WLIS:SIZE?;:SLIS:SIZE?") == b"2;2"
    assert errors(ask, awg) == "0"


@pytest.mark.parametrize(("depth", "step"), [("8", 1 / 127), ("10", 1 / 511), ("ANAL", 1e-6)])
def test_a_text_comes_back(ask: Ask, awg: VirtualAwg70002a, depth: str, step: float) -> None:
    start(ask, awg)
    ask(awg, f'MMEM:SAVE:WAV:TXT "m","{FOLDER}m2.txt",{depth};:MMEM:OPEN:TXT "{FOLDER}m2.txt",{depth}')
    assert errors(ask, awg) == "0"
    (first, second), (marks, again) = (
        [awg.waveforms[name].samples for name in ("m", "m2")],
        [awg.waveforms[name].markers for name in ("m", "m2")],
    )
    assert abs(first - second).max() <= step
    assert (marks == again).all()


@pytest.mark.parametrize(
    ("command", "code"),
    [
        (f'MMEM:OPEN:SET "{FOLDER}none.awgx"', "-256"),
        (f'MMEM:OPEN:SET "{FOLDER}other.txt"', "-200"),
        (f'MMEM:SAVE:SEQ "s","{FOLDER}s.seqx"', "-224"),
        (f'WLIS:WAV:NEW "a/b",3000;:MMEM:SAVE:SET "{FOLDER}s.awgx"', "-257"),
        ('AWGC:SSAV "x.awgx","D:"', "-250"),
    ],
)
def test_errors(ask: Ask, awg: VirtualAwg70002a, command: str, code: str) -> None:
    ask(awg, f'MMEM:DATA "{FOLDER}other.txt",'.encode() + block(b"1\r\n"))
    ask(awg, command)
    assert errors(ask, awg) == code


def test_a_file_with_other_commands_than_settings_is_refused(ask: Ask, awg: VirtualAwg70002a) -> None:
    archive = awg.files
    archive.save_setup(f"{FOLDER}odd.awgx", 'SOURce1:VOLTage 0.3\nMMEMory:DELete "x"', with_assets=False)
    ask(awg, f'SOUR1:VOLT 0.4;:MMEM:OPEN:SET "{FOLDER}odd.awgx"')
    assert errors(ask, awg) == "-200"
    assert ask(awg, "SOUR1:VOLT?") == b"4.0000000000E-01"
