"""One TCP connection that never waits."""

import selectors
import socket
from collections import deque
from collections.abc import Callable, Iterable

Chunk = bytes | memoryview

# Linux only. Without it a client that writes a setting and then a query waits 40 ms: its Nagle algorithm holds the
# query back until the setting is acknowledged, and acknowledgements are delayed unless asked for. It does not stick.
_QUICK_ACKNOWLEDGE: int | None = getattr(socket, "TCP_QUICKACK", None)
_GATHERS = hasattr(socket.socket, "sendmsg")  # not on Windows
_CHUNKS_AT_ONCE = 64  # every system takes that many


class Channel:
    """A connection in a selector, with the bytes still to be sent.

    Args:
        selector: What reports that the connection can be read or written; its keys' `data` is called with the events.
        connection: An accepted connection; belongs to the channel from now on.
        readable: Called when there is something to `receive`, the end of the stream included.
        lost: Called once when sending turns out to be impossible.
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
        self._selector = selector
        self._connection = connection
        self._readable = readable
        self._lost = lost
        self._output: deque[memoryview] = deque()
        self._reads = True
        self._broken = False
        self._watched = 0
        self._watch()

    @property
    def sending(self) -> bool:
        """Whether a part of what was to be sent is still here."""
        return bool(self._output)

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
        self._output.extend(memoryview(chunk).cast("B") for chunk in chunks if len(chunk))
        self._flush()

    def read(self, *, wanted: bool) -> None:
        """Report incoming bytes, or leave them with the sender until further notice."""
        self._reads = wanted and not self._broken
        self._watch()

    def close(self) -> None:
        """Close the connection; what was not sent is dropped, and so is what is sent from now on."""
        self._broken, self._reads = True, False
        self._output.clear()
        self._watch()
        self._connection.close()

    def _ready(self, events: int) -> None:
        if events & selectors.EVENT_WRITE:
            self._flush()
        if events & selectors.EVENT_READ and self._reads:
            self._readable()

    def _flush(self) -> None:
        try:
            while self._output and not self._broken:
                self._drop_sent(self._transmit())
        except BlockingIOError:
            pass
        except OSError:
            self._broken = True
            self._lost()
        if self._broken:
            self._output.clear()
        self._watch()

    def _transmit(self) -> int:
        if _GATHERS:
            return self._connection.sendmsg([self._output[i] for i in range(min(len(self._output), _CHUNKS_AT_ONCE))])
        return self._connection.send(self._output[0])

    def _drop_sent(self, count: int) -> None:
        while count:
            chunk = self._output.popleft()
            if count < len(chunk):
                self._output.appendleft(chunk[count:])
                return
            count -= len(chunk)

    def _watch(self) -> None:
        wanted = (selectors.EVENT_READ if self._reads else 0) | (selectors.EVENT_WRITE if self._output else 0)
        if wanted == self._watched:
            return
        if not wanted:
            self._selector.unregister(self._connection)
        elif self._watched:
            self._selector.modify(self._connection, wanted, self._ready)
        else:
            self._selector.register(self._connection, wanted, self._ready)
        self._watched = wanted
