"""One open VISA session: text and blocks over whatever pyvisa offers for the address.

Blocks take the raw socket of a pyvisa-py SOCKET session where there is one: pyvisa-py ends a read at every line feed
while its termination character is on, which makes `query_binary_values` some fifty times slower than the wire.
"""

import contextlib
import math
import select
import socket
import sys
import time
from collections.abc import Iterator
from typing import Any, NamedTuple, cast

import pyvisa
from isal import isal_zlib
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
"""Bytes that are taken from a socket at once: while one piece is summed up in the cache, the wire carries the next."""
NEARLY = 0.9
"""Of a wait, still that wait: it is a call of the system to set another one."""
LEAST_RATE = 100_000
"""Bytes per second, less than any network carries: what is long has the session's timeout and the time at this."""
LONGEST_ANSWERS = 1 << 10
"""Bytes of answers before a block."""


class Digest:
    """Length and CRC-32 of a block: the checksum that keeps pace with the wire, as ISA-L computes it."""

    def __init__(self) -> None:
        """Of nothing yet."""
        self._length = 0
        self._crc32 = 0

    def add(self, piece: bytes | bytearray | memoryview) -> None:
        """Bytes that follow those before."""
        self._length += len(piece)
        self._crc32 = isal_zlib.crc32(piece, self._crc32)

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


class Head(NamedTuple):
    """What of a message comes before a block's data: how many bytes, at least, and how many of them are its length."""

    size: int
    digits: int


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
        opened = _resource_manager(resource).open_resource(
            resource,
            open_timeout=int(timeout_s * 1e3),
            write_termination=write_eol,
            read_termination=read_eol,
        )
        self._visa = cast(MessageBasedResource, opened)
        self._visa.timeout = timeout_s * 1e3
        self._visa.encoding = ENCODING
        link = _raw_socket(self._visa)
        self._stream = None if link is None else _Stream(link, timeout_s)
        self._reads = _bounded(self._visa)
        if self._stream is None:
            self._prepare(alone)

    def write(self, message: str) -> None:
        """Send one message and its terminator."""
        if self._stream is None:
            self._wait_until(time.monotonic() + self._timeout_s)
            self._visa.write(message)
        else:  # pyvisa-py would wait for ever where nobody reads
            self._stream.require_silence()
            self._stream.send(f"{message}{self._write_eol}".encode(ENCODING))

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
        if self._stream is not None or timeout_s is None:
            return self._message(deadline)
        self._visa.timeout = timeout_s * 1e3
        try:
            return self._message(deadline)
        finally:
            self._visa.timeout = self._timeout_s * 1e3

    def send_block(self, head: bytes, payload: memoryview, tail: bytes, digest: Digest) -> None:
        """Send `payload` between `head` and `tail`, whatever bytes it has; `digest` grows by each piece that went."""
        if self._stream is None:
            digest.add(payload)
            self._wait_until(time.monotonic() + self._timeout_s + len(payload) / LEAST_RATE)
            self._visa.write_raw(b"".join((head, payload, tail)))
        else:
            self._stream.require_silence()
            self._stream.send_block(head, payload, tail, digest)

    def ask_block(self, message: str, room: memoryview, before: int = 0) -> Block:
        """`write`, then receive the definite-length block that answers into `room`, whose size it must have.

        `before`: how many answers without quotation marks come before it, each with a semicolon behind it.

        Raises:
            ValueError: the answer is no such block, or goes on behind it.
            OtherLength: it has another size; the session has to be closed, since its data are still to come.
        """
        self.write(message)
        digest, end = Digest(), self._read_eol.encode(ENCODING)
        with self._without_terminator():
            deadline = time.monotonic() + self._timeout_s
            came = bytearray(self._some(2 * before + 2, deadline))
            while len(came) < (head := _head(came, before)).size:
                came += self._some(head.size - len(came), deadline)
            length = bytes(came[head.size - head.digits : head.size])
            if int(length) != len(room):
                raise OtherLength(int(length))
            with_it = min(len(came) - head.size, len(room))
            room[:with_it] = came[head.size : head.size + with_it]
            digest.add(room[:with_it])
            self._fill(room[with_it:], digest)
            tail = came[head.size + with_it :]
            deadline = time.monotonic() + self._timeout_s
            while len(tail) < len(end):
                tail += self._some(len(end) - len(tail), deadline)
        if tail != end:
            raise ValueError(f"the block of {len(room)} bytes goes on with {excerpt(bytes(tail))}")
        return Block(bytes(came[: head.size - head.digits]), length, room, bytes(tail), str(digest))

    def close(self) -> None:
        """Close it, as well as that can still be done."""
        if self._stream is None:
            self._wait_until(time.monotonic() + self._timeout_s)
        with contextlib.suppress(*FAILURES):
            self._visa.close()

    def _wait_until(self, deadline: float) -> None:
        """How long what pyvisa-py reads next may take, whatever comes meanwhile."""
        for link in self._reads:
            link.deadline = deadline

    def _prepare(self, alone: bool) -> None:
        self._wait_until(time.monotonic() + self._timeout_s)
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

    def _message(self, deadline: float) -> str:
        self._wait_until(deadline)
        message = self._line(deadline)
        while message.count(b'"') % 2:
            _left_s(deadline)  # lines that have come already are no waits
            _require_bounded(message)
            message += b"\n" + self._line(deadline)
        return message.decode(ENCODING)

    def _line(self, deadline: float) -> bytes:
        """The bytes before the next terminator."""
        end = self._read_eol.encode(ENCODING)
        if self._stream is not None:
            return self._stream.line(end, deadline)
        message = self._visa_line(deadline)
        if not message.endswith(end):
            raise ValueError(f"{excerpt(message.decode(ENCODING))} lacks its end")
        return message.removesuffix(end)

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

    def _some(self, least: int, deadline: float) -> bytes:
        """What comes next of a message: `least` bytes or, over a raw socket, any number of them."""
        if self._stream is not None:
            return self._stream.some(deadline)
        self._wait_until(deadline)
        # Without `break_on_termchar`, pyvisa would ask for ever for what a message that has ended does not have.
        data = self._visa.read_bytes(least, chunk_size=VISA_CHUNK, break_on_termchar=True)
        if len(data) < least:
            raise ValueError(f"the message ends {least - len(data)} bytes too early")
        return data

    def _fill(self, room: memoryview, digest: Digest) -> None:
        """What comes next into `room`, by the shortest way there is, and into `digest`."""
        if self._stream is not None:
            self._stream.fill(room, digest)
        elif len(room):
            room[:] = self._some(len(room), time.monotonic() + self._timeout_s + len(room) / LEAST_RATE)
            digest.add(room)

    @contextlib.contextmanager
    def _without_terminator(self) -> Iterator[None]:
        """Let VISA take line feeds for what they are in a block."""
        if self._stream is not None:
            yield
            return
        termination = self._visa.read_termination
        self._visa.read_termination = None
        try:
            yield
        finally:
            self._visa.read_termination = termination


class _Stream:
    """The TCP connection under a session: what goes over it, and every wait for that bounded.

    The kernel is told of a wait only where it differs from the one before; so one that was begun with nearly all of its
    time left may take all of it.
    """

    def __init__(self, link: socket.socket, timeout_s: float) -> None:
        # Without it a write followed by a query waits for the delayed acknowledgement of the write: 40 ms.
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        link.settimeout(timeout_s)
        self._link = link
        self._timeout_s = self._waits_s = timeout_s
        self._behind = bytearray()  # what came behind the message that was read last

    def require_silence(self) -> None:
        """Check that nothing has come that nobody asked for: it would be taken for the answer to what is asked next.

        The other transports mark which reply belongs to which message.

        Raises:
            ValueError: something has.
            OSError: the instrument has closed the connection.
        """
        waiting = bytes(self._behind)
        if not waiting and select.select((self._link,), (), (), 0)[0]:
            waiting = self._link.recv(EXCERPT, socket.MSG_PEEK)
            if not waiting:
                raise ConnectionResetError(CLOSED)
        if waiting:
            raise ValueError(f"{excerpt(waiting)} came unasked")

    def send(self, message: bytes) -> None:
        """All of a text."""
        self._wait(self._timeout_s)
        self._link.sendall(message)  # which the wait bounds as a whole

    def send_block(self, head: bytes, payload: memoryview, tail: bytes, digest: Digest) -> None:
        """`payload` between `head` and `tail`; `digest` grows by what went.

        They go as one, without a copy, so that an instrument is woken once for a block that is short.
        """
        left, sent = [memoryview(head), payload, memoryview(tail)], -len(head)  # of the payload
        deadline = time.monotonic() + self._timeout_s + len(payload) / LEAST_RATE
        while left:
            self._wait(min(_left_s(deadline), self._timeout_s + PIECE / LEAST_RATE))
            # Windows cannot send from several places at once.
            count = self._link.send(left[0]) if sys.platform == "win32" else self._link.sendmsg(left)
            digest.add(payload[max(sent, 0) : max(sent + count, 0)])
            sent += count
            while left and count >= len(left[0]):
                count -= len(left.pop(0))
            if left:
                left[0] = left[0][count:]

    def line(self, end: bytes, deadline: float) -> bytes:
        """The bytes before the next `end`."""
        text, searched = self._behind, 0
        while (length := text.find(end, searched)) < 0:
            _require_bounded(text)
            searched = max(0, len(text) - len(end) + 1)
            text += self.some(deadline)
        line = bytes(text[:length])
        del text[: length + len(end)]
        return line

    def some(self, deadline: float) -> bytes:
        """What comes next, one byte or more."""
        self._wait(_left_s(deadline))
        piece = self._link.recv(TEXT_CHUNK)
        if not piece:
            raise ConnectionResetError(CLOSED)
        return piece

    def fill(self, room: memoryview, digest: Digest) -> None:
        """Fill `room`, however many packets that takes."""
        while len(room):
            piece, room = room[:PIECE], room[PIECE:]
            deadline = time.monotonic() + self._timeout_s + len(piece) / LEAST_RATE
            while len(piece):
                self._wait(_left_s(deadline))
                length = self._link.recv_into(piece)
                if length == 0:
                    raise ConnectionResetError(f"{CLOSED} in the middle of a block")
                digest.add(piece[:length])
                piece = piece[length:]

    def _wait(self, seconds: float) -> None:
        if not NEARLY * self._waits_s <= seconds <= self._waits_s:
            self._link.settimeout(seconds)
            self._waits_s = seconds


class _Bounded:
    """A connection under a session of pyvisa-py, which reads on after its end and as long as something comes."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self.deadline = math.inf

    def recv(self, size: int) -> bytes:
        """What comes next.

        Raises:
            TimeoutError: the deadline is over.
            ConnectionResetError: nothing will come any more.
        """
        _left_s(self.deadline)
        piece = self._link.recv(size)
        if not piece:
            raise ConnectionResetError(CLOSED)
        return piece

    def recv_into(self, room: memoryview, size: int) -> int:
        """What comes next, into `room`; raises as `recv`."""
        _left_s(self.deadline)
        length = self._link.recv_into(room, size)
        if not length:
            raise ConnectionResetError(CLOSED)
        return length

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)


def _bounded(session: MessageBasedResource) -> list[_Bounded]:
    """The connections of a HiSLIP session of pyvisa-py, or of a VXI-11 link, each of which it now has as such a one."""
    found, owner = [], _interface(session)
    for name in ("_sync", "_async", "sock"):
        if isinstance(link := getattr(owner, name, None), socket.socket):
            found.append(_Bounded(link))
            setattr(owner, name, found[-1])
    return found


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


def _head(came: bytearray, before: int) -> Head:
    """Of a message that has so many answers before its block, as far as it came.

    Raises:
        ValueError: the answers are longer than any, or none is a block.
    """
    *answers, begun = came.split(b";", before)
    if missing := before - len(answers):  # each of a byte or more, and a semicolon
        if len(came) > LONGEST_ANSWERS:
            raise ValueError(f"{excerpt(bytes(came))} goes on without a block")
        return Head(len(came) + 2 * missing - bool(begun) + 2, 0)
    begin = len(came) - len(begun)
    digits = length_digits(begun[:2]) if len(begun) >= 2 else 0
    return Head(begin + 2 + digits, digits)


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
