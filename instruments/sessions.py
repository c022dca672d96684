"""One open VISA session: text and blocks over whatever pyvisa offers for the address.

Blocks take the raw socket of a pyvisa-py SOCKET session where there is one: pyvisa-py ends a read at every line feed
while its termination character is on, which makes `query_binary_values` some fifty times slower than the wire.
"""

import contextlib
import socket
from collections.abc import Callable, Iterator
from typing import NamedTuple, cast

import pyvisa
from pyvisa.constants import StatusCode
from pyvisa.errors import VisaIOError
from pyvisa.resources import MessageBasedResource

from instruments.blocks import length_digits, receive, send

FAILURES = (VisaIOError, OSError, ValueError)
"""What a session raises when its link breaks, or when what comes is not what was asked for."""
ENCODING = "latin-1"
VISA_CHUNK = 1 << 20
"""Bytes asked for at once where there is no raw socket."""

Received = Callable[[memoryview], object]
Take = Callable[[int, Received], bytearray]
"""Receives so many bytes, whatever they are, by the shortest way there is, and tells each piece as it comes."""


class Block(NamedTuple):
    """A definite-length block as it came: `#N`, the length in digits, the data, the terminator."""

    head: bytes
    length: bytes
    data: bytearray
    tail: bytearray


class Session:
    """A session that is open from the beginning until it is closed."""

    def __init__(self, resource: str, *, timeout_s: float, write_eol: str, read_eol: str) -> None:
        """Open it; every wait is bounded by `timeout_s`.

        Raises:
            Exception: it cannot be opened; pyvisa-py raises the bare class.
        """
        self._timeout_s = timeout_s
        self._read_eol = read_eol
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
        if self._socket is not None:
            # Without it a write followed by a query waits for the delayed acknowledgement of the write: 40 ms.
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def write(self, message: str) -> None:
        """Send one message and its terminator."""
        self._visa.write(message)

    def read(self) -> str:
        """Receive one message without its terminator."""
        message: str = self._visa.read()
        return message

    @contextlib.contextmanager
    def waiting(self, timeout_s: float | None) -> Iterator[None]:
        """Another bound than the session's own inside the block; None is its own."""
        if timeout_s is None:
            yield
            return
        self._visa.timeout = timeout_s * 1e3
        try:
            yield
        finally:
            self._visa.timeout = self._timeout_s * 1e3

    def send_block(self, head: bytes, payload: memoryview, tail: bytes, sent: Received) -> None:
        """Send `payload` between `head` and `tail`, whatever bytes it has; `sent` is called with each piece of it."""
        with self._raw() as link:
            if link is None:
                sent(payload)
                self._visa.write_raw(b"".join((head, payload, tail)))
            else:
                link.sendall(head)
                send(link, payload, sent)
                link.sendall(tail)

    def receive_block(self, received: Received) -> Block:
        """Receive a message that is one definite-length block; `received` is called with each piece of its data."""
        with self._receiving() as take:
            head = bytes(take(2, len))
            length = bytes(take(length_digits(head), len))
            return Block(head, length, take(int(length), received), take(len(self._read_eol), len))

    def close(self) -> None:
        """Close it, as well as that can still be done."""
        with contextlib.suppress(VisaIOError, OSError):
            self._visa.close()

    @contextlib.contextmanager
    def _receiving(self) -> Iterator[Take]:
        with self._raw() as link:
            if link is not None:
                yield lambda count, received: receive(link, count, received)
                return
        termination = self._visa.read_termination
        self._visa.read_termination = None

        def take(count: int, received: Received) -> bytearray:
            data = bytearray(self._visa.read_bytes(count, chunk_size=VISA_CHUNK))
            received(memoryview(data))
            return data

        try:
            yield take
        finally:
            self._visa.read_termination = termination

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
