"""HiSLIP message by message: what stock clients never send, or never notice."""

import socket
import struct
from collections.abc import Generator, Iterator
from contextlib import AbstractContextManager, nullcontext

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.scpi.messages import Chunk, Message
from sim_backends.servers.frames import HEADER, Kind, data_frames, header
from sim_backends.servers.hislip import HislipServer
from sim_backends.servers.loop import Instrument, Loop
from sim_backends.servers.sessions import LARGEST_MESSAGE

Received = tuple[int, int, int, bytes]


class Echo:
    def __init__(self) -> None:
        self.log: list[str] = []

    def run(self, message: Message) -> Generator[None, None, list[Chunk]]:
        for unit in message.units:
            self.log.append(unit.header)
            while unit.header == "WAIT":
                yield
        return [unit.header.encode() for unit in message.units if unit.query]

    def clear(self) -> None:
        self.log.append("clear")

    def status_byte(self) -> int:
        return 0x50

    def listens(self, begun: bytes) -> bool:
        return True

    def connection(self) -> AbstractContextManager[Instrument]:
        return nullcontext(self)


class Peer:
    """One connection of a client that says exactly what it is told to."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=20)

    def send(self, kind: int, control: int = 0, parameter: int = 0, payload: bytes = b"") -> None:
        self.socket.sendall(HEADER.pack(b"HS", kind, control, parameter, len(payload)) + payload)

    def receive(self) -> Received:
        prologue, kind, control, parameter, length = HEADER.unpack(self._exactly(HEADER.size))
        assert prologue == b"HS"
        return kind, control, parameter, self._exactly(length)

    def ask(self, kind: int, control: int = 0, parameter: int = 0, payload: bytes = b"") -> Received:
        self.send(kind, control, parameter, payload)
        return self.receive()

    def ended(self) -> bool:
        try:
            return self.socket.recv(1) == b""
        except ConnectionResetError:
            return True

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self.socket.recv(count - len(data))
            assert more
            data += more
        return data


class Server:
    def __init__(self) -> None:
        self.echo = Echo()
        self.loop = Loop()
        self.served = HislipServer(self.loop, self.echo)
        self.port = self.loop.listen("127.0.0.1", 0, self.served.accept)
        self.peers: list[Peer] = []
        self.loop.start()

    def peer(self) -> Peer:
        self.peers.append(Peer(self.port))
        return self.peers[-1]

    def session(self) -> tuple[Peer, Peer]:
        synchronous, asynchronous = self.peer(), self.peer()
        kind, control, parameter, _ = synchronous.ask(Kind.INITIALIZE, 0, 0x0200 << 16 | 0x7878, b"hislip0")
        assert (kind, control, parameter >> 16) == (Kind.INITIALIZE_RESPONSE, 0, 0x0100)
        kind, *_ = asynchronous.ask(Kind.ASYNC_INITIALIZE, 0, parameter & 0xFFFF)
        assert kind == Kind.ASYNC_INITIALIZE_RESPONSE
        return synchronous, asynchronous

    def close(self) -> None:
        for peer in self.peers:
            peer.socket.close()
        self.loop.stop()


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.close()


def test_replies_carry_the_identifier_of_their_query(server: Server) -> None:
    synchronous, _ = server.session()
    synchronous.send(Kind.DATA, 0, 10, b"A?")
    assert synchronous.ask(Kind.DATA_END, 0, 12, b";B?\n") == (Kind.DATA_END, 0, 12, b"AB\n")
    synchronous.send(Kind.DATA_END, 0, 14, b"")
    synchronous.send(Kind.DATA_END, 0, 16, b"C?\nD?")
    assert synchronous.receive() == (Kind.DATA_END, 0, 16, b"C\n")
    assert synchronous.receive() == (Kind.DATA_END, 0, 16, b"D\n")


def test_messages_that_come_byte_by_byte(server: Server) -> None:
    synchronous, _ = server.session()
    synchronous.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for byte in header(Kind.DATA_END, 0, 10, 3) + b"A?\n":
        synchronous.socket.sendall(bytes([byte]))
    assert synchronous.receive() == (Kind.DATA_END, 0, 10, b"A\n")


@pytest.mark.parametrize("first", [Kind.DATA_END, Kind.ASYNC_STATUS_QUERY, Kind.ASYNC_INITIALIZE, 99])
def test_no_session_without_initialisation(server: Server, first: int) -> None:
    peer = server.peer()
    kind, control, _, text = peer.ask(first, 0, 77)
    assert (kind, control) == (Kind.FATAL_ERROR, 3)
    assert text
    assert peer.ended()


def test_a_session_that_lasts_keeps_its_number(server: Server) -> None:
    lasting, _ = server.session()
    server.served._last = 0xFFFF  # as if so many others had come and gone
    for name in (b"B?", b"C?"):
        other, _ = server.session()
        assert other.ask(Kind.DATA_END, 0, 10, name) == (Kind.DATA_END, 0, 10, name[:1] + b"\n")
    assert lasting.ask(Kind.DATA_END, 0, 10, b"A?") == (Kind.DATA_END, 0, 10, b"A\n")


def test_no_data_without_the_second_connection(server: Server) -> None:
    peer = server.peer()
    peer.ask(Kind.INITIALIZE, 0, 0x0100 << 16, b"hislip0")
    assert peer.ask(Kind.DATA_END, 0, 10, b"A?\n")[:2] == (Kind.FATAL_ERROR, 2)
    assert peer.ended()
    assert server.echo.log == []


def test_what_is_not_hislip_is_refused(server: Server) -> None:
    peer = server.peer()
    peer.socket.sendall(b"*IDN?\n*IDN?\n*IDN?\n")
    assert peer.receive()[:2] == (Kind.FATAL_ERROR, 1)
    assert peer.ended()
    synchronous, asynchronous = server.session()
    synchronous.socket.sendall(bytes(16))
    assert synchronous.receive()[:2] == (Kind.FATAL_ERROR, 1)
    assert synchronous.ended()
    assert asynchronous.ended()


def test_unknown_messages_are_errors_and_nothing_else(server: Server) -> None:
    synchronous, asynchronous = server.session()
    for peer in (synchronous, asynchronous):
        assert peer.ask(26, 0, 0, b"x" * 10_000)[:2] == (Kind.ERROR, 1)
        peer.send(Kind.ERROR, 0, 0, b"sorry")
    assert synchronous.ask(Kind.DATA_END, 0, 10, b"A?")[3] == b"A\n"


def test_either_end_closes_both_connections(server: Server) -> None:
    synchronous, asynchronous = server.session()
    synchronous.send(Kind.FATAL_ERROR, 0, 0, b"bye")
    assert synchronous.ended()
    assert asynchronous.ended()
    synchronous, asynchronous = server.session()
    asynchronous.socket.close()
    assert synchronous.ended()


def test_device_clear_drops_what_was_sent_before(server: Server) -> None:
    synchronous, asynchronous = server.session()
    synchronous.send(Kind.DATA_END, 0, 10, b"A;WAIT;B?")
    synchronous.send(Kind.DATA, 0, 12, b"C #15")
    assert asynchronous.ask(Kind.ASYNC_DEVICE_CLEAR)[0] == Kind.ASYNC_DEVICE_CLEAR_ACKNOWLEDGE
    synchronous.send(Kind.DATA_END, 0, 14, b"DROPPED?")
    assert synchronous.ask(Kind.DEVICE_CLEAR_COMPLETE)[0] == Kind.DEVICE_CLEAR_ACKNOWLEDGE
    assert synchronous.ask(Kind.DATA_END, 0, 0xFFFFFF00, b"E?")[3] == b"E\n"
    assert [word for word in server.echo.log if word not in ("A", "WAIT", "B")] == ["clear", "E"]


def test_trigger(server: Server) -> None:
    synchronous, _ = server.session()
    synchronous.send(Kind.TRIGGER, 0, 10)
    assert synchronous.ask(Kind.DATA_END, 0, 12, b"A?")[3] == b"A\n"
    assert server.echo.log == ["*TRG", "A"]


def test_message_size_and_remote_control(server: Server) -> None:
    _, asynchronous = server.session()
    reply = asynchronous.ask(Kind.ASYNC_MAX_MESSAGE_SIZE, 0, 0, struct.pack("!Q", 1 << 40))
    assert reply == (Kind.ASYNC_MAX_MESSAGE_SIZE_RESPONSE, 0, 0, struct.pack("!Q", LARGEST_MESSAGE))
    assert asynchronous.ask(Kind.ASYNC_REMOTE_LOCAL_CONTROL, 1, 10)[0] == Kind.ASYNC_REMOTE_LOCAL_RESPONSE


def test_status_is_told_when_what_came_before_is_executed(server: Server) -> None:
    synchronous, asynchronous = server.session()
    synchronous.send(Kind.DATA_END, 0, 10, b"A?")
    assert asynchronous.ask(Kind.ASYNC_STATUS_QUERY, 0, 10)[:2] == (Kind.ASYNC_STATUS_RESPONSE, 0x50)
    assert synchronous.receive()[3] == b"A\n"
    assert asynchronous.ask(Kind.ASYNC_STATUS_QUERY, 1, 10)[:2] == (Kind.ASYNC_STATUS_RESPONSE, 0x40)


def test_the_lock_holds_others_off(server: Server) -> None:
    synchronous, asynchronous = server.session()
    other, other_asynchronous = server.session()
    assert asynchronous.ask(Kind.ASYNC_LOCK, 1, 100)[:2] == (Kind.ASYNC_LOCK_RESPONSE, 1)
    assert other_asynchronous.ask(Kind.ASYNC_LOCK, 1, 100)[:2] == (Kind.ASYNC_LOCK_RESPONSE, 0)
    assert other_asynchronous.ask(Kind.ASYNC_LOCK_INFO)[:3] == (Kind.ASYNC_LOCK_INFO_RESPONSE, 1, 1)
    other.send(Kind.DATA_END, 0, 10, b"LATER?")
    assert synchronous.ask(Kind.DATA_END, 0, 10, b"FIRST?")[3] == b"FIRST\n"
    assert asynchronous.ask(Kind.ASYNC_LOCK, 0, 10)[:2] == (Kind.ASYNC_LOCK_RESPONSE, 1)
    assert other.receive()[3] == b"LATER\n"
    assert server.echo.log == ["FIRST", "LATER"]


def test_the_lock_of_a_client_that_leaves_is_released(server: Server) -> None:
    synchronous, asynchronous = server.session()
    other, _ = server.session()
    assert asynchronous.ask(Kind.ASYNC_LOCK, 1, 100)[:2] == (Kind.ASYNC_LOCK_RESPONSE, 1)
    other.send(Kind.DATA_END, 0, 10, b"LATER?")
    synchronous.socket.close()
    assert other.receive()[3] == b"LATER\n"


@given(st.lists(st.binary(max_size=50), max_size=5), st.integers(17, 100))
def test_data_frames_hold_the_reply(chunks: list[bytes], largest: int) -> None:
    stream = b"".join(data_frames(list(chunks), 7, largest))
    payload, kinds = b"", []
    while stream:
        _, kind, _, parameter, length = HEADER.unpack(stream[: HEADER.size])
        assert parameter == 7
        assert HEADER.size + length <= largest
        kinds.append(kind)
        payload += stream[HEADER.size : HEADER.size + length]
        stream = stream[HEADER.size + length :]
    assert payload == b"".join(chunks)
    assert kinds == [Kind.DATA] * (len(kinds) - 1) + [Kind.DATA_END]
