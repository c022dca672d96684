"""Files as somebody might change them.

Where a file carries a checksum over what was changed, it is made to fit again: otherwise every change would be refused
at the door, and what lies behind it would never be tried.
"""

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from hypothesis import strategies as st
from PIL import Image

from instruments.values import Frames
from labctl.bench import calibration
from labctl.bench.recording.format import CHECK, RECORD, Kind, RecordingWriter
from labctl.bench.simulation import SIMULATED_LASER
from labctl.runs.format.journal import Entry
from labctl.runs.format.shard import encode
from labctl.runs.live.logs import EventLog
from labctl.studies.paper.experiments import FOLDER
from sim_backends.virtual.awg70002a.wfmx import WaveformFile, write_wfmx
from tests.fuzz.changes import CHANGES, END, changed
from tests.fuzz.link import COUNTED
from tests.fuzz.readers import PICTURE, READERS, SHAPE

OLDER = Path(__file__).parents[1] / "labctl" / "runs" / "older" / "1.1"
"""Runs and readouts of a format whose texts have variable lengths."""


@dataclass(frozen=True)
class Subject:
    """Valid files of one kind, their name, and how a changed one is made to fit its own checksums."""

    valid: Callable[[], tuple[bytes, ...]]
    name: str = "some.toml"
    mended: Callable[[bytes], bytes] = bytes


def taken_or_refused(data: st.DataObject, kind: str) -> None:
    """Whatever was changed: the file is read, or refused with the one error of its kind in one line."""
    COUNTED["inputs"] += 1
    COUNTED[kind] += 1
    subject, reader = SUBJECTS[kind], READERS[kind]
    valid = data.draw(st.sampled_from(subject.valid()))
    content = subject.mended(changed(valid, data.draw(CHANGES), data.draw(END)))
    with TemporaryDirectory() as folder:
        path = Path(folder) / subject.name
        path.write_bytes(content)
        try:
            reader.read(path)
        except reader.refuses as error:
            assert len(str(error).splitlines()) == 1, repr(str(error))  # noqa: PT017
            assert len(str(error)) < 2000  # noqa: PT017
        assert [found.name for found in Path(folder).iterdir()] == [subject.name]


# --- valid files


def _station() -> tuple[bytes, ...]:
    text = """
    name = "room 2"
    [awg]
    address = "TCPIP0::192.0.2.1::inst0::INSTR"
    amplitude = "400 mVpp"
    timeout = 5.0
    [laser]
    power = "13 dBm"
    wavelength = "1551 nm"
    commands = "table.toml"
    [scope]
    channels = [1, 2]
    trigger_source = "auxiliary"
    [sim]
    twin_seed = 3
    parameters = { enob = 4.5, shared_reference = false }
    """
    return (text.encode(),)


def _protocol() -> tuple[bytes, ...]:
    return (
        b'protocol = "image-readout"\n[settings]\nimages = 40\nwindow = "1 ns"\ndataset = "mnist-0-3"\n',
        b'protocol = "wavelength-scan"\n[settings]\nimages = 4\n',
    )


def _experiments() -> tuple[bytes, ...]:
    return tuple(path.read_bytes() for path in sorted(FOLDER.glob("*.toml")))


def _recording() -> tuple[bytes, ...]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.rec"
        writer = RecordingWriter(path, {"bench": "b"}, clock=lambda: 0)
        writer.append(Kind.OPENED, 1, [b'{"instrument": "awg", "resource": "here"}'])
        writer.append(Kind.SENT, 1, [b"*IDN?\n"])
        writer.append(Kind.RECEIVED, 1, [bytes(2000)])
        writer.append(Kind.CLOSED, 1)
        writer.close()
        return (path.read_bytes(),)


def _with_record_checks(content: bytes) -> bytes:
    mended = bytearray(content)
    at = content.find(b"\n") + 1
    while 0 < at <= len(mended) - RECORD.size - CHECK.size:
        stored = RECORD.unpack_from(mended, at)[5]
        data = at + RECORD.size + CHECK.size
        crc = zlib.crc32(mended[data : data + stored], zlib.crc32(mended[at : at + RECORD.size]))
        CHECK.pack_into(mended, at + RECORD.size, crc)
        at = data + stored
    return bytes(mended)


def _journal() -> tuple[bytes, ...]:
    entries = [Entry(n, n // 2, 2, 3 * (n % 2), 3 * (n // 2), 3, "9f" * 32) for n in range(4)]
    entries.append(Entry(3, 1, 2, 3, -3, 3, "9f" * 32, discarded="damaged"))
    return (b"".join(entry.encode() for entry in entries),)


def _with_line_checks(content: bytes) -> bytes:
    def mended(line: bytes) -> bytes:
        body, comma, _ = line.rpartition(b', "crc": "')
        return body + comma + f'{zlib.crc32(body + b"}"):08x}"}}\n'.encode() if comma else line

    return b"".join(mended(line) for line in content.splitlines(keepends=True))


def _shard() -> tuple[bytes, ...]:
    ports, shots = len(SHAPE.passes[0]), 3
    columns = np.zeros((shots, ports))
    frames = Frames(np.zeros((*columns.shape, SHAPE.samples), np.int8), columns, np.zeros(shots), columns > 0)
    older = (OLDER / "complete" / "shards" / "000000.h5").read_bytes()
    return bytes(encode(SHAPE, 0, 0, [frames], 0, np.ones(ports), np.zeros(ports))), older


def _readout() -> tuple[bytes, ...]:
    from labctl.analysis.readouts import softmax_classifier
    from labctl.studies.readout_file import save_model

    generator = np.random.default_rng(1)
    pipeline = softmax_classifier().fit(generator.normal(size=(20, 3)), np.arange(20) % 2)
    with TemporaryDirectory() as folder:
        save_model(Path(folder) / "a.h5", pipeline, {"seed": 1})
        return (Path(folder) / "a.h5").read_bytes(), (OLDER / "readout.h5").read_bytes()


def _run() -> tuple[bytes, ...]:
    from tests.labctl.runs.conftest import write_whole

    with TemporaryDirectory() as folder:
        whole = write_whole(Path(folder) / "run") / "data.h5"
        return whole.read_bytes(), (OLDER / "complete" / "data.h5").read_bytes()


def _idx() -> tuple[bytes, ...]:
    return (
        bytes([0, 0, 8, 3]) + struct.pack(">3I", 2, 3, 4) + bytes(24),
        bytes([0, 0, 8, 1]) + struct.pack(">I", 5) + bytes(5),
    )


def _npz() -> tuple[bytes, ...]:
    found = []
    for save in (np.savez, np.savez_compressed):
        save(file := io.BytesIO(), images=np.zeros((3, 4, 5), np.uint8), labels=np.arange(3))
        found.append(file.getvalue())
    return tuple(found)


def _series() -> tuple[bytes, ...]:
    np.save(file := io.BytesIO(), np.arange(20.0))
    return (file.getvalue(),)


def _vowels() -> tuple[bytes, ...]:
    return (b"0 1 1 -3.5 1 2 3 4 5 6 7 8 9 10\n1, 2, 0, 1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 4\n",)


def _pictures() -> tuple[bytes, ...]:
    Image.fromarray(np.zeros(PICTURE, np.uint8)).save(picture := io.BytesIO(), "JPEG")
    return (_zipped({"Negative/1.jpg": picture.getvalue(), "Positive/1.jpg": picture.getvalue()}),)


def _wfmx() -> tuple[bytes, ...]:
    waveform = WaveformFile(np.linspace(-1, 1, 20, dtype=np.float32), np.zeros(20, np.uint8), 1e10, 0.3)
    return (write_wfmx(waveform, time_stamp="2024-01-01T00:00:00.000+00:00"),)


def _calibration() -> tuple[bytes, ...]:
    stored = calibration.Stored(
        format_version=calibration.FORMAT_VERSION,
        date=datetime(2026, 11, 1, 9, 15, tzinfo=UTC),
        good=True,
        bench={"name": "room 2", "projector": True, "twin": None},
        settings={"scope": {"channels": [1, 2]}, "laser": {"power": 0.03}},
        instruments={"laser": {"identity": {"model": "TLG-220"}}},
        findings=[{"name": "delay", "value": 98e-9, "good": True}],
    )
    return (stored.model_dump_json().encode(),)


def _events() -> tuple[bytes, ...]:
    with TemporaryDirectory() as folder, EventLog() as events:
        events.event(
            "run started", protocol="image-readout", shots=20, records=40, pid=1, station="bench.toml", simulated=True
        )
        events.event("power set", power_w=0.03)
        events.event("tuned", wavelength_nm=1550.0)
        events.event("emission", on=True)
        events.event("patched", ports={"1": 2, "2": 3})
        events.event("scope set", channels=[1, 2], samples=50, sample_rate=25e9)
        events.event("pass started", **{"pass": 0, "passes": 2}, wavelength_nm=1550.0)
        picture = {"rows": 2, "columns": 4, "bits": "8A=="}
        events.progress(20, 40, lambda: {"shot": 19, "kind": "image", "label": 3, "dataset_index": 7, "image": picture})
        events.event("warning", text="records touch the end of the vertical range")
        events.event("paused", done=20, total=40)
        events.event("safe state", reached=True, by="supervisor", text="dark")
        events.event("failed", error="scope: no trigger", notes=["the run can go on"])
        events.keep_in(Path(folder) / "events.jsonl")
        return ((Path(folder) / "events.jsonl").read_bytes(),)


def _seqx() -> tuple[bytes, ...]:
    step = (
        "<Step><Repeat>RepeatCount</Repeat><RepeatCount>5</RepeatCount><WaitInput>TrigA</WaitInput><GoTo>StepIndex</GoTo>"
        '<GoToStep>1</GoToStep><Assets><Asset><AssetName>w</AssetName></Asset></Assets><FlagSet><Flag name="A">High'
        "</Flag></FlagSet></Step>"
    )
    text = f'<Sequence><SequenceName>s</SequenceName><Steps TrackCount="1">{step}</Steps></Sequence>'
    return (_zipped({"s.sml": text.encode(), "w.wfmx": _wfmx()[0]}),)


def _zipped(files: Mapping[str, bytes]) -> bytes:
    with zipfile.ZipFile(file := io.BytesIO(), "w", zipfile.ZIP_STORED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content)
    return file.getvalue()


def _with_member_checks(content: bytes) -> bytes:
    """A zip file whose stored members have the checksums of what they hold now."""
    mended = bytearray(content)
    for entry in re.finditer(rb"PK\x01\x02", content):
        at = entry.start()
        if at + 46 > len(content):
            continue
        (begin,) = struct.unpack_from("<I", content, at + 42)
        (size,) = struct.unpack_from("<I", content, at + 20)
        if begin + 30 <= len(content) and content[begin : begin + 4] == b"PK\x03\x04":
            first = begin + 30 + sum(struct.unpack_from("<HH", content, begin + 26))
            crc = struct.pack("<I", zlib.crc32(content[first : first + size]))
            mended[at + 16 : at + 20] = mended[begin + 14 : begin + 18] = crc
    return bytes(mended)


SUBJECTS: Mapping[str, Subject] = {
    "calibration": Subject(cache(_calibration), name="calibration.json"),
    "events": Subject(cache(_events), name="events.jsonl"),
    "station": Subject(cache(_station)),
    "protocol": Subject(cache(_protocol)),
    "experiment": Subject(cache(_experiments)),
    "laser table": Subject(cache(lambda: (SIMULATED_LASER.read_bytes(),))),
    "recording": Subject(cache(_recording), mended=_with_record_checks),
    "journal": Subject(cache(_journal), mended=_with_line_checks),
    "shard": Subject(cache(_shard)),
    "readout": Subject(cache(_readout)),
    "run": Subject(cache(_run), name="data.h5"),
    "idx": Subject(cache(_idx)),
    "npz": Subject(cache(_npz), mended=_with_member_checks),
    "series": Subject(cache(_series)),
    "vowels": Subject(cache(_vowels)),
    "pictures": Subject(cache(_pictures), name="some.zip", mended=_with_member_checks),
    "wfmx": Subject(cache(_wfmx)),
    "waveform text": Subject(lambda: (b"-1\r\n0.5,1\n1\t0\t1\n1e10\n",)),
    "seqx": Subject(cache(_seqx), mended=_with_member_checks),
}
