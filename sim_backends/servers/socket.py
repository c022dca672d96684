"""TCP connections that never wait, and raw sockets: messages and replies end at a newline, unless framed otherwise.

The address of a raw socket is `TCPIP0::host::port::SOCKET`.
"""

import selectors
import socket
from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple

from sim_backends.scpi.messages import Chunk, Message, MessageReader
from sim_backends.servers.disturbed import Disturbed, pieces
from sim_backends.servers.loop import MOST_WAITING, Client, Instrument, Loop, Reader

# Linux only. Without it a client that writes a setting and then a query waits 40 ms: its Nagle algorithm holds the
# query back until the setting is acknowledged, and acknowledgements are delayed unless asked for. It does not stick.
_QUICK_ACKNOWLEDGE: int | None = getattr(socket, "TCP_QUICKACK", None)
_GATHERS = hasattr(socket.socket, "sendmsg")  # not on Windows
_CHUNKS_AT_ONCE = 64  # every system takes that many


class Channel:
    """A TCP connection in a selector, with the bytes still to be sent.

    Args:
        selector: What reports that the connection can be read or written; its keys' `data` is called with the events.
        connection: An accepted connection; belongs to the channel from now on.
        readable: Called when there is something to `receive`, the end of the stream included.
        lost: Called once when sending turns out to be impossible.

    Attributes:
        unsent: What was to be sent and is still here.
    """

    def __init__(
        self,
        selector: selectors.BaseSelector,
        connection: socket.socket,
        *,
        readable: Callable[[], None],
        lost: Callable[[], None],
    ) -> None:
        connection.settimeout(0)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.unsent: deque[memoryview] = deque()
        self._selector = selector
        self._connection = connection
        self._readable = readable
        self._lost = lost
        self._reads = True
        self._broken = False
        self._watched = 0
        self._watch()

    def receive(self, room: memoryview) -> int | None:
        """Receive into `room`; returns how many bytes came: 0 at the end of the stream, None if none are there yet."""
        if self._broken:
            return 0
        if _QUICK_ACKNOWLEDGE is not None:
            self._connection.setsockopt(socket.IPPROTO_TCP, _QUICK_ACKNOWLEDGE, 1)
        try:
            return self._connection.recv_into(room)
        except BlockingIOError:
            return None
        except OSError:  # reset, timed out, unreachable: whatever was still coming will not come
            return 0

    def send(self, chunks: Iterable[Chunk]) -> None:
        """Send `chunks` one behind the other: at once as far as possible, the rest when there is room."""
        self.unsent.extend(memoryview(chunk).cast("B") for chunk in chunks if len(chunk))
        self._flush()

    def read(self, *, wanted: bool) -> None:
        """Report incoming bytes, or leave them with the sender until further notice."""
        self._reads = wanted and not self._broken
        self._watch()

    def close(self) -> None:
        """Close the connection; what was not sent is dropped, and so is what is sent from now on."""
        self._broken, self._reads = True, False
        self.unsent.clear()
        self._watch()
        self._connection.close()

    def _ready(self, events: int) -> None:
        if events & selectors.EVENT_WRITE:
            self._flush()
        if events & selectors.EVENT_READ and self._reads:
            self._readable()

    def _flush(self) -> None:
        try:
            while self.unsent and not self._broken:
                self._drop_sent(self._transmit())
        except BlockingIOError:
            pass
        except OSError:
            self._broken = True
            self._lost()
        if self._broken:
            self.unsent.clear()
        self._watch()

    def _transmit(self) -> int:
        if _GATHERS:
            return self._connection.sendmsg([self.unsent[i] for i in range(min(len(self.unsent), _CHUNKS_AT_ONCE))])
        return self._connection.send(self.unsent[0])

    def _drop_sent(self, count: int) -> None:
        while count:
            chunk = self.unsent.popleft()
            if count < len(chunk):
                self.unsent.appendleft(chunk[count:])
                return
            count -= len(chunk)

    def _watch(self) -> None:
        wanted = (selectors.EVENT_READ if self._reads else 0) | (selectors.EVENT_WRITE if self.unsent else 0)
        if wanted == self._watched:
            return
        if not wanted:
            self._selector.unregister(self._connection)
        elif self._watched:
            self._selector.modify(self._connection, wanted, self._ready)
        else:
            self._selector.register(self._connection, wanted, self._ready)
        self._watched = wanted


class Framing(NamedTuple):
    """How messages follow one another on a raw socket: what cuts them out, and what ends each reply."""

    reader: Callable[[], Reader]
    ending: bytes


LINES = Framing(MessageReader, b"\n")


class CarriageReturns(MessageReader):
    """Messages that end at a carriage return, as those of some lasers do; they hold no blocks."""

    def received(self, count: int) -> list[Message]:
        """As of messages that end at a newline."""
        room = self.buffer()
        room[:count] = bytes(room[:count]).replace(b"\r", LINES.ending)
        return super().received(count)


def serve_socket(
    loop: Loop, instrument: Instrument, host: str = "127.0.0.1", port: int = 0, framing: Framing = LINES
) -> int:
    """Serve `instrument` on a raw socket of `loop`; returns the port (0: any free one).

    Raises:
        OSError: The port is taken or the address is not one of this machine.
    """
    return loop.listen(host, port, lambda connection: loop.join(SocketClient(loop, instrument, connection, framing)))


class SocketClient(Client):
    """A client on a raw socket."""

    def __init__(self, loop: Loop, instrument: Instrument, connection: socket.socket, framing: Framing = LINES) -> None:
        super().__init__(loop, instrument, framing.reader())
        self._ending = framing.ending
        self._channel = Channel(loop.selector, connection, readable=self._readable, lost=self._end)
        self._ended = False
        self._late = b""

    @property
    def sending(self) -> bool:
        """Whether a reply is still on its way."""
        return bool(self._channel.unsent)

    def reply(self, chunks: list[Chunk], tag: int) -> None:
        """Send `chunks` and what ends a reply."""
        self._channel.send((*chunks, self._ending))

    def disturb(self, disturbed: Disturbed, tag: int) -> None:
        """Send what a fault has made of a reply; faults end it with a newline."""
        data = disturbed.data
        if self._ending != LINES.ending:
            data = data.removesuffix(LINES.ending) + self._ending
        if disturbed.late:
            self._late += data
            return
        late, self._late = self._late, b""
        for piece in (late, *pieces(data[: disturbed.ends_after], disturbed.packet)):
            self._channel.send((piece,))
        if disturbed.hangs_up:
            self.hang_up()

    def hang_up(self) -> None:
        """End the connection at once."""
        self._channel.close()
        self._end()

    def pace(self) -> None:
        """Read on, unless too many messages are waiting."""
        self._channel.read(wanted=not self._ended and len(self.waiting) < MOST_WAITING)

    def close(self) -> None:
        """Close the connection."""
        self._channel.close()

    def _readable(self) -> None:
        size = self._channel.receive(self.reader.buffer())
        if size:
            self.receive(size)
        elif size == 0:
            self._end()

    def _end(self) -> None:
        if not self._ended:
            self._ended = True
            self._channel.read(wanted=False)
            self.loop.leave(self)
