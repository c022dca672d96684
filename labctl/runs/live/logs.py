"""The two logs of a run, lines of text that are only ever appended to.

commands.log has what went to and from the instruments, `seconds direction instrument message`, the seconds counted from
the opening of the bench; what is said at every shot is there once, and then referred to (`Rounds`). events.jsonl has
what the run is doing, for whoever watches it, one JSON object a line:

    {"time": "2026-11-21T09:15:00.125Z", "event": "progress", "done": 40, "total": 2200, "rate_per_s": 612.4, ...}

`time` is UTC and `event` one of the names in docs/reference/run-format.md; the rest belongs to the event. Lines are
handed to the operating system and not synced: what the run has measured is in its journal, not here.
"""

import io
import json
import logging
import os
import re
import threading
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import IO, Any, NamedTuple, Self

from instruments.bench import Observer
from instruments.safe_state import UnsafeBench
from labctl.runs.format.durable import not_written
from labctl.runs.format.own_files import opened
from labctl.runs.live.events import EVENTS

COMMANDS = "commands.log"
"""Name of the file in a run directory."""
LONGEST_REPLY, BEGINNING = 2048, 64
"""Characters; a longer reply, such as the time stamps of a burst, is its beginning and a digest."""
DIGEST = 9
"""Characters at the end of a message with a block: `#<50 bytes, crc32 e51a3452>`."""
MOST_OTHER = 4
"""Messages of a round that may be other ones than in the round before that it is like."""
MOST_IN_A_LINE, LONGEST_S = 50, 1.0
"""Rounds, and from the first to the last of them, s."""
MOST_KNOWN, MOST_PENDING = 64, 10_000
"""Rounds that others are compared with, and messages of one: then the one is begun anew, and the other written."""
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
PROGRESS_EVERY_S = 0.5
LARGE = 64_000_000
"""Bytes of events.jsonl from which on progress is written seldom: a week's run does not fill the disk with it."""
SELDOM_S = 10.0
INTERRUPTIONS = ("paused", "link lost", "link recovered")

_logger = logging.getLogger(__name__)


class _Lines:
    """A file that is only ever appended to; lines that come before there is one wait in memory.

    A disk that is full ends it and nothing else: the messages that switch the light off must still go out.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._file: IO[bytes] = io.BytesIO()
        self._ended = False
        self._guard = threading.RLock()  # a warning of the disk may come from the thread that stores a burst

    @property
    def size(self) -> int:
        """Bytes up to its end."""
        return self._file.tell()

    def keep_in(self, path: Path) -> None:
        """Go on at the end of `path`; a last line that a killed process left without its end gets one.

        Raises:
            OSError: it cannot be opened.
        """
        file = io.FileIO(path, "ab+", opener=opened)
        torn = file.seek(0, os.SEEK_END) and file.seek(-1, os.SEEK_END) >= 0 and file.read(1) != b"\n"
        so_far = self._file.getvalue() if isinstance(self._file, io.BytesIO) else b""
        self._file.close()
        self._file = file
        self.append((b"\n" if torn else b"") + so_far)

    def append(self, lines: bytes) -> None:
        """Whole lines."""
        if not self._ended:
            with self._guard, self._ending_if_full():
                while lines:
                    lines = lines[self._file.write(lines) :]

    def end(self, error: OSError) -> None:
        """Nothing more is written, because of `error`."""
        if not self._ended:
            _logger.warning("%s cannot be written (%s): it ends here", self._name, error.strerror or error)
        self._ended = True

    def close(self) -> None:
        with self._ending_if_full():  # what it still holds may not fit the disk
            self._file.close()

    @contextmanager
    def _ending_if_full(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.end(error)


class Message(NamedTuple):
    """One message: when, s; its line without that; apart from the line, the digest that a block at its end has."""

    at_s: float
    text: str
    digest: str

    @property
    def line(self) -> str:
        """As it is in the log."""
        return f"{self.at_s:.6f} {self.text}{self.digest and self.digest + '>'}\n"


def message_of(at_s: float, instrument: str, direction: str, text: str) -> Message:
    """A message as it is logged: line ends inside it are escaped, so that it is one line."""
    if len(text) > LONGEST_REPLY and direction == "<":
        text = f"{text[:BEGINNING]}#<{len(text)} bytes, crc32 {zlib.crc32(text.encode()):08x}>"
    line = f"{direction} {instrument} {text}"
    if "\n" in line or "\r" in line:
        line = line.replace("\r", "\\r").replace("\n", "\\n")
    has_block = line.endswith(">") and "#<" in line
    return Message(at_s, line[:-DIGEST], line[-DIGEST:-1]) if has_block else Message(at_s, line, "")


class Rounds:
    """Makes lines of messages, and of rounds of messages that are like an earlier one.

    A round is what is said from one acquisition to the next. Where one is in the log that it is like, its messages are
    not written again, but for the few that are other ones, and for a setting whose last line in the log has another
    value: what an instrument was set to last is always the last line of that setting. Then a line says

        17.204311 = run 49 times since 15.021764 the 14 messages of 3.151234: 9b32eafb e51a3452; 03c1d2e4 77a90f13; ...

    in which the blocks of each round are named by their digests, in the order in which they stand behind 3.151234; in
    front of one is whatever else was answered otherwise in the same message. A question that was repeated counts once,
    with its last answer.
    """

    def __init__(self, write: Callable[[bytes], object]) -> None:
        """Give whole lines to `write`."""
        self._write = write
        self._pending: list[Message] = []
        self._known: dict[tuple[str, ...], list[Sequence[Message]]] = {}  # rounds of one form
        self._like: Sequence[Message] = ()  # of the line that is being made
        self._since_s = self._until_s = 0.0
        self._blocks: list[str] = []  # of each round of it
        self._set: dict[str, str] = {}  # the last line of each setting

    def add(self, message: Message) -> None:
        """One more message of a round."""
        self._pending.append(message)
        if len(self._pending) > MOST_PENDING:
            self.write_out()

    def acquired(self) -> None:
        """A round is over."""
        messages, self._pending = self._pending, []
        if not (round_ := _asked_once(messages)):
            return
        like: Sequence[Message] = self._like
        other: Sequence[Message] = ()
        if [one.text for one in round_] != [one.text for one in like]:
            form = tuple(_form(one.text) for one in round_)
            like, other = _nearest(round_, self._known.get(form, ()))
            if not like or len(other) > MOST_OTHER:
                self._write_lines(messages)
                if sum(map(len, self._known.values())) >= MOST_KNOWN:
                    self._known.clear()
                self._known.setdefault(form, []).append(round_)
                return
        other = [one for one in round_ if one in other or self._is_set_otherwise(one)]
        if other or like is not self._like:
            self._write_lines(other)
            self._like, self._since_s = like, round_[0].at_s
        self._blocks.append(" ".join(_block(one, then) for one, then in zip(round_, like, strict=True) if one.digest))
        self._until_s = round_[-1].at_s
        if len(self._blocks) >= MOST_IN_A_LINE or self._until_s - self._since_s > LONGEST_S:
            self._write_lines(())

    def write_out(self) -> None:
        """Whatever came since the last line."""
        messages, self._pending = self._pending, []
        self._write_lines(messages)

    def _is_set_otherwise(self, message: Message) -> bool:
        """Whether it is a setting, and the last line of that setting in the log has another value."""
        what = _what_is_set(message.text)
        return what is not None and self._set.get(what) != message.text

    def _write_lines(self, messages: Sequence[Message]) -> None:
        """The line that was being made, if any, and some messages behind it."""
        self._set |= {what: one.text for one in messages if (what := _what_is_set(one.text)) is not None}
        line = ""
        if self._blocks:
            line = (
                f"{self._until_s:.6f} = run {len(self._blocks)} times since {self._since_s:.6f} the {len(self._like)} "
                f"messages of {self._like[0].at_s:.6f}: {'; '.join(self._blocks)}\n"
            )
        self._like, self._blocks = (), []
        if text := line + "".join(one.line for one in messages):
            self._write(text.encode())


def _asked_once(messages: Sequence[Message]) -> Sequence[Message]:
    """Without questions, and their answers, that were asked again at once and answered in the same form."""
    if not any(
        one.text == later.text and one.text[0] == ">" for one, later in zip(messages, messages[2:], strict=False)
    ):
        return messages
    found: list[Message] = []
    for message in messages:
        found.append(message)
        question, answer = found[-4:-2], found[-2:]
        if (
            len(question) == 2
            and question[0].text == answer[0].text
            and answer[0].text[0] == ">" != answer[1].text[0]
            and not answer[0].digest
            and not answer[1].digest
            and _form(question[1].text) == _form(answer[1].text)
        ):
            del found[-4:-2]
    return found


@lru_cache(maxsize=512)
def _what_is_set(text: str) -> str | None:
    """The instrument and the name of a setting; None of a message that is none, that asks, or that has a block."""
    direction, instrument, said = text.split(" ", 2)
    name, _, value = said.partition(" ")
    return f"{instrument} {name}" if direction == ">" and value and "?" not in said and "#<" not in said else None


@lru_cache(maxsize=512)
def _form(text: str) -> str:
    """A message without its numbers; the length of a block is none of them."""
    said, mark, length = text.partition("#<")
    return NUMBER.sub("", said) + mark + length


def _nearest(
    round_: Sequence[Message], known: Sequence[Sequence[Message]]
) -> tuple[Sequence[Message], Sequence[Message]]:
    """The round, among those of the same form, that differs in the fewest messages, and which of `round_` do.

    A reply with a block may differ in what is answered before.
    """
    others = [
        [
            one
            for one, then in zip(round_, like, strict=True)
            if one.text != then.text and not (one.digest and one.text[0] == "<")
        ]
        for like in known
    ]
    return min(zip(known, others, strict=True), key=lambda pair: len(pair[1]), default=((), ()))


def _block(message: Message, then: Message) -> str:
    """The digest of its block behind whatever else it says that the other one does not."""
    if message.text == then.text:
        return message.digest
    parts = zip(message.text.split(";"), then.text.split(";"), strict=True)
    return ";".join([part for part, before in parts if part != before] + [message.digest])


class CommandLog(Observer):
    """A transcript that a `VisaLink` can write to; a context manager that closes its file.

    As an observer of a run it hears when a round of messages is over, and has a line for whatever goes wrong. `started`
    is when its seconds began, by its clock, which is one for all processes and tells messages apart: `time.monotonic`
    has steps of 15.6 ms on Windows before Python 3.13. `path` is its file, once there is one.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter, *, started: float | None = None) -> None:
        """Begin to count the seconds now, or go on with those of another log."""
        self.started = clock() if started is None else started
        self.path: Path | None = None
        self._clock = clock
        self._lines = _Lines(COMMANDS)
        self._rounds = Rounds(self._lines.append)
        self._guard = threading.RLock()  # a warning of the disk may come from the thread that stores a burst

    def __call__(self, instrument: str, direction: str, message: str) -> None:
        """Log one message."""
        with self._guard:
            self._rounds.add(message_of(self._clock() - self.started, instrument, direction, message))

    def acquired(self) -> None:
        """A round is over."""
        with self._guard:
            self._rounds.acquired()

    def event(self, name: str, **fields: Any) -> None:
        """A line for an event that has a text."""
        if "text" in fields:
            self.warning(str(fields["text"]))

    def warning(self, text: str) -> None:
        """A line, at once."""
        with self._guard:
            self("run", "!", text)
            self._rounds.write_out()

    def stored_in(self, directory: Path) -> None:
        """Go on in the file of the run.

        Raises:
            RunError: it cannot be opened.
        """
        path = directory / COMMANDS
        try:
            self.keep_in(path)
        except OSError as error:
            raise not_written(path, error) from error

    def keep_in(self, path: Path) -> None:
        """Write what has been logged so far, and everything from now on, to the end of `path`.

        Raises:
            OSError: it cannot be opened.
        """
        with self._guard:
            self._rounds.write_out()
            self._lines.keep_in(path)
            self.path = path

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._guard:
            self._rounds.write_out()
        self._lines.close()


def _now() -> datetime:
    return datetime.now(UTC)


class EventLog(Observer):
    """Writes the events of a run; a context manager that closes its file."""

    def __init__(self, clock: Callable[[], float] = time.monotonic, now: Callable[[], datetime] = _now) -> None:
        """`clock` paces what is reported again and again, in s; `now` stamps every line."""
        self._clock = clock
        self._now = now
        self._lines = _Lines(EVENTS)
        self._due = {"progress": 0.0, "uploading": 0.0, "powers read": 0.0}
        self._measured: tuple[float, int] | None = None
        self._rate: float | None = None

    def event(self, name: str, **fields: Any) -> None:
        """Write one event now."""
        if name in INTERRUPTIONS:  # the next rate is not to be taken over a time in which nothing was to be measured
            self._measured = None
        stamp = self._now().isoformat(timespec="milliseconds").replace("+00:00", "Z")
        self._lines.append(json.dumps({"time": stamp, "event": name} | fields, default=str).encode() + b"\n")

    def emission(self, *, on: bool) -> None:
        """An event."""
        self.event("emission", on=on)

    def safe_state(self, error: UnsafeBench | None) -> None:
        """An event."""
        failed = {} if error is None else {"disobeyed": sorted(error.disobeyed), "text": str(error)}
        self.event("safe state", reached=error is None, **failed)

    def warning(self, text: str) -> None:
        """An event."""
        self.event("warning", text=text)

    def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
        """An event with rate and remaining time, unless there was one just now."""
        at = self._clock()
        if not self._is_due("progress", at) and done < total:
            return
        if self._measured is not None and at > self._measured[0]:
            self._rate = (done - self._measured[1]) / (at - self._measured[0])
        self._measured = at, done
        remaining = {"rate_per_s": self._rate, "remaining_s": (total - done) / self._rate} if self._rate else {}
        self.event("progress", done=done, total=total, **remaining, **last())

    def uploading(self, what: str, done: int, total: int) -> None:
        """An event, unless there was one just now; at the end always."""
        at = self._clock()
        if self._is_due("uploading", at) or done >= total:
            self.event("uploading", what=what, done=done, total=total)

    def powers(self, found: Mapping[str, float]) -> None:
        """An event, unless there was one just now."""
        if self._is_due("powers read", self._clock()):
            self.event("powers read", **found)

    def stored_in(self, directory: Path) -> None:
        """Go on in the file of the run."""
        self.keep_in(directory / EVENTS)

    def keep_in(self, path: Path) -> None:
        """Write what has happened so far, and everything from now on, to the end of `path`."""
        try:
            self._lines.keep_in(path)
        except OSError as error:
            self._lines.end(error)

    def _is_due(self, event: str, at: float) -> bool:
        due = at >= self._due[event]
        if due:
            self._due[event] = at + (SELDOM_S if self._lines.size >= LARGE else PROGRESS_EVERY_S)
        return due

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Say how the run ended, if an error ends it, and close the file."""
        if isinstance(error, Exception):
            self.event("failed", error=" ".join(str(error).split()), notes=list(getattr(error, "__notes__", ())))
        elif error is not None:
            self.event("stopped", at_once=True, notes=list(getattr(error, "__notes__", ())))
        self._lines.close()
