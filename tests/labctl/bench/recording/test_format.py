"""The container of recordings: what goes in comes out, torn ends are noticed, damage is refused."""

import json
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from labctl.bench.recording.format import PACK_FROM, RECORD, Kind, Recording, RecordingWriter, read_recording
from labctl.errors import RecordingError

MESSAGES = st.lists(
    st.tuples(
        st.sampled_from([Kind.SENT, Kind.RECEIVED]),
        st.lists(st.one_of(st.binary(max_size=2 * PACK_FROM), st.just(bytes(3 * PACK_FROM))), max_size=3),
    ),
    max_size=8,
)
IN_ONE_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60)


def write(path: Path, messages: list[tuple[Kind, list[bytes]]]) -> Path:
    path.unlink(missing_ok=True)
    writer = RecordingWriter(path, {"masked": False})
    writer.append(Kind.OPENED, 1, [b'{"instrument": "awg", "resource": "here"}'])
    for kind, chunks in messages:
        writer.append(kind, 1, chunks)
    writer.append(Kind.CLOSED, 1)
    writer.close()
    return path


def contents(recording: Recording) -> list[tuple[Kind, bytes]]:
    return [(record.kind, record.read()) for record in recording.records]


@given(messages=MESSAGES)
@IN_ONE_FOLDER
def test_what_goes_in_comes_out(tmp_path: Path, messages: list[tuple[Kind, list[bytes]]]) -> None:
    recording = read_recording(write(tmp_path / "a.rec", messages))
    assert recording.complete
    assert recording.lost_bytes == 0
    (connection,) = recording.connections
    assert (connection.instrument, connection.resource, connection.closed) == ("awg", "here", True)
    assert [(message.kind, message.read()) for message in connection.messages] == [
        (kind, b"".join(chunks)) for kind, chunks in messages
    ]
    times = [record.time_s for record in recording.records]
    assert times == sorted(times)


@given(messages=MESSAGES, data=st.data())
@IN_ONE_FOLDER
def test_wherever_it_is_cut_what_is_before_can_be_read(
    tmp_path: Path, messages: list[tuple[Kind, list[bytes]]], data: st.DataObject
) -> None:
    path = write(tmp_path / "a.rec", messages)
    whole = path.read_bytes()
    records = contents(read_recording(path))
    first_line = whole.index(b"\n") + 1
    cut = data.draw(st.integers(first_line, len(whole) - 1))
    path.write_bytes(whole[:cut])
    recording = read_recording(path)
    found = contents(recording)
    assert not recording.complete
    assert found == records[: len(found)]
    kept = recording.records[-1].offset + recording.records[-1].stored if found else first_line
    assert recording.lost_bytes == cut - kept


@given(messages=MESSAGES, data=st.data())
@IN_ONE_FOLDER
def test_no_changed_byte_goes_unnoticed(
    tmp_path: Path, messages: list[tuple[Kind, list[bytes]]], data: st.DataObject
) -> None:
    path = write(tmp_path / "a.rec", messages)
    whole = bytearray(path.read_bytes())
    at = data.draw(st.integers(whole.index(b"\n") + 1, len(whole) - 1))
    whole[at] ^= data.draw(st.integers(1, 255))
    path.write_bytes(whole)
    try:
        assert not read_recording(path).complete
    except RecordingError as error:
        assert "damaged at byte" in str(error)  # noqa: PT017


KILLED = """
import os, pathlib, signal, sys
from labctl.bench.recording.format import Kind, RecordingWriter
writer = RecordingWriter(pathlib.Path(sys.argv[1]), {})
writer.append(Kind.OPENED, 1, [b'{"instrument": "awg", "resource": "here"}'])
writer.append(Kind.SENT, 1, [b"DATA #6100000", bytes(range(250)) * 400])
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_process_loses_nothing_it_had_sent(tmp_path: Path) -> None:
    path = tmp_path / "a.rec"
    killed = subprocess.run([sys.executable, "-c", KILLED, str(path)], check=False)
    assert killed.returncode != 0
    recording = read_recording(path)
    assert (recording.complete, recording.lost_bytes) == (False, 0)
    assert contents(recording)[1] == (Kind.SENT, b"DATA #6100000" + bytes(range(250)) * 400)


def test_mirror_patterns_are_packed_and_noise_is_not(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).bytes(1 << 18)
    path = write(tmp_path / "a.rec", [(Kind.SENT, [b"SEQPUT ", bytes(1 << 20)]), (Kind.RECEIVED, [noise])])
    pattern, trace = read_recording(path).records[1:3]
    assert pattern.packed
    assert pattern.stored < 5000
    assert not trace.packed
    assert trace.read() == noise


def test_the_first_line_says_what_it_is(tmp_path: Path) -> None:
    heading = read_recording(write(tmp_path / "a.rec", [])).heading
    assert (heading["format"], heading["format_version"], heading["masked"]) == ("labctl-recording", "1.0", False)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not a recording"),
        (b"*IDN?\n", "is not a recording"),
        (b"[1]\n", "is not a recording"),
        (json.dumps({"format": "labctl-recording", "format_version": "2.0"}).encode() + b"\n", "format version '2.0'"),
        (b'{"format": "labctl-recording", "format_version": "1.0"}', "is not a recording"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.rec"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        read_recording(path)


def test_missing_present_and_impossible_files(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be read"):
        read_recording(tmp_path / "none.rec")
    with pytest.raises(RecordingError, match="exists"):
        RecordingWriter(write(tmp_path / "a.rec", []), {})
    with pytest.raises(RecordingError, match="cannot be written"):
        RecordingWriter(tmp_path / "nowhere" / "a.rec", {})


def test_a_message_of_no_connection_is_refused(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.rec", {})
    writer.append(Kind.SENT, 7, [b"*IDN?\n"])
    writer.close()
    with pytest.raises(RecordingError, match="connection 7 was never opened"):
        _ = read_recording(tmp_path / "a.rec").connections


def test_a_file_that_changes_under_the_reader_is_noticed(tmp_path: Path) -> None:
    path = write(tmp_path / "a.rec", [(Kind.SENT, [bytes(1000)])])
    packed = read_recording(path).records[1]
    path.write_bytes(path.read_bytes()[: packed.offset] + b"x" * packed.stored)
    with pytest.raises(RecordingError, match="has changed"):
        packed.read()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_is_told_once(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.rec", {})
    writer._file.close()
    with Path("/dev/full").open("wb", buffering=0) as full:
        writer._file = full  # type: ignore[assignment]
        with pytest.raises(RecordingError, match="make room"):
            writer.append(Kind.SENT, 1, [b"*IDN?\n"])
        writer.append(Kind.SENT, 1, [b"OUTPUT OFF\n"])


def test_records_are_as_long_as_documented() -> None:
    assert RECORD.size == 30


@pytest.mark.parametrize("at", range(14, 28))
def test_a_record_that_claims_to_be_longer_is_damaged_and_not_cut(at: int, tmp_path: Path) -> None:
    """Bytes 14 to 29 of a record are its length and that of what is stored."""
    path = tmp_path / "a.rec"
    with closing(RecordingWriter(path, {})) as writer:
        writer.append(Kind.SENT, 0, (b"hello",))
    image = bytearray(path.read_bytes())
    image[image.index(b"\n") + 1 + at] ^= 0x40
    path.write_bytes(image)
    with pytest.raises(RecordingError, match="is damaged at byte"):
        read_recording(path)
