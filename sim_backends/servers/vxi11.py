"""VXI-11 (`TCPIP0::host,port::inst0::INSTR`): the core and the abort channel, without a port mapper.

The address names the port, so nothing needs the port mapper's privileged one. Source: VXI-11 revision 1.0 (VXIbus
TCP/IP instrument protocol), appendix B. Not served: interrupt channels and service requests.
"""

import socket
from collections.abc import Callable

from sim_backends.scpi.messages import Chunk
from sim_backends.servers.disturbed import Disturbed
from sim_backends.servers.links import DeviceError, Link, Read
from sim_backends.servers.locks import Locks
from sim_backends.servers.loop import MOST_WAITING, Instrument, Loop
from sim_backends.servers.rpc import Call, RpcConnection, opaque, unsigned

CORE_PROGRAM, ABORT_PROGRAM, VERSION = 0x0607AF, 0x0607B0, 1
DEVICE = b"inst0"
LARGEST_WRITE = 1 << 22  # bytes of one device_write; what clients ask for and cut their messages to
LARGEST_READ = 1 << 22  # bytes of one device_read, whatever the client has room for
_ROOM_FOR_CALL = 4096  # bytes of everything in a device_write but its data
END_OF_MESSAGE, TERMINATOR_SET = 8, 128  # flags

Handler = Callable[[Call], None]


def serve_vxi11(loop: Loop, instrument: Instrument, host: str = "127.0.0.1", port: int = 0) -> int:
    """Serve `instrument` by VXI-11 in `loop`; returns the port of the core channel (0: any free one).

    Raises:
        OSError: The port is taken or the address is not one of this machine.
    """
    server = Vxi11Server(loop, instrument)
    server.abort_port = loop.listen(host, 0, server.accept_abort)
    return loop.listen(host, port, server.accept)


class Vxi11Server:
    """The links of one instrument."""

    def __init__(self, loop: Loop, instrument: Instrument) -> None:
        self.loop = loop
        self.instrument = instrument
        self.abort_port = 0
        self.links: dict[int, Link] = {}
        self.locks: Locks[Link] = Locks()
        self._last = 0

    def accept(self, connection: socket.socket) -> None:
        """Take in a connection to the core channel."""
        CoreConnection(self, connection)

    def accept_abort(self, connection: socket.socket) -> None:
        """Take in a connection to the abort channel."""

        def abort(call: Call) -> None:
            link = self.links.get(call.arguments.integer())
            if link is None:
                peer.succeed(call, [unsigned(DeviceError.INVALID_LINK)])
            else:
                link.abort_read()
                peer.succeed(call, [unsigned(DeviceError.NONE)])

        peer = RpcConnection(
            self.loop.selector,
            connection,
            program=ABORT_PROGRAM,
            version=VERSION,
            procedures={1: abort},
            largest=_ROOM_FOR_CALL,
            ended=lambda: None,
        )

    def new_link(self, core: "CoreConnection") -> tuple[int, Link]:
        """A link with a number of its own."""
        self._last = self._last % 0x7FFF_FFFF + 1
        link = Link(
            self.loop,
            self.instrument,
            self.locks,
            read_on=core.read_on,
            transmitting=lambda: bool(core.rpc.channel.unsent),
            hang_up=core.rpc.end,
        )
        self.loop.join(link)
        self.links[self._last] = link
        return self._last, link


class CoreConnection:
    """One client's core channel; it may carry several links."""

    def __init__(self, server: Vxi11Server, connection: socket.socket) -> None:
        self._server = server
        self._links: dict[int, Link] = {}
        procedures: dict[int, Handler] = {
            10: self._create_link,
            11: self._on_link(self._write),
            12: self._on_link(self._read),
            13: self._on_link(self._unless_locked(self._read_status)),
            14: self._on_link(self._unless_locked(self._trigger)),
            15: self._on_link(self._unless_locked(self._clear)),
            16: self._on_link(self._unless_locked(self._acknowledge)),  # device_remote
            17: self._on_link(self._unless_locked(self._acknowledge)),  # device_local
            18: self._on_link(self._lock),
            19: self._on_link(self._unlock),
            20: self._on_link(self._not_supported),  # device_enable_srq
            22: self._on_link(self._not_supported),  # device_docmd
            23: self._destroy_link,
            25: self._no_interrupts,
            26: self._no_interrupts,
        }
        self.rpc = RpcConnection(
            server.loop.selector,
            connection,
            program=CORE_PROGRAM,
            version=VERSION,
            procedures=procedures,
            largest=LARGEST_WRITE + _ROOM_FOR_CALL,
            ended=self._end,
        )

    def read_on(self) -> None:
        """Read on, unless too many messages of a link are waiting."""
        self.rpc.channel.read(wanted=all(len(link.waiting) < MOST_WAITING for link in self._links.values()))

    def _end(self) -> None:
        for number in list(self._links):
            self._drop(number)

    def _drop(self, number: int) -> None:
        del self._server.links[number]
        self._links.pop(number).end()

    def _answer(self, call: Call, error: DeviceError, *results: Chunk) -> None:
        self.rpc.succeed(call, [unsigned(error), *results])

    def _on_link(self, handle: Callable[[Call, Link], None]) -> Handler:
        def find(call: Call) -> None:
            link = self._links.get(call.arguments.integer())
            if link is not None:
                handle(call, link)
            else:
                self._fail(call, DeviceError.INVALID_LINK)

        return find

    def _unless_locked(self, handle: Callable[[Call, Link], None]) -> Callable[[Call, Link], None]:
        """Refuse it while another link has the lock (B.6.6 to B.6.10)."""

        def handled(call: Call, link: Link) -> None:
            if link.held_off():
                self._fail(call, DeviceError.LOCKED)
            else:
                handle(call, link)

        return handled

    def _fail(self, call: Call, error: DeviceError) -> None:
        """Answer with `error` and as many zeros as the results of that procedure have."""
        zeros = {10: 3, 11: 1, 12: 2, 13: 1, 22: 1}.get(call.procedure, 0)
        self._answer(call, error, unsigned(*[0] * zeros))

    def _create_link(self, call: Call) -> None:
        call.arguments.integer()  # the client's own number
        wants_lock = bool(call.arguments.integer())
        call.arguments.unsigned()  # how long to wait for the lock: nothing here waits
        if bytes(call.arguments.opaque()).lower() != DEVICE:
            self._fail(call, DeviceError.NOT_ACCESSIBLE)
            return
        number, link = self._server.new_link(self)
        self._links[number] = link
        if wants_lock and not link.lock():
            self._drop(number)
            self._fail(call, DeviceError.LOCKED)
            return
        self._answer(call, DeviceError.NONE, unsigned(number, self._server.abort_port, LARGEST_WRITE))

    def _destroy_link(self, call: Call) -> None:
        number = call.arguments.integer()
        if number in self._links:
            self._drop(number)
            self._answer(call, DeviceError.NONE)
        else:
            self._answer(call, DeviceError.INVALID_LINK)

    def _write(self, call: Call, link: Link) -> None:
        _io_timeout, _lock_timeout = call.arguments.unsigned(), call.arguments.unsigned()
        flags = call.arguments.integer()
        data = call.arguments.opaque()
        if link.held_off():
            self._fail(call, DeviceError.LOCKED)
            return
        link.write(data, last=bool(flags & END_OF_MESSAGE))
        self._answer(call, DeviceError.NONE, unsigned(len(data)))

    def _read(self, call: Call, link: Link) -> None:
        size = call.arguments.unsigned()
        _io_timeout, _lock_timeout = call.arguments.unsigned(), call.arguments.unsigned()
        flags, terminator = call.arguments.integer(), call.arguments.integer()
        if link.held_off():
            self._fail(call, DeviceError.LOCKED)
            return

        def answer(error: int, reason: int, data: list[Chunk], disturbed: Disturbed) -> None:
            self.rpc.succeed(call, [unsigned(error, reason), *opaque(data)], disturbed)

        ends_at = terminator & 0xFF if flags & TERMINATOR_SET else None
        link.read(Read(min(size, LARGEST_READ), ends_at, answer))

    def _read_status(self, call: Call, link: Link) -> None:
        def report() -> None:  # when what was sent before has been executed
            self._answer(call, DeviceError.NONE, unsigned(link.status_byte()))

        self._server.loop.when_idle(report)

    def _trigger(self, call: Call, link: Link) -> None:
        link.trigger()
        self._acknowledge(call, link)

    def _clear(self, call: Call, link: Link) -> None:
        link.clear()
        self.read_on()
        self._acknowledge(call, link)

    def _acknowledge(self, call: Call, _link: Link) -> None:
        self._answer(call, DeviceError.NONE)

    def _lock(self, call: Call, link: Link) -> None:
        def decide() -> None:  # what was sent under the lock is executed before another gets it
            self._answer(call, DeviceError.NONE if link.lock() else DeviceError.LOCKED)

        self._server.loop.when_idle(decide)

    def _unlock(self, call: Call, link: Link) -> None:
        def decide() -> None:
            self._answer(call, DeviceError.NONE if link.unlock() else DeviceError.NO_LOCK)

        self._server.loop.when_idle(decide)

    def _not_supported(self, call: Call, _link: Link) -> None:
        self._fail(call, DeviceError.NOT_SUPPORTED)

    def _no_interrupts(self, call: Call) -> None:
        self._answer(call, DeviceError.NOT_SUPPORTED)
