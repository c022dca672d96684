"""The disk of the virtual AWG, and loading waveforms and sequences from it."""

import zipfile
from contextlib import suppress
from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.scpi.status import ScpiError
from sim_backends.virtual import VirtualAwg70002a
from sim_backends.virtual.awg70002a.seqx import read_seqx, read_sml
from sim_backends.virtual.awg70002a.wfmx import WaveformFile, write_wfmx
from sim_backends.virtual.disk import CAPACITY, Disk
from sim_backends.world.world import World
from tests.sim_backends.virtual.awg70002a.session import block, errors
from tests.sim_backends.virtual.watched import Ask

SAMPLES = np.linspace(-1, 1, 2400, dtype=np.float32)
FLAGS = "".join(f'<Flag name="{name}">Toggle</Flag>' for name in "ABCD")


def waveform(scale: float = 1.0) -> bytes:
    markers = np.full(SAMPLES.size, 0x40, np.uint8)
    return write_wfmx(WaveformFile(np.float32(scale) * SAMPLES, markers, 1e10), time_stamp="")


def step(number: int, *assets: str, kind: str = "Waveform", **settings: str) -> str:
    words = {
        "Repeat": "Once",
        "RepeatCount": "1",
        "WaitInput": "None",
        "EventJumpInput": "None",
        "EventJumpTo": "Next",
        "EventJumpToStep": "1",
        "GoTo": "Next",
        "GoToStep": "1",
    } | settings
    inside = "".join(f"<{name}>{text}</{name}>" for name, text in words.items())
    listed = "".join(f"<Asset><AssetName>{a}</AssetName><AssetType>{kind}</AssetType></Asset>" for a in assets)
    return (
        f"<Step><StepNumber>{number}</StepNumber>{inside}<Assets>{listed}</Assets>"
        f"<Flags><FlagSet>{FLAGS}</FlagSet></Flags></Step>"
    )


def sml(name: str, *steps: str, tracks: int = 1) -> str:
    return (
        '<DataFile offset="000000000" version="0.1"><DataSetsCollection xmlns="http://www.tektronix.com">'
        f"<DataSets><DataDescription><SequenceName>{name}</SequenceName><JumpTiming>JumpImmed</JumpTiming>"
        "<RecSampleRate>NaN</RecSampleRate><RepeatFlag>false</RepeatFlag>"
        f'<Steps StepCount="{len(steps)}" TrackCount="{tracks}">{"".join(steps)}</Steps>'
        "</DataDescription></DataSets></DataSetsCollection><Setup /></DataFile>"
    )


def seqx() -> bytes:
    """A main sequence on two tracks with a sub-sequence, and another sequence."""
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        sub = sml("sub", step(1, "w1", "w2", Repeat="Infinite"), tracks=2)
        first = step(1, "w1", "w2", WaitInput="TrigA", Repeat="RepeatCount", RepeatCount="5")
        second = step(2, "sub", kind="Sequence", EventJumpInput="TrigB", EventJumpTo="StepIndex", EventJumpToStep="2")
        last = step(3, "w2", "w1", GoTo="StepIndex", GoToStep="1", WaitInput="Internal")
        archive.writestr("Sequences/sub.sml", sub)
        archive.writestr("Sequences/main.sml", sml("main", first, second, last, tracks=2))
        archive.writestr("Sequences/other.sml", sml("other", step(1, "w3")))
        for number in (1, 2, 3):
            archive.writestr(f"Waveforms/w{number}.wfmx", waveform(1 / number))
        archive.writestr("setup.xml", "<RSAPersist/>")
        archive.writestr("userNotes.txt", b"")
    return buffer.getvalue()


def send(ask: Ask, awg: VirtualAwg70002a, name: str, data: bytes) -> None:
    ask(awg, f'MMEM:DATA "{name}",'.encode() + block(data))


def test_folders(ask: Ask, awg: VirtualAwg70002a) -> None:
    assert ask(awg, "MMEM:CDIR?;MSIS?") == b'"C:\\";"C:"'
    ask(awg, 'MMEMory:CDIRectory "\\Users\\OEM\\Documents"')
    assert ask(awg, "MMEM:CDIR?") == b'"C:\\Users\\OEM\\Documents"'
    ask(awg, 'MMEM:MDIR "waves";CDIR "WAVES"')
    assert ask(awg, "MMEM:CDIR?") == b'"C:\\Users\\OEM\\Documents\\waves"'
    send(ask, awg, "x.bin", b"1234\n6789")
    assert ask(awg, "MMEM:CAT?") == f'9,{CAPACITY - 9},"x.bin,,9"'.encode()
    ask(awg, 'MMEM:CDIR "..\\."')
    assert ask(awg, 'MMEM:CAT? "C:"').endswith(b',"waves,DIR,0"')
    ask(awg, 'MMEM:CDIR;MSIS "C:";MSIS')
    assert ask(awg, "MMEM:CDIR?") == b'"C:\\"'
    assert errors(ask, awg) == "0"


def test_data_in_pieces(ask: Ask, awg: VirtualAwg70002a) -> None:
    send(ask, awg, "x.bin", b"0123456789")
    ask(awg, b'MMEM:DATA "X.BIN",8,' + block(b"abcd"))
    assert ask(awg, 'MMEM:DATA? "x.bin"') == b"#2120123456" + b"7abcd"
    assert ask(awg, 'MMEM:DATA? "x.bin",8') == b"#14abcd"
    assert ask(awg, 'MMEM:DATA? "C:\\x.bin",6,3') == b"#1367a"
    assert ask(awg, 'MMEM:DATA:SIZE? "x.bin"') == b"12"
    send(ask, awg, "x.bin", b"new")
    assert ask(awg, 'MMEM:DATA? "x.bin"') == b"#13new"
    ask(awg, 'MMEM:DEL "x.bin","C:"')
    assert errors(ask, awg) == "0"


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ('MMEM:DEL "absent.wfmx"', -256),
        ('MMEM:DEL "C:\\Users"', -250),
        ('MMEM:DEL "\\"', -250),
        ('MMEM:DATA? "absent"', -256),
        ('MMEM:DATA? "x.bin",4', -222),
        ('MMEM:DATA? "x.bin",1,3', -222),
        ('MMEM:DATA:SIZE? "absent"', -256),
        ('MMEM:DATA "x.bin",9,#11a', -222),
        ('MMEM:DATA "no\\x.bin",#11a', -256),
        ('MMEM:DATA "Users",#11a', -257),
        ('MMEM:DATA "a*b",#11a', -257),
        ('MMEM:CDIR "absent"', -256),
        ('MMEM:CDIR "D:\\"', -250),
        ('MMEM:MSIS "D:"', -250),
        ('MMEM:MDIR "Users"', -257),
        ('MMEM:MDIR "no\\such"', -256),
        ('MMEM:OPEN "absent.wfmx"', -256),
        ('MMEM:OPEN "x.bin"', -200),
        ('MMEM:OPEN:SASS "x.bin"', -200),
        ('MMEM:OPEN:SASS:SEQ "bad.seqx"', -200),
        ('MMEM:OPEN "bad.wfmx"', -200),
        ('MMEM:IMP "w","x.bin",TXT', -200),
        ('MMEM:IMP "w","x.bin",ISF', -200),
        ('MMEM:IMP "w","absent",ISF', -256),
        ('MMEM:IMP "w","x.bin",JPEG', -224),
        ('MMEM:IMP "","text",TXT', -224),
        ('MMEM:OPEN:SASS:SEQ "good.seqx","no"', -224),
        ('MMEM:OPEN:SASS:WAV "good.seqx","no"', -224),
        ('WLIS:WAV:ACF "x.bin","none"', -224),
    ],
)
def test_errors(ask: Ask, awg: VirtualAwg70002a, command: str, code: int) -> None:
    for name, data in {"x.bin": b"abc", "text": b"1\n2", "bad.seqx": b"abc", "bad.wfmx": b"abc"}.items():
        send(ask, awg, name, data)
    send(ask, awg, "good.seqx", seqx())
    before = ask(awg, "MMEM:CAT?")
    assert ask(awg, command) == b""
    assert errors(ask, awg) == str(code)
    assert ask(awg, "MMEM:CAT?;:WLIS:SIZE?;:SLIS:SIZE?") == before + b";0;0"


def test_loading_a_waveform(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, 'MMEM:CDIR "\\Users\\OEM\\Documents"')
    send(ask, awg, "pulse.wfmx", waveform())
    ask(awg, 'MMEM:OPEN "C:\\Users\\OEM\\Documents\\pulse.wfmx"')
    assert ask(awg, "*OPC?;:WLIS:LIST?;LAST?") == b'1;"pulse";"pulse"'
    assert np.array_equal(np.frombuffer(ask(awg, 'WLIS:WAV:DATA? "pulse"')[6:], "<f4"), SAMPLES)
    assert ask(awg, 'WLIS:WAV:MARK:DATA? "pulse",0,2;:WLIS:WAV:SRAT? "pulse"') == b"#12\x40\x40;1.0000000000E+10"
    ask(awg, 'SOUR1:CASS:WAV "pulse";:OUTP1 1;:AWGC:RUN;*OPC?')
    send(ask, awg, "pulse.wfmx", waveform(0.5))
    ask(awg, 'MMEM:OPEN "pulse.wfmx"')  # in the place of the one that plays
    assert ask(awg, "WLIS:SIZE?;:AWGC:RST?") == b"1;2"
    assert np.allclose(np.frombuffer(ask(awg, 'WLIS:WAV:DATA? "pulse"')[6:], "<f4"), SAMPLES / 2)
    ask(awg, 'MMEM:SAVE:WAV:WFMX "pulse","copy.wfmx";:MMEM:IMP "copy","copy.wfmx",WFMX')
    assert ask(awg, 'WLIS:WAV:DATA? "copy"') == ask(awg, 'WLIS:WAV:DATA? "pulse"')
    assert errors(ask, awg) == "0"


def test_loading_text(ask: Ask, awg: VirtualAwg70002a) -> None:
    send(ask, awg, "t.txt", b"0\n0.25\n0.5,1\n")
    ask(awg, 'MMEM:IMP "plain","t.txt",TXT;:MMEM:OPEN:PAR:NORM ZREF;:MMEM:IMP "scaled","t.txt",TXT')
    ask(awg, 'MMEM:OPEN:PAR:NORM FSC;:MMEM:IMP "t","t.txt",TXT;:MMEM:OPEN:PAR:NORM NONE')
    values = [
        np.frombuffer(ask(awg, f'WLIS:WAV:DATA? "{name}"')[4:], "<f4").tolist() for name in ("plain", "scaled", "t")
    ]
    assert values == [[0.0, 0.25, 0.5], [0.0, 0.5, 1.0], [-1.0, 0.0, 1.0]]
    assert ask(awg, 'WLIS:WAV:MARK:DATA? "t";:MMEM:OPEN:PAR:NORM?') == b"#13\x00\x00\x40;NONE"
    send(ask, awg, "codes.txt", b"0\n1023")
    ask(awg, 'MMEM:IMP "codes","codes.txt",TXT10')
    assert np.frombuffer(ask(awg, 'WLIS:WAV:DATA? "codes"')[3:], "<f4").tolist() == [-1.0, 1.0]
    assert errors(ask, awg) == "0"


def test_loading_sequences(ask: Ask, awg: VirtualAwg70002a) -> None:
    send(ask, awg, "good.seqx", seqx())
    ask(awg, 'MMEMory:OPEN:SASSet:SEQuence "C:\\good.seqx","main"')
    assert ask(awg, "*OPC?;:SLIS:SIZE?;NAME? 1;NAME? 2;:WLIS:LIST?") == b'1;2;"main";"sub";"w1,w2"'
    for query, reply in {
        'LENG? "main"': "3",
        'TRAC? "main"': "2",
        'STEP1:WINP? "main"': "ATR",
        'STEP1:RCO? "main"': "5",
        'STEP1:TASS2? "main"': '"w2"',
        'STEP2:TASS1:TYPE? "main"': "SEQ",
        'STEP2:EJIN? "main"': "BTR",
        'STEP2:EJUM? "main"': "2",
        'STEP3:GOTO? "main"': "1",
        'STEP3:WINP? "main"': "ITR",
        'STEP1:RCO? "sub"': "INF",
        'STEP1:TFL1:CFL? "main"': "TOGG",
        'EVEN:JTIM? "main"': "IMM",
    }.items():
        assert ask(awg, f"SLIS:SEQ:{query}").decode() == reply, query
    ask(awg, 'MMEM:OPEN "good.seqx"')
    assert ask(awg, "SLIS:SIZE?;:WLIS:SIZE?") == b"3;3"
    ask(awg, 'SOUR1:CASS:SEQ "main", 1;:AWGC:RUN;*OPC?')
    assert ask(awg, "AWGC:RST?;:SOUR1:SCST?") == b"1;1"
    assert errors(ask, awg) == "0"


def test_loading_only_the_waveforms(ask: Ask, awg: VirtualAwg70002a) -> None:
    send(ask, awg, "good.awgx", seqx())
    ask(awg, 'MMEM:OPEN:SASS:WAV "good.awgx", "w2"')
    assert ask(awg, "WLIS:LIST?") == b'"w2"'
    ask(awg, 'MMEM:OPEN:SASS "good.awgx"')
    assert ask(awg, "WLIS:LIST?;:SLIS:SIZE?") == b'"w2,w1,w3";0'


def test_files_outlive_a_reset(ask: Ask, awg: VirtualAwg70002a, world: World) -> None:
    send(ask, awg, "x.bin", b"abc")
    ask(awg, "*RST")
    assert ask(awg, 'MMEM:DATA:SIZE? "x.bin"') == b"3"
    ask(VirtualAwg70002a(world), 'MMEM:DATA:SIZE? "x.bin"')
    ask(awg, 'MMEM:MDIR "d";DEL "d"')
    assert errors(ask, awg) == "0"


def test_the_disk_is_finite(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim_backends.virtual.disk.CAPACITY", 10)
    disk = Disk()
    disk.write("a", memoryview(b"12345678"))
    with pytest.raises(ScpiError, match="-254"):
        disk.write("b", memoryview(b"123"))
    with pytest.raises(ScpiError, match="-257"):
        disk.make_folder("\\".join(["x"] * 80))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<WaitInput>None", "<WaitInput>Door"),
        ("<GoTo>Next", "<GoTo>Back"),
        ("<Repeat>Once", "<Repeat>Often"),
        ("<Repeat>Once", "<Repeat>RepeatCount</Repeat><RepeatCount>0</RepeatCount><Repeat>x"),
        ('TrackCount="1"', 'TrackCount="99"'),
        ("<Step>", "<Stop>"),
    ],
)
def test_wrong_sequences(old: str, new: str) -> None:
    text = sml("s", step(1, "w")).replace(old, new)
    with pytest.raises(ScpiError):
        read_sml(text.encode(), "s")


def test_a_recommended_rate_in_a_sequence() -> None:
    text = sml("s", step(1, "w")).replace("NaN", "1e9")
    assert read_sml(text.encode(), "s").sample_rate == 1e9
    text = text.replace("1e9", "fast").replace("<SequenceName>s", "<SequenceName>")
    found = read_sml(text.encode(), "file")
    assert np.isnan(found.sample_rate)
    assert found.name == "file"


@given(at=st.integers(0, 400), byte=st.integers(0, 255))
def test_a_damaged_archive_is_refused_or_read(at: int, byte: int) -> None:
    data = bytearray(_ARCHIVE)
    data[at * len(data) // 401] = byte
    with suppress(ScpiError):
        read_seqx(memoryview(bytes(data)))


_ARCHIVE = seqx()
