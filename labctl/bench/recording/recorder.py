"""How recordings are made: under `labctl record` every bench that is opened writes one."""

import hashlib
import json
import re
import threading
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from instruments.transcripts import SessionTap, Transcript
from labctl.bench.recording.format import Chunk, Kind, RecordingWriter
from labctl.bench.recording.wire import RecordingRequest
from labctl.bench.station import Station
from labctl.errors import RecordingError
from labctl.runs.format.provenance import versions

MOST_BENCHES = 1000

_IDENTITY = re.compile(rb"([^,;]*,[^,;]*,)([^,;\r\n]+)(,)")
"""An answer to *IDN?: maker, model, serial number, versions (IEEE 488.2, 10.14)."""


@contextmanager
def recorded(transcript: Transcript, station: Station, request: RecordingRequest) -> Iterator[Transcript]:
    """The transcript to give to the drivers of `station`: it passes on to `transcript`, and records.

    Raises:
        RecordingError: the recording cannot be written.
    """
    heading = {"versions": versions(), "bench": bench_of(station), "masked": request.mask}
    if not request.mask:
        heading["command"] = request.command
    with closing(_new_file(request.path, heading)) as writer:
        yield RecordingTranscript(transcript, writer, Masks() if request.mask else None)


def bench_of(station: Station) -> str:
    """What tells the benches of one command apart: a digest of the station without names, addresses and arm."""
    settings = station.model_dump(mode="json", exclude={"source": True, "name": True, "laser": {"armed"}})
    for instrument in station.addresses:
        del settings[instrument]["address"]
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:16]


def recordings(path: Path) -> list[Path]:
    """The files that exist of a recording that was asked to go to `path`: one for each bench, in order."""
    candidates = (_numbered(path, number) for number in range(1, MOST_BENCHES))
    return [candidate for candidate in candidates if candidate.exists()]


def recording_before(path: Path) -> Path | None:
    """The file that exists of which `path`, as its name says, would be the recording of a further bench."""
    name, _, _ = path.stem.rpartition("-")
    first = path.with_name(name + path.suffix) if name.strip(".") else path
    return first if path in (_numbered(first, number) for number in range(2, MOST_BENCHES)) and first.exists() else None


def _new_file(path: Path, heading: dict[str, object]) -> RecordingWriter:
    """The first bench of a command goes to `path`, the second to `name-2.ending`, and so on, whoever comes first."""
    for number in range(1, MOST_BENCHES):
        candidate = _numbered(path, number)
        if not candidate.exists():
            try:
                return RecordingWriter(candidate, heading)
            except RecordingError:
                if not candidate.exists():
                    raise
    raise RecordingError(f"{path}: {MOST_BENCHES} benches are recorded in this folder: name a file in another folder")


def _numbered(path: Path, number: int) -> Path:
    return path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")


class RecordingTranscript:
    """A transcript that passes every message on, and every byte to a recording."""

    def __init__(self, transcript: Transcript, writer: RecordingWriter, masks: "Masks | None") -> None:
        self._transcript = transcript
        self._writer = writer
        self._masks = masks
        self._connections = 0
        self._lock = threading.Lock()

    def __call__(self, instrument: str, direction: str, message: str, /) -> None:
        """Pass one message on."""
        self._transcript(instrument, direction, message)

    def tap(self, instrument: str, resource: str) -> SessionTap:
        """A new connection."""
        with self._lock:
            self._connections += 1
            number = self._connections
        shown = resource if self._masks is None else self._masks.resource(resource)
        self._writer.append(Kind.OPENED, number, [json.dumps({"instrument": instrument, "resource": shown}).encode()])
        return _RecordedSession(self._writer, number, self._masks)


class _RecordedSession:
    def __init__(self, writer: RecordingWriter, number: int, masks: "Masks | None") -> None:
        self._writer = writer
        self._number = number
        self._masks = masks
        self._identifies = False

    def heard(self, direction: str, chunks: Sequence[Chunk]) -> None:
        if direction == ">":
            self._identifies = b"*IDN?" in bytes(chunks[0]).upper()
            self._writer.append(Kind.SENT, self._number, chunks)
            return
        if self._masks is not None and self._identifies and len(chunks) == 1:
            chunks = [self._masks.identity(bytes(chunks[0]))]
        self._writer.append(Kind.RECEIVED, self._number, chunks)

    def closed(self) -> None:
        self._writer.append(Kind.CLOSED, self._number)


class Masks:
    """Replaces what would show whose bench it was: serial numbers in answers to `*IDN?`, and hosts in VISA addresses.

    Each is replaced by a word and the number of its first appearance in the recording, the same one every time.
    """

    def __init__(self) -> None:
        self._words: dict[str, dict[bytes, bytes]] = {}

    def identity(self, reply: bytes) -> bytes:
        """A reply to `*IDN?` with every serial number replaced."""
        return _IDENTITY.sub(lambda found: found[1] + self._mask("serial", found[2]) + found[3], reply)

    def resource(self, resource: str) -> str:
        """A VISA address with the host, or the serial number of a USB device, replaced."""
        parts = resource.split("::")
        place = 3 if parts[0].upper().startswith("USB") else 1
        if parts[0].upper().startswith(("USB", "TCPIP")) and len(parts) > place:
            word = "serial" if place == 3 else "host"
            parts[place] = self._mask(word, parts[place].encode()).decode()
        return "::".join(parts)

    def _mask(self, word: str, secret: bytes) -> bytes:
        known = self._words.setdefault(word, {})
        return known.setdefault(secret, f"{word}-{len(known) + 1}".encode())
