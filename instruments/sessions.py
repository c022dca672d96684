"""One open VISA session: text and blocks over whatever pyvisa offers for the address.

Blocks take the raw socket of a pyvisa-py SOCKET session where there is one: pyvisa-py ends a read at every line feed
while its termination character is on, which makes `query_binary_values` some fifty times slower than the wire.
"""

import contextlib
import select
import socket
import time
import zlib
from collections.abc import Callable, Iterator
from typing import NamedTuple, cast

import pyvisa
from pyvisa.constants import StatusCode
from pyvisa.errors import VisaIOError
from pyvisa.resources import MessageBasedResource
from pyvisa_py.protocols.rpc import RPCError
from pyvisa_py.protocols.vxi11 import Vxi11Error

from instruments.errors import EXCERPT, excerpt

FAILURES = (VisaIOError, OSError, ValueError, RuntimeError, AssertionError, EOFError, RPCError, Vxi11Error)
"""What a session raises when its link breaks, or when what comes is not what was asked for.

The last five are pyvisa-py's: of a HiSLIP session that the instrument has ended or whose frames are wrong, and of a
VXI-11 link likewise.
"""
ENCODING = "latin-1"
VISA_CHUNK = 1 << 20
"""Bytes asked for at once where there is no raw socket."""
TEXT_CHUNK = 1 << 16
"""Bytes of text asked for at once."""
LONGEST_TEXT = 1 << 26
"""Bytes of a reply: the time stamps of a million frames have 40 MB."""
CLOSED = "the instrument closed the connection"
PIECE = 1 << 18
"""Bytes that go over a socket at once: while one piece is summed up in the cache, the wire carries the next."""
LEAST_RATE = 100_000
"""Bytes per second, less than any network carries: a piece has the session's timeout and the time it takes at this."""
LONGEST_ANSWERS = 1 << 10
"""Bytes of answers before a block."""

Take = Callable[[memoryview, "Digest | None"], None]
"""Fills a buffer with the bytes that come next, by the shortest way there is, and adds them to a digest."""


class Digest:
    """Length and CRC-32 of a block: the checksum that keeps pace with the wire."""

    def __init__(self) -> None:
        """Of nothing yet."""
        self._length = 0
        self._crc32 = 0

    def add(self, piece: bytes | bytearray | memoryview) -> None:
        """Bytes that follow those before."""
        self._length += len(piece)
        self._crc32 = zlib.crc32(piece, self._crc32)

    def __str__(self) -> str:
        """The block in a transcript."""
        return f"#<{self._length} bytes, crc32 {self._crc32:08x}>"


class Block(NamedTuple):
    """A definite-length block as it came: `#N`, the length in digits, the data, the terminator; and its digest.

    Answers that come before the block in the same message are part of `head`. Source: IEEE 488.2, 8.7.9.
    """

    head: bytes
    length: bytes
    data: memoryview
    tail: bytes
    digest: str


class OtherLength(Exception):
    """A block is announced that has not the `length` that was asked for; nothing of it was taken."""

    def __init__(self, length: int) -> None:
        """Of so many bytes."""
        super().__init__(f"a block of {length} bytes is announced")
        self.length = length


class Locked(Exception):
    """Another client has the instrument's own lock."""


class Session:
    """A session that is open from the beginning until it is closed."""

    def __init__(self, resource: str, *, timeout_s: float, write_eol: str, read_eol: str, alone: bool) -> None:
        """Open it and clear the device, as other packages' drivers do; every wait is bounded by `timeout_s`.

        alone: take the instrument's own lock, where the transport has one (HiSLIP, VXI-11), so that nobody else gets
        a word in before this session ends, however it ends.

        Whatever an earlier session left there, a message begun or an answer that nobody took, is gone then; settings
        stay. A connection to a raw socket begins empty, and pyvisa-py would wait 100 ms for what might come.

        Raises:
            Locked: another client has it.
            Exception: it cannot be opened; pyvisa-py raises the bare class.
        """
        self._timeout_s = timeout_s
        self._write_eol, self._read_eol = write_eol, read_eol
        self._received = bytearray()  # behind the message that was read last
        opened = _resource_manager(resource).open_resource(
            resource,
            open_timeout=int(timeout_s * 1e3),
            write_termination=write_eol,
            read_termination=read_eol,
        )
        self._visa = cast(MessageBasedResource, opened)
        self._visa.timeout = timeout_s * 1e3
        self._visa.encoding = ENCODING
        self._socket = _raw_socket(self._visa)
        if self._socket is None:
            self._prepare(alone)
        else:
            # Without it a write followed by a query waits for the delayed acknowledgement of the write: 40 ms.
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def write(self, message: str) -> None:
        """Send one message and its terminator."""
        self._require_silence()
        with self._raw() as link:
            if link is None:
                self._visa.write(message)
            else:  # pyvisa-py would wait for ever where nobody reads
                link.sendall(f"{message}{self._write_eol}".encode(ENCODING))

    def ask(self, message: str, timeout_s: float | None = None) -> str:
        """`write` and `read`, within `timeout_s` in place of the session's own bound.

        Raises:
            OSError, VisaIOError, ValueError: as `read`.
        """
        self.write(message)
        return self.read(timeout_s)

    def read(self, timeout_s: float | None = None) -> str:
        """Receive one message without its terminator, all of it within one wait.

        A message that opens a quotation and does not close it goes on after the terminator. Over a raw socket, the end
        of the connection ends the wait at once; pyvisa-py would wait on. Other transports mark the end of a message by
        themselves, but one that lacks its terminator as well was cut short.

        Raises:
            OSError, VisaIOError: it does not end in time, or not at all.
            ValueError: it is longer than any instrument's, or was cut short.
        """
        deadline = time.monotonic() + (self._timeout_s if timeout_s is None else timeout_s)
        with self._raw() as link, self._bounded(None if link else timeout_s):
            message = self._line(link, deadline)
            while message.count(b'"') % 2:
                _left_s(deadline)  # lines that have come already are no waits
                _require_bounded(message)
                message += b"\n" + self._line(link, deadline)
        return message.decode(ENCODING)

    def send_block(self, head: bytes, payload: memoryview, tail: bytes, digest: Digest) -> None:
        """Send `payload` between `head` and `tail`, whatever bytes it has; `digest` grows by each piece that went."""
        self._require_silence()
        with self._raw() as link:
            if link is None:
                digest.add(payload)
                self._visa.write_raw(b"".join((head, payload, tail)))
            else:
                link.sendall(head)
                self._send(link, payload, digest)
                link.sendall(tail)

    def ask_block(self, message: str, room: memoryview, before: int = 0) -> Block:
        """`write`, then receive the definite-length block that answers into `room`, whose size it must have.

        `before`: how many answers without quotation marks come before it, each with a semicolon behind it.

        Raises:
            ValueError: the answer is no such block, or goes on behind it.
            OtherLength: it has another size; the session has to be closed, since its data are still to come.
        """
        self.write(message)
        digest = Digest()
        with self._receiving() as take:
            head = bytearray()
            while missing := _at_least_missing(head, before):
                piece = bytearray(missing)
                take(memoryview(piece), None)
                head += piece
            length = bytearray(length_digits(head[-2:]))
            take(memoryview(length), None)
            count = int(length)
            if count != len(room):
                raise OtherLength(count)
            take(room, digest)
            tail = bytearray(len(self._read_eol))
            take(memoryview(tail), None)
        if tail != self._read_eol.encode(ENCODING):
            raise ValueError(f"the block of {count} bytes goes on with {bytes(tail)!r}")
        return Block(bytes(head), bytes(length), room, bytes(tail), str(digest))

    def close(self) -> None:
        """Close it, as well as that can still be done."""
        with contextlib.suppress(*FAILURES):
            self._visa.close()

    def _prepare(self, alone: bool) -> None:
        try:
            if alone:
                self._lock()
            self._clear()
        except BaseException:
            self.close()
            raise

    def _lock(self) -> None:
        """The exclusive lock, or at once the news that another client has it.

        Source: VXI-11 1.0, B.6.11 (device_lock); IVI-6.1, 6.5 (AsyncLock), which pyvisa-py knows but does not offer.
        """
        hislip = getattr(_interface(self._visa), "async_lock_request", None)
        if hislip is not None:
            if hislip(0.0) == "failure":
                raise Locked
            return
        try:
            self._visa.lock_excl(0)
        except VisaIOError as error:
            if error.error_code == StatusCode.error_resource_locked:
                raise Locked from None
            if error.error_code != StatusCode.error_nonsupported_operation:
                raise

    def _clear(self) -> None:
        """Device clear (IEEE 488.2, 5.8), where the transport and the instrument know it."""
        try:
            self._visa.clear()
        except VisaIOError as error:
            if error.error_code != StatusCode.error_nonsupported_operation:
                raise

    def _require_silence(self) -> None:
        """Check that nothing has come that nobody asked for: it would be taken for the answer to what is asked next.

        The other transports mark which reply belongs to which message.

        Raises:
            ValueError: something has.
            OSError: the instrument has closed the connection.
        """
        if self._socket is None:
            return
        waiting = bytes(self._received)
        if not waiting and select.select([self._socket], [], [], 0)[0]:
            waiting = self._socket.recv(EXCERPT, socket.MSG_PEEK)
            if not waiting:
                raise ConnectionResetError(CLOSED)
        if waiting:
            raise ValueError(f"{excerpt(waiting)} came unasked")

    def _line(self, link: socket.socket | None, deadline: float) -> bytes:
        """The bytes before the next terminator."""
        end, searched = self._read_eol.encode(ENCODING), 0
        if link is None:
            message = self._visa_line(deadline)
            if not message.endswith(end):
                raise ValueError(f"{excerpt(message.decode(ENCODING))} lacks its end")
            return message.removesuffix(end)
        while (length := self._received.find(end, searched)) < 0:
            _require_bounded(self._received)
            searched = max(0, len(self._received) - len(end) + 1)
            link.settimeout(_left_s(deadline))
            piece = link.recv(TEXT_CHUNK)
            if not piece:
                raise ConnectionResetError(CLOSED)
            self._received += piece
        line = bytes(self._received[:length])
        del self._received[: length + len(end)]
        return line

    def _visa_line(self, deadline: float) -> bytes:
        """One message, piece by piece: pyvisa gives each of them a whole wait, and there may be no last one."""
        line = bytearray()
        with self._visa.ignore_warning(StatusCode.success_device_not_present, StatusCode.success_max_count_read):
            while True:
                piece, status = self._visa.visalib.read(self._visa.session, TEXT_CHUNK)
                line += piece
                if status != StatusCode.success_max_count_read:
                    return bytes(line)
                _require_bounded(line)
                _left_s(deadline)

    @contextlib.contextmanager
    def _receiving(self) -> Iterator[Take]:
        with self._raw() as link:
            if link is not None:
                yield lambda room, digest: self._receive(link, room, digest)
                return
        termination = self._visa.read_termination
        self._visa.read_termination = None

        def take(room: memoryview, digest: Digest | None) -> None:
            # Without `break_on_termchar`, pyvisa would ask for ever for what a message that has ended does not have.
            data = self._visa.read_bytes(len(room), chunk_size=VISA_CHUNK, break_on_termchar=True)
            if len(data) < len(room):
                raise ValueError(f"the message ends {len(room) - len(data)} bytes too early")
            room[:] = data
            if digest is not None:
                digest.add(room)

        try:
            yield take
        finally:
            self._visa.read_termination = termination

    def _send(self, link: socket.socket, data: memoryview, digest: Digest) -> None:
        """All of `data` into `link`, piece by piece.

        Raises:
            OSError: it cannot be sent, or a piece of it takes too long.
        """
        for start in range(0, len(data), PIECE):
            piece = data[start : start + PIECE]
            link.settimeout(self._patience_s(piece))
            link.sendall(piece)  # which the timeout bounds as a whole
            digest.add(piece)

    def _receive(self, link: socket.socket, room: memoryview, digest: Digest | None) -> None:
        """Fill `room` from `link`, however many packets that takes.

        Raises:
            OSError: the bytes do not come, or a piece of them takes too long.
        """
        while len(room):
            piece, room = room[:PIECE], room[PIECE:]
            deadline = time.monotonic() + self._patience_s(piece)
            while len(piece):
                link.settimeout(_left_s(deadline))
                length = link.recv_into(piece)
                if length == 0:
                    raise ConnectionResetError(f"{CLOSED} in the middle of a block")
                if digest is not None:
                    digest.add(piece[:length])
                piece = piece[length:]

    def _patience_s(self, piece: memoryview) -> float:
        return self._timeout_s + len(piece) / LEAST_RATE

    @contextlib.contextmanager
    def _bounded(self, timeout_s: float | None) -> Iterator[None]:
        """Another bound than the session's own on what VISA itself waits for; None is its own."""
        if timeout_s is None:
            yield
            return
        self._visa.timeout = timeout_s * 1e3
        try:
            yield
        finally:
            self._visa.timeout = self._timeout_s * 1e3

    @contextlib.contextmanager
    def _raw(self) -> Iterator[socket.socket | None]:
        """The raw socket, if there is one, with a bounded wait."""
        if self._socket is None:
            yield None
            return
        self._socket.settimeout(self._timeout_s)
        try:
            yield self._socket
        finally:
            self._socket.settimeout(None)


def came_late(error: BaseException) -> bool:
    """Whether a failure of a session is that nothing came in time."""
    return isinstance(error, TimeoutError) or getattr(error, "error_code", None) == StatusCode.error_timeout


def length_digits(head: bytes | bytearray) -> int:
    """How many digits follow `#N`; N may be a hexadecimal digit, because records can need ten digits.

    Raises:
        ValueError: `head` is not the head of a block.
    """
    if head[:1] != b"#" or head[1:] not in b"123456789ABCDEFabcdef":
        raise ValueError(f"the reply starts with {bytes(head)!r}, not with a block")
    return int(head[1:], 16)


def _at_least_missing(head: bytearray, before: int) -> int:
    """How many bytes must still come before the length of a block: of answers, each one byte or more, and of `#N`.

    Raises:
        ValueError: the answers are longer than any.
    """
    if len(head) > LONGEST_ANSWERS:
        raise ValueError(f"{excerpt(head)} goes on without a block")
    *answers, begun = head.split(b";")
    if (outstanding := before - len(answers)) == 0:
        return 2 - len(begun)
    return 2 * outstanding - bool(begun) + 2


def _left_s(deadline: float) -> float:
    """Seconds until then.

    Raises:
        TimeoutError: there are none.
    """
    if (left_s := deadline - time.monotonic()) <= 0:
        raise TimeoutError
    return left_s


def _require_bounded(text: bytes | bytearray) -> None:
    if len(text) > LONGEST_TEXT:
        raise ValueError(f"more than {LONGEST_TEXT} bytes came, which begin with {excerpt(text)}")


def _resource_manager(resource: str) -> pyvisa.ResourceManager:
    """pyvisa-py for the network, where it is fastest; this machine's own VISA library, if any, for USB and GPIB.

    pyvisa keeps one manager per library, so asking again costs nothing.
    """
    return pyvisa.ResourceManager("@py" if resource.upper().startswith("TCPIP") else "")


def _raw_socket(session: MessageBasedResource) -> socket.socket | None:
    """The TCP socket under a pyvisa-py SOCKET session, or None for any other session."""
    if session.resource_class != "SOCKET":
        return None
    found = _interface(session)
    return found if isinstance(found, socket.socket) else None


def _interface(session: MessageBasedResource) -> object:
    """What is under a session of pyvisa-py; None under that of another library."""
    return getattr(getattr(session.visalib, "sessions", {}).get(session.session), "interface", None)
