"""HiSLIP 1.0 in synchronised mode (`TCPIP0::host::hislip0,port::INSTR`), after IVI-6.1.

A session has two connections: messages and replies on the synchronous one; status, device clear and locks on the
asynchronous one. The first message on a connection shows which of them it is.
"""

import socket
from collections.abc import Callable

from sim_backends.servers.frames import UNRECOGNISED_TYPE, Fatal, Frame, FrameReader, Kind, error, fatal_error, header
from sim_backends.servers.locks import Locks
from sim_backends.servers.loop import Instrument, Loop
from sim_backends.servers.sessions import Session
from sim_backends.servers.socket import Channel

VERSION = 0x0100  # 1.0
VENDOR = int.from_bytes(b"LC", "big")


def serve_hislip(loop: Loop, instrument: Instrument, host: str = "127.0.0.1", port: int = 0) -> int:
    """Serve `instrument` by HiSLIP in `loop`; returns the port (0: any free one).

    Raises:
        OSError: The port is taken or the address is not one of this machine.
    """
    server = HislipServer(loop, instrument)
    return loop.listen(host, port, server.accept)


class HislipServer:
    """The sessions of one instrument."""

    def __init__(self, loop: Loop, instrument: Instrument) -> None:
        self.loop = loop
        self.instrument = instrument
        self.sessions: dict[int, Session] = {}
        self.locks: Locks[Session] = Locks()
        self._last = 0

    def accept(self, connection: socket.socket) -> None:
        """Take in a connection; its first message shows which of the two it is."""
        Connection(self, connection)

    def new_session(self, connection: "Connection") -> "Session":
        """Open a session on its synchronous connection."""
        while (identifier := self._last % 0xFFFF + 1) in self.sessions:  # which has lasted for 65 535 others
            self._last = identifier
        self._last = identifier
        session = self.sessions[identifier] = Session(
            self.loop,
            self.instrument,
            identifier,
            connection.channel,
            self.locks,
            ended=lambda: self.sessions.pop(identifier),
        )
        self.loop.join(session)
        return session


class Connection:
    """One of the two connections of a session, or one of which that is not known yet."""

    def __init__(self, server: HislipServer, connection: socket.socket) -> None:
        self._server = server
        self._session: Session | None = None
        self._handlers: dict[int, Callable[[Frame, bytes], None]] = {
            Kind.INITIALIZE: self._initialize,
            Kind.ASYNC_INITIALIZE: self._initialize_asynchronous,
        }
        self._frames = FrameReader(
            data_room=self._data_room, data=self._data, complete=self._complete, rubbish=self._refuse_rubbish
        )
        self.channel = Channel(server.loop.selector, connection, readable=self._readable, lost=self._end)

    def _refuse(self, code: Fatal, reason: str) -> None:
        """Send a FatalError and give up the connection, and its session with it."""
        self.channel.send(fatal_error(code, reason))
        self._end()

    def _readable(self) -> None:
        if not self._frames.read(self.channel):
            self._end()

    def _end(self) -> None:
        if self._session is None:
            self.channel.close()
        else:
            self._session.end()

    def _data_room(self) -> memoryview | None:
        return self._session.data_room() if self._session else None

    def _data(self, frame: Frame, count: int) -> None:
        if self._session:
            self._session.data(frame, count)

    def _refuse_rubbish(self) -> None:
        self._refuse(Fatal.POOR_HEADER, "not a HiSLIP message")

    def _complete(self, frame: Frame, payload: bytes) -> None:
        handler = self._handlers.get(frame.kind)
        if handler:
            handler(frame, payload)
        elif self._session is None:
            self._refuse(Fatal.INVALID_INITIALIZATION, "the first message must be Initialize or AsyncInitialize")
        else:
            self.channel.send(error(UNRECOGNISED_TYPE, "message type not known here"))

    def _initialize(self, frame: Frame, _name: bytes) -> None:
        session = self._session = self._server.new_session(self)
        self._handlers = session.synchronous_handlers()
        version = min(VERSION, frame.parameter >> 16)
        self.channel.send([header(Kind.INITIALIZE_RESPONSE, 0, version << 16 | session.identifier)])

    def _initialize_asynchronous(self, frame: Frame, _payload: bytes) -> None:
        session = self._server.sessions.get(frame.parameter)
        if session is None or session.asynchronous is not None:
            self._refuse(Fatal.INVALID_INITIALIZATION, f"there is no session {frame.parameter} without this channel")
            return
        self._session = session
        session.asynchronous = self.channel
        self._handlers = session.asynchronous_handlers()
        self.channel.send([header(Kind.ASYNC_INITIALIZE_RESPONSE, 0, VENDOR)])
