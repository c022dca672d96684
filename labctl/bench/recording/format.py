"""A recording: what went over the wire between labctl and the instruments of one bench, byte for byte, with its time.

The file begins with one line of JSON (`format`, `format_version`, `started`, ...) and goes on with records, each

    kind u8, packed u8, connection u32, time u64 (ns since the start), length u64, stored u64, CRC-32 u32

little-endian (`RECORD`), then `stored` bytes. The CRC is over the fields before it and the stored bytes. `packed` = 1:
the bytes are a zlib stream that unpacks to `length` bytes. Records are only ever appended, and handed to the operating
system one by one: killing the process tears the last one at most.
"""

import contextlib
import json
import struct
import threading
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import IntEnum
from pathlib import Path
from typing import Any, BinaryIO

from instruments.remedies import unreadable, unwritable
from labctl.errors import RecordingError

FORMAT = "labctl-recording"
FORMAT_VERSION = "1.0"
RECORD = struct.Struct("<BBIQQQ")
CHECK = struct.Struct("<I")
PACK_FROM = 256
"""Bytes; what is shorter is stored as it is."""
PROBE = 1 << 16
"""Bytes at the start of a block whose compression decides whether the whole is worth it: noise is not."""
WORTH_PACKING = 0.9
LONGEST_HEADING = 1 << 20
LONGEST_MESSAGE = 1 << 30
"""Bytes, unpacked: a block of a SCPI message ends before, its length has nine digits."""
MOST_UNPACKED = 1100
"""Times the stored bytes: zlib makes at most 1032 of one."""
READ_AT_ONCE = 1 << 20

Chunk = bytes | bytearray | memoryview


class Kind(IntEnum):
    """What a record holds."""

    OPENED = 1  # a connection; its bytes are JSON: instrument, resource
    SENT = 2  # one message to the instrument, terminator included
    RECEIVED = 3  # one reply, terminator included
    CLOSED = 4  # a connection, by labctl
    END = 5  # of the recording: the bench was closed in good order


class RecordingWriter:
    """Appends records to a new file; may be used by several threads."""

    def __init__(self, path: Path, heading: Mapping[str, Any], clock: Callable[[], int] = time.perf_counter_ns) -> None:
        """Begin a recording; `heading` is added to its first line.

        Raises:
            RecordingError: the file exists or cannot be written.
        """
        try:
            self._file = path.open("xb")
        except FileExistsError:
            raise RecordingError(f"{path}: exists: name a new file") from None
        except OSError as error:
            raise RecordingError(unwritable(path, error, "name another file")) from None
        self._clock = clock
        self._started = clock()
        self._path = path
        self._lock = threading.Lock()
        self._broken = False
        stamp = datetime.now(UTC).isoformat(timespec="seconds")
        first = {"format": FORMAT, "format_version": FORMAT_VERSION, "started": stamp} | dict(heading)
        self._file.write(json.dumps(first).encode() + b"\n")
        self._file.flush()

    def append(self, kind: Kind, connection: int = 0, chunks: Sequence[Chunk] = ()) -> None:
        """Append one record; what it holds is the chunks one behind the other.

        Raises:
            RecordingError: it cannot be written. Said once: whoever brings the bench into its safe state then must not
                be stopped by a full disk again.
        """
        length = sum(map(len, chunks))
        packed = _packed(chunks) if length >= PACK_FROM else None
        stored = chunks if packed is None else packed
        with self._lock:
            if self._broken:
                return
            fields = RECORD.pack(
                kind, packed is not None, connection, self._clock() - self._started, length, sum(map(len, stored))
            )
            try:
                for chunk in (fields, CHECK.pack(_crc((fields, *stored))), *stored):
                    self._file.write(chunk)
                self._file.flush()
            except OSError as error:
                self._broken = True
                raise RecordingError(unwritable(self._path, error, "name another file")) from None

    def close(self) -> None:
        """End the recording in good order."""
        self.append(Kind.END)
        with contextlib.suppress(OSError):  # what is still in the buffer of a full disk
            self._file.close()


def _packed(chunks: Sequence[Chunk]) -> list[bytes] | None:
    """The chunks as one zlib stream, or None where that would not make them much smaller."""
    probe = memoryview(max(chunks, key=len))[:PROBE]
    if len(zlib.compress(probe, 1)) > WORTH_PACKING * len(probe):
        return None
    packer = zlib.compressobj(1)
    return [*(packer.compress(chunk) for chunk in chunks), packer.flush()]


def _crc(chunks: Sequence[Chunk]) -> int:
    crc = 0
    for chunk in chunks:
        crc = zlib.crc32(chunk, crc)
    return crc


@dataclass(frozen=True)
class Record:
    """One record, its bytes still in the file.

    `time_s` counts from the start of the recording; `length` is in bytes, unpacked; `stored` bytes lie at `offset`.
    """

    kind: Kind
    connection: int
    time_s: float
    length: int
    path: Path
    offset: int
    stored: int
    packed: bool

    def read(self) -> bytes:
        """Its bytes.

        Raises:
            RecordingError: the file has changed since it was opened.
        """
        with self.path.open("rb") as file:
            file.seek(self.offset)
            data = file.read(self.stored)
        try:
            data = zlib.decompressobj().decompress(data, self.length + 1) if self.packed else data
        except zlib.error:
            data = b""
        if len(data) != self.length:
            raise RecordingError(f"{self.path}: has changed while it was read: play it again")
        return data


@dataclass(frozen=True)
class Connection:
    """One recorded connection: its messages in order, and whether its end was recorded."""

    number: int
    instrument: str
    resource: str
    messages: tuple[Record, ...]
    closed: bool


@dataclass(frozen=True)
class Recording:
    """A recording as it lies on disk; `lost_bytes` is the length of the torn record at its end, if there is one."""

    path: Path
    heading: Mapping[str, Any]
    records: tuple[Record, ...]
    complete: bool
    lost_bytes: int

    @property
    def bench(self) -> str:
        """Which of the benches that a command opened this is."""
        return str(self.heading.get("bench", ""))

    @property
    def connections(self) -> tuple[Connection, ...]:
        """Every connection in the order in which they were opened.

        Raises:
            RecordingError: a message belongs to no connection, or it is not known to which instrument one was opened.
        """
        opened: dict[int, tuple[str, str]] = {}
        messages: dict[int, list[Record]] = {}
        closed: set[int] = set()
        for record in self.records:
            if record.kind is Kind.OPENED:
                opened[record.connection] = self._partner(record)
                messages[record.connection] = []
            elif record.connection not in opened:
                raise RecordingError(f"{self.path}: connection {record.connection} was never opened: record it anew")
            elif record.kind is Kind.CLOSED:
                closed.add(record.connection)
            else:
                messages[record.connection].append(record)
        return tuple(
            Connection(number, *partner, tuple(messages[number]), number in closed)
            for number, partner in opened.items()
        )

    def _partner(self, record: Record) -> tuple[str, str]:
        """Instrument and resource of a connection."""
        found = _mapping(record.read()) if record.length <= LONGEST_HEADING else {}
        instrument, resource = found.get("instrument"), found.get("resource")
        if not isinstance(instrument, str) or not isinstance(resource, str):
            raise RecordingError(
                f"{self.path}: connection {record.connection} does not say to what it was opened: record it anew"
            )
        return instrument, resource


def _mapping(text: bytes) -> dict[str, Any]:
    """A JSON object; empty for anything else."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def read_recording(path: Path) -> Recording:
    """Read a recording and check every byte of it; blocks stay on disk.

    Raises:
        RecordingError: the file cannot be read, is not a recording, or is damaged before its end.
    """
    try:
        with path.open("rb") as file:
            heading = _heading(path, file)
            whole = file.tell()
            records = tuple(_records(path, file))
            whole = records[-1].offset + records[-1].stored if records else whole
            lost = path.stat().st_size - whole
    except OSError as error:
        raise RecordingError(unreadable(path, error, "name a recording")) from None
    complete = bool(records) and records[-1].kind is Kind.END
    if complete:
        records = records[:-1]
    return Recording(path, heading, records, complete, lost)


def _heading(path: Path, file: BinaryIO) -> dict[str, Any]:
    line = file.readline(LONGEST_HEADING)
    heading = _mapping(line)
    if heading.get("format") != FORMAT or not line.endswith(b"\n"):
        raise RecordingError(f"{path}: is not a recording: name a file that labctl record wrote")
    version = str(heading.get("format_version"))
    if version.split(".")[0] != FORMAT_VERSION.split(".")[0]:
        raise RecordingError(f"{path}: has format version {version[:20]!r}: this labctl reads {FORMAT_VERSION}")
    return heading


def _records(path: Path, file: BinaryIO) -> Iterator[Record]:
    """Every whole record; ends quietly where the file was cut."""
    head = RECORD.size + CHECK.size
    while len(data := file.read(head)) == head:
        at = file.tell()
        kind, packed, connection, time_ns, length, stored = RECORD.unpack_from(data)
        shortest, longest = (-(-length // MOST_UNPACKED), length + length // 1000 + 64) if packed else (length, length)
        possible = shortest <= stored <= longest and length <= LONGEST_MESSAGE
        crc = zlib.crc32(data[: RECORD.size])
        left = stored if possible else 0  # of a record that cannot be, nothing more is needed
        while left and (chunk := file.read(min(left, READ_AT_ONCE))):
            crc = zlib.crc32(chunk, crc)
            left -= len(chunk)
        if left:
            return
        if not possible or CHECK.unpack_from(data, RECORD.size) != (crc,) or kind not in list(Kind):
            raise RecordingError(f"{path}: is damaged at byte {at - head}: use another copy, or record it anew")
        yield Record(Kind(kind), connection, time_ns / 1e9, length, path, at, stored, bool(packed))
