"""The VISA link: one session to one instrument, with text, binary blocks, error queue, bounded waits and a transcript.

Blocks take the raw socket of a pyvisa-py SOCKET session where there is one: pyvisa-py ends a read at every line feed
while its termination character is on, which makes `query_binary_values` some fifty times slower than the wire.
"""

import contextlib
import socket
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

import numpy as np
import pyvisa
from numpy.typing import NDArray
from pyvisa.constants import StatusCode
from pyvisa.errors import VisaIOError
from pyvisa.resources import MessageBasedResource

from instruments.blocks import Digest, length_digits, receive, send
from instruments.interfaces import InstrumentError, LinkError
from instruments.transcripts import ByteTranscript, SessionTap, Transcript

ErrorQueue = Callable[["VisaLink"], list[str]]
"""Empties an instrument's error queue and returns what was in it, oldest first."""

Scalar = TypeVar("Scalar", bound=np.generic)

Received = Callable[[memoryview], object]
Take = Callable[[int, Received], bytearray]
"""Receives so many bytes, whatever they are, by the shortest way there is, and tells each piece as it comes."""

ENCODING = "latin-1"
MAX_ERRORS_READ = 64
VISA_CHUNK = 1 << 20
"""Bytes asked for at once where there is no raw socket."""


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
    if int(link.query("*ESR?")) & 0b0011_1100 == 0:
        return []
    return [link.query("ALLEv?")]


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
        self._session: MessageBasedResource | None = None
        self._socket: socket.socket | None = None

    def write(self, command: str) -> None:
        """Send one program message.

        Raises:
            LinkError: the instrument cannot be reached.
        """
        with self._conversation(command) as session:
            self._log(">", command)
            session.write(command)

    def query(self, command: str, *, timeout_s: float | None = None) -> str:
        """Send one query and return its reply without terminator; `timeout_s` bounds this wait instead of the link's.

        A reply that opens a quotation and does not close it goes on after the line feed (error texts of the AWG do).

        Raises:
            LinkError: no reply in time, or the instrument cannot be reached.
        """
        with self._conversation(command) as session, self._waiting(session, timeout_s):
            self._log(">", command)
            reply: str = session.query(command)
            while reply.count('"') % 2:
                reply += "\n" + session.read()
            self._log("<", reply)
            return reply

    def number(self, command: str, *, timeout_s: float | None = None) -> float:
        """`query`, with a number for a reply.

        Raises:
            LinkError: as `query`.
            InstrumentError: the reply is no number.
        """
        reply = self.query(command, timeout_s=timeout_s)
        try:
            return float(reply)
        except ValueError:
            raise InstrumentError(
                f"{self.name} at {self.resource}: {command!r} was answered {reply!r}, not with a number: check that "
                f"the driver fits the instrument"
            ) from None

    def write_block(self, header: str, block: NDArray[Any]) -> None:
        """Send `header` followed by `block` as an IEEE 488.2 definite-length block.

        Raises:
            LinkError: the instrument cannot be reached.
        """
        with self._conversation(header) as session:
            self._send_block(session, header, block)

    def query_block(self, header: str, block: NDArray[Any]) -> str:
        """`write_block`, then read the one-line reply."""
        with self._conversation(header) as session:
            self._send_block(session, header, block)
            reply: str = session.read()
            self._log("<", reply)
            return reply

    def read_block(self, command: str, dtype: "np.dtype[Scalar]") -> NDArray[Scalar]:
        """Send a query whose reply is one definite-length block and return it as an array of `dtype`, shape (n,).

        Raises:
            LinkError: no reply in time.
            InstrumentError: the reply is not a block, or not a whole number of items.
        """
        with self._conversation(command) as session:
            self._log(">", command)
            session.write(command)
            data = self._receive_block(session)
            if len(data) % dtype.itemsize:
                raise InstrumentError(f"{self.name}: reply to {command} has {len(data)} bytes, not items of {dtype}")
            return np.frombuffer(data, dtype)

    @contextlib.contextmanager
    def checked(self) -> Iterator[None]:
        """A group of settings: the instrument's error queue is read once, at the end of the block.

        Raises:
            InstrumentError: the queue was not empty; the message carries the instrument's own text.
        """
        yield
        errors = self.errors()
        if errors:
            raise InstrumentError(f"{self.name} at {self.resource} reports {'; '.join(errors)}")

    def errors(self) -> list[str]:
        """Empty the instrument's error queue and return what it held."""
        return self._error_queue(self)

    def close(self) -> None:
        """Close the session if it is open; the next message would open it again."""
        session, self._session, self._socket = self._session, None, None
        tap, self._tap = self._tap, None
        if tap is not None:
            tap.closed()
        if session is not None:
            with contextlib.suppress(VisaIOError, OSError):
                session.close()

    @contextlib.contextmanager
    def _conversation(self, command: str) -> Iterator[MessageBasedResource]:
        """The open session; whatever breaks inside closes it and becomes one `LinkError`."""
        try:
            yield self._session or self._open()
        except (VisaIOError, OSError, ValueError) as error:
            self.close()
            late = isinstance(error, TimeoutError) or getattr(error, "error_code", None) == StatusCode.error_timeout
            what = "did not answer in time" if late else f"cannot be reached ({_one_line(error)})"
            raise (NoAnswer if late else LinkError)(
                f"{self.name} at {self.resource} {what} (at {command.split(',')[0]!r}): check address, cable and power"
            ) from error
        except BaseException:
            # Ctrl-C between a question and its answer: a session kept open would be one reply behind for ever.
            self.close()
            raise

    @contextlib.contextmanager
    def _waiting(self, session: MessageBasedResource, timeout_s: float | None) -> Iterator[None]:
        if timeout_s is None:
            yield
            return
        session.timeout = timeout_s * 1e3
        try:
            yield
        finally:
            session.timeout = self.timeout_s * 1e3

    def _open(self) -> MessageBasedResource:
        try:
            opened = _resource_manager(self.resource).open_resource(
                self.resource,
                open_timeout=int(self.timeout_s * 1e3),
                write_termination=self._write_eol,
                read_termination=self._read_eol,
            )
        except Exception as error:  # pyvisa-py raises the bare class when a connection cannot be made
            raise LinkError(
                f"{self.name} at {self.resource} cannot be reached ({_one_line(error)}): check address, cable and power"
            ) from error
        session = cast(MessageBasedResource, opened)
        session.timeout = self.timeout_s * 1e3
        session.encoding = ENCODING
        self._session, self._socket = session, _raw_socket(session)
        if self._socket is not None:
            # Without it a write followed by a query waits for the delayed acknowledgement of the write: 40 ms.
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self._recorder is not None:
            self._tap = self._recorder.tap(self.name, self.resource)
        return session

    def _log(self, direction: str, message: str) -> None:
        self._transcript(self.name, direction, message)
        if self._tap is not None:
            eol = self._write_eol if direction == ">" else self._read_eol
            self._tap.heard(direction, (f"{message}{eol}".encode(ENCODING),))

    def _send_block(self, session: MessageBasedResource, header: str, block: NDArray[Any]) -> None:
        payload = np.ascontiguousarray(block).view(np.uint8).reshape(-1).data
        length = str(len(payload))
        head, tail = f"{header}#{len(length)}{length}".encode(ENCODING), self._write_eol.encode(ENCODING)
        if self._tap is not None:
            self._tap.heard(">", (head, payload, tail))
        digest = Digest()
        try:
            with self._raw() as link:
                if link is None:
                    digest.add(payload)
                    session.write_raw(b"".join((head, payload, tail)))
                else:
                    link.sendall(head)
                    send(link, payload, digest.add)
                    link.sendall(tail)
        finally:
            self._transcript(self.name, ">", f"{header}{digest}")

    def _receive_block(self, session: MessageBasedResource) -> bytearray:
        digest = Digest()
        with self._receiving(session) as take:
            head = bytes(take(2, len))
            length = bytes(take(length_digits(head), len))
            data = take(int(length), digest.add)
            tail = take(len(self._read_eol), len)
        self._transcript(self.name, "<", str(digest))
        if self._tap is not None:
            self._tap.heard("<", (head, length, data, tail))
        return data

    @contextlib.contextmanager
    def _receiving(self, session: MessageBasedResource) -> Iterator[Take]:
        with self._raw() as link:
            if link is not None:
                yield lambda count, received: receive(link, count, received)
                return
        termination = session.read_termination
        session.read_termination = None

        def take(count: int, received: Received) -> bytearray:
            data = bytearray(session.read_bytes(count, chunk_size=VISA_CHUNK))
            received(memoryview(data))
            return data

        try:
            yield take
        finally:
            session.read_termination = termination

    @contextlib.contextmanager
    def _raw(self) -> Iterator[socket.socket | None]:
        """The raw socket, if there is one, with a bounded wait."""
        if self._socket is None:
            yield None
            return
        self._socket.settimeout(self.timeout_s)
        try:
            yield self._socket
        finally:
            self._socket.settimeout(None)


def _resource_manager(resource: str) -> pyvisa.ResourceManager:
    """pyvisa-py for the network, where it is fastest; this machine's own VISA library, if any, for USB and GPIB.

    pyvisa keeps one manager per library, so asking again costs nothing.
    """
    return pyvisa.ResourceManager("@py" if resource.upper().startswith("TCPIP") else "")


def _raw_socket(session: MessageBasedResource) -> socket.socket | None:
    """The TCP socket under a pyvisa-py SOCKET session, or None for any other session."""
    if session.resource_class != "SOCKET":
        return None
    interface = getattr(session.visalib, "sessions", {}).get(session.session)
    found = getattr(interface, "interface", None)
    return found if isinstance(found, socket.socket) else None


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
