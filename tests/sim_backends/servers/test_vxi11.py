"""VXI-11: what its core and abort channels answer, to stock pyvisa-py and to calls byte by byte."""

import gc
import socket
import struct
from collections.abc import Generator, Iterator
from contextlib import AbstractContextManager, nullcontext

import pytest
from pyvisa.constants import StatusCode
from pyvisa.errors import VisaIOError
from pyvisa.resources import MessageBasedResource

from sim_backends.scpi.messages import Chunk, Message
from sim_backends.servers.loop import Instrument, Loop
from sim_backends.servers.vxi11 import serve_vxi11
from tests.sim_backends.servers.clients import StockClients

CORE, ABORT = 0x0607AF, 0x0607B0


class Echo:
    """Answers every query with its header; `WAIT?` and `MUTE?` never."""

    def __init__(self) -> None:
        self.triggers = 0
        self.open = False

    def run(self, message: Message) -> Generator[None, None, list[Chunk]]:
        for unit in message.units:
            self.triggers += unit.header == "*TRG"
            self.open |= unit.header == "OPEN"
            while unit.header == "WAIT" and not self.open:
                yield
        return [unit.header.encode() for unit in message.units if unit.query and unit.header not in ("MUTE", "WAIT")]

    def clear(self) -> None:
        self.triggers = 0

    def status_byte(self) -> int:
        return 0

    def listens(self, begun: bytes) -> bool:
        return True

    def connection(self) -> AbstractContextManager[Instrument]:
        return nullcontext(self)


class Server:
    def __init__(self) -> None:
        self.echo = Echo()
        self.loop = Loop()
        self.port = serve_vxi11(self.loop, self.echo)
        self.loop.start()
        self._clients = StockClients()

    def open(self) -> MessageBasedResource:
        return self._clients.open(f"TCPIP0::127.0.0.1,{self.port}::inst0::INSTR")

    def connect(self) -> "Caller":
        return Caller(self.port)

    def close(self) -> None:
        self._clients.close()
        self.loop.stop()


class Caller:
    """Makes calls, well formed or not."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=20)

    def __enter__(self) -> "Caller":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def send(self, record: bytes, fragments: int = 1) -> None:
        size = -(-len(record) // fragments)
        for n in range(fragments):
            piece = record[n * size : (n + 1) * size]
            last = 0x8000_0000 if n == fragments - 1 else 0
            self._socket.sendall(struct.pack("!I", last | len(piece)) + piece)

    def receive(self) -> bytes:
        """The next record; nothing at the end of the connection."""
        mark = self._exactly(4)
        return self._exactly(struct.unpack("!I", mark)[0] & 0x7FFF_FFFF) if mark else b""

    def ask(
        self, procedure: int, arguments: bytes, *, program: int = CORE, number: int = 5, fragments: int = 1
    ) -> None:
        head = struct.pack("!10I", number, 0, 2, program, 1, procedure, 0, 0, 0, 0)
        self.send(head + arguments, fragments)

    def call(self, procedure: int, arguments: bytes, *, program: int = CORE, fragments: int = 1) -> tuple[int, ...]:
        self.ask(procedure, arguments, program=program, fragments=fragments)
        return self.answer()

    def answer(self, number: int = 5) -> tuple[int, ...]:
        """The 32-bit values behind the head of a reply that went well."""
        reply = self.receive()
        assert reply[:24] == struct.pack("!6I", number, 1, 0, 0, 0, 0)
        return struct.unpack(f"!{len(reply[24:]) // 4}I", reply[24:])

    def link(self, *, lock: bool = False, name: bytes = b"inst0") -> tuple[int, ...]:
        padded = name + bytes(-len(name) % 4)
        return self.call(10, struct.pack("!4I", 1, lock, 0, len(name)) + padded)

    def _exactly(self, count: int) -> bytes:
        received = b""
        while len(received) < count:
            more = self._socket.recv(count - len(received))
            if not more:
                return b""
            received += more
        return received


def write(link: int, data: bytes, flags: int = 8) -> bytes:
    return struct.pack("!5I", link, 0, 0, flags, len(data)) + data + bytes(-len(data) % 4)


def read(link: int, size: int = 100, flags: int = 0, terminator: int = 0) -> bytes:
    return struct.pack("!6I", link, size, 0, 0, flags, terminator)


def on(link: int) -> bytes:
    return struct.pack("!4I", link, 0, 0, 0)


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.close()
    gc.collect()  # a socket left open is reported here


def test_a_query_without_reply_times_out_at_once(server: Server) -> None:
    client = server.open()
    client.write("MUTE?")
    with pytest.raises(VisaIOError) as error:
        client.read()
    assert error.value.error_code == StatusCode.error_timeout
    assert client.query("A?") == "A"


def test_replies_in_pieces(server: Server) -> None:
    client = server.open()
    client.write("ABCDEFGH?")
    assert client.read_bytes(3) == b"ABC"
    assert client.read_stb() == 16
    assert client.read_raw() == b"DEFGH\n"
    assert client.read_stb() == 0


def test_trigger_and_clear(server: Server) -> None:
    client = server.open()
    client.assert_trigger()
    assert client.query("A?") == "A"
    assert server.echo.triggers == 1
    client.clear()
    assert server.echo.triggers == 0


def test_a_lock_keeps_others_out(server: Server) -> None:
    holder, other = server.open(), server.open()
    holder.lock_excl()
    with pytest.raises(VisaIOError):
        other.write("A?")
    with pytest.raises(VisaIOError):
        other.assert_trigger()
    with pytest.raises(VisaIOError):
        other.lock_excl()
    assert holder.query("B?") == "B"
    holder.unlock()
    assert other.query("A?") == "A"
    with pytest.raises(VisaIOError):
        other.unlock()


def test_a_lock_ends_with_its_link(server: Server) -> None:
    with server.connect() as first, server.connect() as second:
        _, held, _, _ = first.link(lock=True)
        assert second.link(lock=True)[0] == 11
        _, other, _, _ = second.link()
        assert second.call(12, read(other))[0] == 11
        assert first.call(23, struct.pack("!I", held)) == (0,)
        assert second.call(11, write(other, b"A?")) == (0, 2)
        assert second.call(12, read(other)) == (0, 4, 2, 0x410A0000)


def test_links_and_fragments(server: Server) -> None:
    with server.connect() as caller:
        _, first, abort_port, largest = caller.link()
        _, second, *_ = caller.link()
        assert first != second
        assert abort_port
        assert largest >= 1 << 20
        assert caller.call(11, write(first, b"A?"), fragments=3) == (0, 2)
        assert caller.call(11, write(second, b"B?\nC?\n", flags=0)) == (0, 6)
        assert caller.call(12, read(second, flags=128, terminator=ord("B"))) == (0, 2, 1, 0x42000000)
        assert caller.call(12, read(second, size=1)) == (0, 1 | 4, 1, 0x0A000000)
        assert caller.call(12, read(second)) == (0, 4, 2, 0x430A0000)
        assert caller.call(12, read(first)) == (0, 4, 2, 0x410A0000)


def test_what_is_not_served(server: Server) -> None:
    with server.connect() as caller:
        assert caller.link(name=b"gpib0,1")[0] == 3
        _, link, *_ = caller.link()
        assert caller.call(0, b"") == ()
        assert caller.call(12, read(link + 1)) == (4, 0, 0)
        assert caller.call(23, on(link + 1)) == (4,)
        assert caller.call(16, on(link)) == caller.call(17, on(link)) == (0,)
        assert caller.call(20, on(link)) == (8,)
        assert caller.call(22, on(link)) == (8, 0)
        assert caller.call(25, b"") == caller.call(26, b"") == (8,)


@pytest.mark.parametrize(
    ("call", "answer"),
    [
        (struct.pack("!10I", 9, 0, 2, CORE, 1, 99, 0, 0, 0, 0), (9, 1, 0, 0, 0, 3)),
        (struct.pack("!10I", 9, 0, 2, CORE, 2, 10, 0, 0, 0, 0), (9, 1, 0, 0, 0, 2, 1, 1)),
        (struct.pack("!10I", 9, 0, 2, 100_000, 1, 10, 0, 0, 0, 0), (9, 1, 0, 0, 0, 1)),
        (struct.pack("!10I", 9, 0, 3, CORE, 1, 10, 0, 0, 0, 0), (9, 1, 1, 0, 2, 2)),
        (struct.pack("!10I", 9, 0, 2, CORE, 1, 10, 0, 0, 0, 0), (9, 1, 0, 0, 0, 4)),
        (struct.pack("!12I", 9, 0, 2, CORE, 1, 11, 0, 0, 0, 0, 1, 2), (9, 1, 0, 0, 0, 0, 4, 0)),
    ],
)
def test_calls_that_are_refused(server: Server, call: bytes, answer: tuple[int, ...]) -> None:
    with server.connect() as caller:
        caller.send(call)
        reply = caller.receive()
        assert struct.unpack(f"!{len(reply) // 4}I", reply) == answer
        assert caller.link()[0] == 0


@pytest.mark.parametrize(
    "rubbish",
    [
        b"\x80\0\0\4GET ",
        b"\xff\xff\xff\xff",
        bytes(4),
        struct.pack("!11I", 0x8000_0028, 9, 1, 2, CORE, 1, 0, 0, 0, 0, 0),
    ],
)
def test_what_is_no_call_ends_the_connection(server: Server, rubbish: bytes) -> None:
    with server.connect() as caller:
        caller.link()
        caller._socket.sendall(rubbish)
        assert caller.receive() == b""
    assert server.open().query("A?") == "A"


def test_abort_ends_a_read_that_waits(server: Server) -> None:
    with server.connect() as caller:
        _, link, abort_port, _ = caller.link()
        caller.call(11, write(link, b"WAIT?"))
        caller.ask(12, read(link), number=6)
        with Caller(abort_port) as aborter:
            assert aborter.call(1, struct.pack("!I", link + 1), program=ABORT) == (4,)
            assert aborter.call(1, struct.pack("!I", link), program=ABORT) == (0,)
        assert caller.answer(6) == (23, 0, 0)
        caller.ask(12, read(link), number=6)
        caller.ask(12, read(link), number=7)  # takes the place of the other
        assert caller.answer(6) == (15, 0, 0)
        caller.ask(15, on(link), number=8)
        assert caller.answer(7) == (23, 0, 0)
        assert caller.answer(8) == (0,)


def test_a_blocked_message_that_ends_without_reply(server: Server) -> None:
    other = server.open()
    with server.connect() as caller:
        _, link, *_ = caller.link()
        caller.call(11, write(link, b"WAIT?"))
        caller.ask(12, read(link))
        other.write("OPEN")
        assert caller.answer() == (15, 0, 0)


def test_the_server_ends_while_too_much_waits(server: Server) -> None:
    with server.connect() as caller:
        _, link, *_ = caller.link()
        assert caller.call(11, write(link, b"WAIT?\n" + 300 * b"A\n")) == (0, 606)
        server.close()
        assert caller.receive() == b""
