"""Raw TCP: messages and replies end at a newline (`TCPIP0::host::port::SOCKET`)."""

import socket

from sim_backends.servers.channel import Channel, Chunk
from sim_backends.servers.clients import MOST_WAITING, Client, Instrument
from sim_backends.servers.disturbed import Disturbed, pieces
from sim_backends.servers.loop import Loop


def serve_socket(loop: Loop, instrument: Instrument, host: str = "127.0.0.1", port: int = 0) -> int:
    """Serve `instrument` on a raw socket of `loop`; returns the port (0: any free one).

    Raises:
        OSError: The port is taken or the address is not one of this machine.
    """
    return loop.listen(host, port, lambda connection: SocketClient(loop, instrument, connection))


class SocketClient(Client):
    """A client on a raw socket."""

    def __init__(self, loop: Loop, instrument: Instrument, connection: socket.socket) -> None:
        super().__init__(loop, instrument)
        self._channel = Channel(loop.selector, connection, readable=self._readable, lost=self._end)
        self._ended = False
        self._late = b""

    @property
    def sending(self) -> bool:
        """Whether a reply is still on its way."""
        return self._channel.sending

    def reply(self, chunks: list[Chunk], tag: int) -> None:
        """Send `chunks` and a newline."""
        self._channel.send((*chunks, b"\n"))

    def disturb(self, disturbed: Disturbed, tag: int) -> None:
        """Send what a fault has made of a reply."""
        if disturbed.late:
            self._late += disturbed.data
            return
        late, self._late = self._late, b""
        for piece in (late, *pieces(disturbed.data[: disturbed.ends_after], disturbed.packet)):
            self._channel.send((piece,))
        if disturbed.hangs_up:
            self.hang_up()

    def hang_up(self) -> None:
        """End the connection at once."""
        self._channel.close()
        self._end()

    def resume(self) -> None:
        """Read on, unless too much is waiting."""
        self._channel.read(wanted=not self._ended and len(self.waiting) < MOST_WAITING)

    def close(self) -> None:
        """Close the connection."""
        self._channel.close()

    def _readable(self) -> None:
        count = self._channel.receive(self.reader.buffer())
        if count:
            self.deliver(self.take(count))
            if len(self.waiting) >= MOST_WAITING:
                self._channel.read(wanted=False)
        elif count == 0:
            self._end()

    def _end(self) -> None:
        if not self._ended:
            self._ended = True
            self._channel.read(wanted=False)
            self.loop.leave(self)
