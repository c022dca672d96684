"""journal.jsonl: one line per closed shard, each with its own checksum. The state of a run is derived from it.

A line is a JSON object such as

    {"shard": 3, "pass": 1, "passes": 2, "first": 20, "shots": 20, "count": 20, "sha256": "9f...", "crc": "0a1b2c3d"}

`count` shots from `first` on were measured in `pass`; `shots` of them are thereby complete on all passes (0 before the
last pass). `crc` is always the last key: the CRC-32 (as in zip), 8 hex digits, of the line without it, that is of
`{"shard": ..., "sha256": "9f..."}`. A line with `discarded` takes back the shots of a shard that was found damaged: its
`shots` is negative or 0, so that the sum over all lines remains the number of complete shots. A line with `suspect`
says why the shots of the shard may be wrong: they complete nothing. Of several lines of a shard the last one counts.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import BytesIO, FileIO
from pathlib import Path
from types import TracebackType
from typing import Self

from instruments.remedies import unreadable
from labctl.errors import RunError, RunInUse
from labctl.runs.format.checked_line import TornLine, decode, encode
from labctl.runs.format.durable import not_written, replace_file, write_all
from labctl.runs.format.file_lock import lock
from labctl.runs.format.own_files import opened, read_own

LARGEST_JOURNAL = 1 << 28
"""Bytes: more than a million lines."""
MOST_PROBLEMS = 1000
NOT_COMPARED = "not compared with the settings afterwards"
"""Why shots are suspect that were stored before anybody was sure of them."""


@dataclass(frozen=True)
class Entry:
    """One line: see the module's description. `discarded` and `suspect` are reasons, empty where there is none."""

    shard: int
    pass_index: int
    passes: int
    first: int
    shots: int
    count: int
    sha256: str
    discarded: str = ""
    suspect: str = ""

    def encode(self) -> bytes:
        """The line, with its checksum and newline."""
        values: dict[str, int | str] = {
            "shard": self.shard,
            "pass": self.pass_index,
            "passes": self.passes,
            "first": self.first,
            "shots": self.shots,
            "count": self.count,
            "sha256": self.sha256,
        }
        if self.discarded:
            values["discarded"] = self.discarded
        if self.suspect:
            values["suspect"] = self.suspect
        return encode(values)

    @classmethod
    def decode(cls, line: bytes) -> "Entry":
        """The inverse of `encode`; keys of later minor versions are ignored.

        Raises:
            ValueError: not a journal line, or its checksum is wrong.
        """
        values = decode(line)
        try:
            return cls(
                shard=int(values["shard"]),
                pass_index=int(values["pass"]),
                passes=int(values["passes"]),
                first=int(values["first"]),
                shots=int(values["shots"]),
                count=int(values["count"]),
                sha256=str(values["sha256"]),
                discarded=str(values.get("discarded", "")),
                suspect=str(values.get("suspect", "")),
            )
        except (KeyError, TypeError, OverflowError) as error:
            raise ValueError(f"lacks {error}") from error


@dataclass(frozen=True)
class Journal:
    """What a journal holds.

    Attributes:
        entries: the good lines, in order.
        problems: one line of text for every bad line that no crash explains.
        damaged: the first and last byte of the first such line, or None.
        whole_bytes: length of the file without a torn last line.
    """

    entries: tuple[Entry, ...]
    problems: tuple[str, ...]
    damaged: tuple[int, int] | None
    whole_bytes: int


def read_journal(path: Path) -> Journal:
    """Read a journal; it may be growing at the same time.

    Raises:
        RunError: the file cannot be read, or nearly nothing in it is a line of a journal.
    """
    try:
        data = read_own(path, LARGEST_JOURNAL)
    except OSError as error:
        raise RunError(unreadable(path, error, "the run needs its journal: restore it from a copy")) from error
    entries: list[Entry] = []
    problems: list[str] = []
    damaged: tuple[int, int] | None = None
    whole = 0
    for number, line in enumerate(BytesIO(data), start=1):
        try:
            entries.append(Entry.decode(line))
        except TornLine as error:
            if whole + len(line) == len(data):
                break
            problems.append(f"{path.name} line {number}: {error}")
        except ValueError as error:
            problems.append(f"{path.name} line {number}: {error}")
        if problems and damaged is None:
            damaged = whole, whole + len(line) - 1
        if len(problems) > MOST_PROBLEMS:
            raise RunError(f"{path}: {MOST_PROBLEMS} of its lines are damaged: restore it from a copy of the run")
        whole += len(line)
    return Journal(tuple(entries), tuple(problems), damaged, whole)


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Nobody else writes the run of the journal at `path` inside the block; the journal itself stays as it is.

    Raises:
        RunInUse: another process is writing this run.
        RunError: the file cannot be opened.
    """
    try:
        file = FileIO(path, "r+", opener=opened)
    except OSError as error:
        raise not_written(path, error) from error
    with file:
        _lock(file, path)
        yield


class JournalFile:
    """The journal of a run that is being written. Only one process can hold it open."""

    def __init__(self, path: Path) -> None:
        """Open for appending, after cutting off a line that a crash has torn.

        Raises:
            RunInUse: another process is writing this run.
            RunError: the file cannot be opened.
        """
        self._path = path
        try:
            self._file = FileIO(path, "a+", opener=opened)
        except OSError as error:
            raise not_written(path, error) from error
        try:
            _lock(self._file, path)
            self._mend()
        except RunError:
            self._file.close()
            raise

    def append(self, entry: Entry) -> None:
        """Append one line and fsync it.

        Raises:
            RunError: the disk is full or refuses. The journal is then as it was before, as far as the disk lets it be.
        """
        length, line = self._file.seek(0, os.SEEK_END), entry.encode()
        try:
            write_all(self._file, line)
            self._size += len(line)  # before the wait for the disk, which a signal may end: the line is there
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):  # the line is torn then, and cut off when the run goes on
                self._file.truncate(length)
            raise not_written(self._path, error) from error

    @property
    def untouched(self) -> bool:
        """Whether its file is still there, with what this has written and nothing else."""
        ours = os.fstat(self._file.fileno())
        try:
            there = os.stat(self._path, follow_symlinks=False)
        except OSError:
            return False
        return os.path.samestat(ours, there) and there.st_size == self._size

    def write_anew(self, entries: Iterable[Entry]) -> None:
        """Put a file with `entries` where it was, in place of what somebody left there.

        Raises:
            RunError: the disk is full or refuses.
        """
        replace_file(self._path, b"".join(entry.encode() for entry in entries))

    def close(self) -> None:
        """Let go of the file and of the lock."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _mend(self) -> None:
        whole = read_journal(self._path).whole_bytes
        try:
            if self._file.seek(0, os.SEEK_END) > whole:
                self._file.truncate(whole)
            if whole:
                self._file.seek(whole - 1)
                if self._file.read(1) != b"\n":
                    write_all(self._file, b"\n")
            os.fsync(self._file.fileno())
            self._size = self._file.seek(0, os.SEEK_END)
        except OSError as error:
            raise not_written(self._path, error) from error


def _lock(file: FileIO, path: Path) -> None:
    """Lock the opened journal at `path`.

    Raises:
        RunInUse: another process has it.
    """
    try:
        lock(file)
    except BlockingIOError:
        raise RunInUse(f"{path.parent}: another process is writing this run; wait for it or stop it") from None
    except OSError:
        return  # some network file systems have no locks: then nothing guards against a second writer
