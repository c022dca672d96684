"""The VISA link: one instrument, with text, binary blocks, its error queue, bounded waits and a transcript."""

import contextlib
import errno
import math
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray
from pyvisa.rname import InvalidResourceName, ResourceName

from instruments.errors import InstrumentError, InstrumentInUse, LinkError, excerpt
from instruments.safe_state import MAY_EMIT
from instruments.sessions import ENCODING, FAILURES, Digest, Locked, OtherLength, Session, came_late
from instruments.transcripts import ByteTranscript, SessionTap, Transcript

ErrorQueue = Callable[["VisaLink"], list[str]]
"""Empties an instrument's error queue and returns what was in it, oldest first."""

Answer = TypeVar("Answer")
Block = TypeVar("Block", bound=NDArray[Any])

EXAMPLE = "TCPIP0::192.0.2.10::inst0::INSTR"
"""Of an address, for messages."""
MAX_ERRORS_READ = 64
MOST_TOLD = 5
"""Different errors that a message quotes."""
LONGEST_ERROR = 300
"""Characters of an error that are kept: Tektronix quotes the whole command in it."""
TEXT = re.compile(r'(?!\Z)[\t\r\n !#-~]*(?:"[^"]*"[\t\r\n !#-~]*)*')
"""What a reply consists of: printable ASCII, and anything between quotation marks; it is never empty."""
CACHE_LINE = 64
"""Bytes."""
NUMBER = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*")
"""A number of a reply (IEEE 488.2, 8.7.2 to 8.7.4)."""
NOT_A_NUMBER = 9.9e37
"""Infinity where a number is expected, and 9.91E37 what is no number (SCPI-99, 7.2.1.4 and 7.2.1.5)."""


def number_in(text: str) -> float | None:
    """The number that a reply is; None for what is none, or no measured one.

    Example:
        >>> from instruments.visa import number_in
        >>> number_in("+2.5E-3"), number_in("1_0"), number_in("9.91E37"), number_in("ON")
        (0.0025, None, None, None)
    """
    number = float(text) if NUMBER.fullmatch(text) else math.inf
    return number if abs(number) < NOT_A_NUMBER else None


def scpi_error_queue(link: "VisaLink") -> list[str]:
    """Empty the queue of a SCPI instrument by `SYSTem:ERRor?` (SCPI-99, 21.8)."""
    errors = []
    for _ in range(MAX_ERRORS_READ):
        error = link.query("SYSTem:ERRor?")
        if error.split(",", 1)[0].strip().lstrip("+") == "0":
            break
        errors.append(error)
    return errors


def tektronix_event_queue(link: "VisaLink") -> list[str]:
    """Empty the event queue of a Tektronix oscilloscope: `*ESR?` releases the events, `ALLEv?` reads them."""
    if int(link.number("*ESR?")) & 0b0011_1100 == 0:
        return []
    return [link.query("ALLEv?")]


def room_for_blocks(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """An array of `shape`, unset, each row of which takes a block: it begins with a line of the processor's cache.

    What begins elsewhere, as arrays of numpy do, the system fills at about half the rate.
    """
    size = math.prod(shape[1:]) * np.dtype(dtype).itemsize
    step = -(-size // CACHE_LINE) * CACHE_LINE
    memory = np.empty(shape[0] * step + CACHE_LINE, np.uint8)
    begin = -memory.ctypes.data % CACHE_LINE
    rows = memory[begin : begin + shape[0] * step].reshape(shape[0], step)[:, :size]
    return rows.view(dtype).reshape(shape)


class NoAnswer(LinkError):
    """The instrument can be reached but did not answer in time."""


class VisaLink:
    """One VISA session that logs every message, bounds every wait and checks the instrument's own errors.

    The session opens at the first message and reopens after a lost link or a timeout: a late reply must never be taken
    for the answer to the next question.
    """

    def __init__(
        self,
        resource: str,
        *,
        name: str,
        timeout_s: float,
        transcript: Transcript,
        error_queue: ErrorQueue = scpi_error_queue,
        write_eol: str = "\n",
        read_eol: str = "\n",
    ) -> None:
        """Describe the session; nothing is opened yet. `name` is the instrument's word in messages and transcript."""
        self.resource = resource
        self.name = name
        self.timeout_s = timeout_s
        self._transcript = transcript
        self._recorder = transcript if isinstance(transcript, ByteTranscript) else None
        self._tap: SessionTap | None = None
        self._error_queue = error_queue
        self._write_eol = write_eol
        self._read_eol = read_eol
        self._session: Session | None = None
        self._heard = False

    def write(self, command: str) -> None:
        """Send one program message.

        Raises:
            LinkError: the instrument cannot be reached.
        """

        def exchange(session: Session) -> None:
            self._log(">", command)
            session.write(command)

        self._converse(command, exchange)

    def query(self, command: str, *, timeout_s: float | None = None) -> str:
        """Send one query and return its reply without terminator; `timeout_s` bounds this wait instead of the link's.

        A reply that opens a quotation and does not close it goes on after the line feed (error texts of the AWG do).

        Raises:
            LinkError: no reply in time, or the instrument cannot be reached.
        """

        def exchange(session: Session) -> str:
            self._log(">", command)
            reply = session.ask(command, timeout_s)
            self._log("<", reply)
            return reply

        return self._converse(command, exchange)

    def number(self, command: str, *, timeout_s: float | None = None) -> float:
        """`query`, with a number for a reply.

        Raises:
            LinkError: as `query`.
            InstrumentError: the reply is no number.
        """
        (number,) = self.numbers(command, 1, timeout_s=timeout_s)
        return number

    def numbers(self, command: str, count: int, *, timeout_s: float | None = None) -> tuple[float, ...]:
        """`query`, with `count` numbers for a reply: a chain of queries is answered with semicolons between.

        Raises:
            LinkError: as `query`.
            InstrumentError: the reply has another number of parts, or one of them is no number.
        """
        reply = self.query(command, timeout_s=timeout_s)
        found = tuple(number for part in reply.split(";") if (number := number_in(part)) is not None)
        if len(found) == count == reply.count(";") + 1:
            return found
        raise InstrumentError(
            f"{self.name} at {self.resource}: {command!r} was answered {excerpt(reply)}, not with "
            f"{'a number' if count == 1 else f'{count} numbers'}: check that the driver fits the instrument"
        )

    def write_block(self, header: str, block: NDArray[Any]) -> None:
        """Send `header` followed by `block` as an IEEE 488.2 definite-length block.

        Raises:
            LinkError: the instrument cannot be reached.
        """
        self._converse(header, lambda session: self._send_block(session, header, block))

    def query_block(self, header: str, block: NDArray[Any]) -> str:
        """`write_block`, then read the one-line reply."""

        def exchange(session: Session) -> str:
            self._send_block(session, header, block)
            reply = session.read()
            self._log("<", reply)
            return reply

        return self._converse(header, exchange)

    def read_block(self, command: str, block: Block) -> Block:
        """Send a query whose reply is one definite-length block; returns `block`, contiguous, with what came in it.

        Raises:
            LinkError, InstrumentError: as `read_described_block`.
        """
        self.read_described_block((command,), block)
        return block

    def read_described_block(self, questions: Sequence[str], block: NDArray[Any]) -> tuple[str, ...]:
        """Ask several questions in one message, the last of which is answered with a definite-length block.

        It comes into the contiguous `block`; returns the answers before it, numbers or words.

        Raises:
            LinkError: no reply in time, or none that is such a block.
            InstrumentError: it has another length.
        """
        room = block.reshape(-1).view(np.uint8).data
        command, before = ";:".join(questions), len([one for one in questions[:-1] if one.endswith("?")])

        def exchange(session: Session) -> tuple[str, ...]:
            self._log(">", command)
            found = session.ask_block(command, room, before)
            answers = found.head[:-2].decode(ENCODING)
            self._transcript(self.name, "<", answers + found.digest)
            if self._tap is not None:
                self._tap.heard("<", found[:4])
            return tuple(answers.split(";")[:before])

        try:
            return self._converse(command, exchange)
        except OtherLength as found:
            raise InstrumentError(
                f"{self.name} at {self.resource}: {questions[-1]} gave {found.length} bytes, not {len(room)}: its "
                f"settings were changed meanwhile; leave it to this program"
            ) from None

    @contextlib.contextmanager
    def checked(self) -> Iterator[None]:
        """A group of settings: the instrument's error queue is read once, at the end of the block.

        Raises:
            InstrumentError: the queue was not empty; the message carries the instrument's own text.
        """
        yield
        errors = self.errors()
        if errors:
            different = tuple(dict.fromkeys(errors))  # a full queue says the same over and over
            more = f" and {len(different) - MOST_TOLD} more" if len(different) > MOST_TOLD else ""
            queue = "; ".join(different[:MOST_TOLD]) + more
            raise InstrumentError(f"{self.name} at {self.resource} reports {queue}")

    def errors(self) -> list[str]:
        """Empty the instrument's error queue and return what it held, each error in one line."""
        return [" ".join(error.split())[:LONGEST_ERROR] for error in self._error_queue(self)]

    def close(self) -> None:
        """Close the session if it is open; the next message would open it again."""
        session, self._session = self._session, None
        self._heard = False
        tap, self._tap = self._tap, None
        if tap is not None:
            tap.closed()
        if session is not None:
            session.close()

    def _converse(self, command: str, exchange: Callable[[Session], Answer]) -> Answer:
        """What an exchange over the open session gives; whatever breaks in it closes it and becomes one `LinkError`."""
        try:
            answer = exchange(self._session or self._open())
            if isinstance(answer, str) and TEXT.fullmatch(answer) is None:  # no instrument says it: the link is broken
                raise ValueError(f"{excerpt(answer)} is no text")
            self._heard = self._heard or answer is not None
            return answer
        except FAILURES as error:
            unheard = not self._heard
            self.close()
            late = came_late(error)
            missed = "understood" if isinstance(error, ValueError) else "reached"
            what = "did not answer in time" if late else f"cannot be {missed} ({_one_line(error)})"
            failure = (NoAnswer if late else LinkError)(
                f"{self.name} at {self.resource} {what} (at {command.split(',')[0]!r}): check address, cable and power"
            )
            failure.silent = late and unheard
            failure.resource = self.resource
            raise failure from error
        except BaseException:
            # Ctrl-C between a question and its answer, or a block that nobody wants: a session kept open would be one
            # reply behind for ever.
            self.close()
            raise

    def _open(self) -> Session:
        """A new session; alone but with what emits: nobody may be kept from switching that off.

        Raises:
            InstrumentInUse: another program has the instrument's own lock.
            LinkError: it cannot be reached.
        """
        try:
            session = Session(
                self.resource,
                timeout_s=self.timeout_s,
                write_eol=self._write_eol,
                read_eol=self._read_eol,
                alone=self.name not in MAY_EMIT,
            )
        except Locked:
            raise InstrumentInUse(
                f"{self.name} at {self.resource} is in use: another program, maybe of another computer, has its lock: "
                f"wait for it, or end it"
            ) from None
        except Exception as error:  # pyvisa-py raises the bare class when a connection cannot be made
            raise LinkError(
                f"{self.name} at {self.resource} cannot be reached ({self._why(error)}): check address, cable and power"
            ) from error
        self._session = session
        if self._recorder is not None:
            self._tap = self._recorder.tap(self.name, self.resource)
        return session

    def _why(self, error: Exception) -> str:
        """Why there is no session: what pyvisa and pyvisa-py raise for two kinds of wrong address speaks of others."""
        try:
            ResourceName.from_string(self.resource)
        except InvalidResourceName:
            return f"that is no VISA address; one is written like {EXAMPLE}"
        if isinstance(error, OSError) and error.errno == errno.EBADF:
            return "nothing on the network has that name or address"
        return _one_line(error)

    def _log(self, direction: str, message: str) -> None:
        if self._tap is not None:
            eol = self._write_eol if direction == ">" else self._read_eol
            self._tap.heard(direction, (f"{message}{eol}".encode(ENCODING),))
        self._transcript(self.name, direction, message)

    def _send_block(self, session: Session, header: str, block: NDArray[Any]) -> None:
        payload = np.ascontiguousarray(block).view(np.uint8).reshape(-1).data
        length = str(len(payload))
        head, tail = f"{header}#{len(length)}{length}".encode(ENCODING), self._write_eol.encode(ENCODING)
        if self._tap is not None:
            self._tap.heard(">", (head, payload, tail))
        digest = Digest()
        try:
            session.send_block(head, payload, tail, digest)
        finally:
            self._transcript(self.name, ">", f"{header}{digest}")


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
