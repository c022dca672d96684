"""The loop: who is heard, in which order messages are executed, and what a client that misbehaves can do (nothing)."""

import errno
import logging
import os
import selectors
import socket
import sys
import threading
from collections.abc import Generator, Iterator
from contextlib import AbstractContextManager, closing, nullcontext, suppress

import pytest

from sim_backends.scpi.messages import Chunk, Malformed, Message
from sim_backends.servers.loop import MOST_WAITING, Instrument, Loop
from sim_backends.servers.socket import serve_socket


class Toy:
    """Logs what it executes; `WAIT?` is blocked until somebody sends `OPEN`, `HOLD` stops the whole loop."""

    def __init__(self) -> None:
        self.log: list[str] = []
        self.open = False
        self.held, self.release = threading.Event(), threading.Event()
        self.abandoned = 0

    def run(self, message: Message) -> Generator[None, None, list[Chunk]]:
        replies: list[Chunk] = []
        for unit in message.units:
            self.log.append("malformed" if isinstance(unit, Malformed) else unit.header)
            if unit.header == "HOLD":
                self.held.set()
                assert self.release.wait(20)
            elif unit.header == "WAIT":
                try:
                    while not self.open:
                        yield
                finally:
                    self.abandoned += not self.open
                replies.append(b"1")
            elif unit.header == "OPEN":
                self.open = True
            elif unit.header == "FAIL":
                raise ZeroDivisionError("toy")
            elif unit.header == "DATA" and unit.query:
                size = int(str(unit.arguments[0]))
                replies += [b"#9%09d" % size, memoryview(bytes(size))]
            elif unit.header == "DATA":
                assert isinstance(unit.arguments[0], memoryview)
                self.log.append(str(len(unit.arguments[0])))
            elif unit.query:
                replies.append(unit.header.encode())
        return replies

    def clear(self) -> None:
        self.log.append("clear")

    def status_byte(self) -> int:
        return 0

    def listens(self, begun: bytes) -> bool:
        return True

    def connection(self) -> AbstractContextManager[Instrument]:
        return nullcontext(self)


class Wire:
    """A client of a raw socket."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=20)
        self._lines = self.socket.makefile("rb")

    def send(self, *messages: bytes) -> None:
        self.socket.sendall(b"".join(messages))

    def line(self) -> bytes:
        return self._lines.readline()

    def read(self, size: int) -> bytes:
        return self._lines.read(size)

    def close(self) -> None:
        self._lines.close()
        self.socket.close()


class Bench:
    """A loop with one toy, and its clients."""

    def __init__(self) -> None:
        self.toy = Toy()
        self.loop = Loop()
        self.port = serve_socket(self.loop, self.toy)
        self._wires: list[Wire] = []
        self.loop.start()

    def client(self) -> Wire:
        """A new client, which the loop knows before the next one."""
        wire = Wire(self.port)
        self._wires.append(wire)
        wire.send(b"HELLO?\n")
        assert wire.line() == b"HELLO\n"
        self.toy.log.clear()
        return wire

    def close(self) -> None:
        for wire in self._wires:
            wire.close()
        self.loop.stop()


class FewSockets(selectors.SelectSelector):
    """As on Windows, where the number is larger."""

    most = 8

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if len(self.get_map()) > self.most:
            raise ValueError("too many file descriptors in select()")
        return super().select(timeout)


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def test_settings_first_then_queries_in_the_order_of_the_clients(bench: Bench) -> None:
    first, second, third = bench.client(), bench.client(), bench.client()
    first.send(b"HOLD\n")
    assert bench.toy.held.wait(20)
    third.send(b"C?\n")
    second.send(b"B1?;B2\nB3\n")
    first.send(b"A1\nA2?\nA3\n")
    third.send(b"C2\n")
    bench.toy.release.set()
    assert first.line() == b"A2\n"
    assert second.line() == b"B1\n"
    assert third.line() == b"C\n"
    first.send(b"END?\n")
    assert first.line() == b"END\n"
    assert bench.toy.log == ["HOLD", "A1", "A2", "A3", "B1", "B2", "B3", "C", "C2", "END"]


def test_a_blocked_client_waits_alone(bench: Bench) -> None:
    first, second = bench.client(), bench.client()
    first.send(b"WAIT?\nAFTER?\n")
    second.send(b"ME?\n")
    assert second.line() == b"ME\n"
    second.send(b"OPEN\n")
    assert first.line() == b"1\n"
    assert first.line() == b"AFTER\n"


def test_one_release_sets_all_free(bench: Bench) -> None:
    clients = [bench.client() for _ in range(4)]
    for client in clients[:3]:
        client.send(b"WAIT?\n")
    clients[3].send(b"OPEN\n")
    assert [client.line() for client in clients[:3]] == [b"1\n"] * 3


def test_a_blocked_client_that_leaves_is_forgotten(bench: Bench) -> None:
    first, second = bench.client(), bench.client()
    first.send(b"WAIT?\nNEVER\n")
    second.send(b"ME?\n")
    assert second.line() == b"ME\n"
    first.close()
    while not bench.toy.abandoned:
        second.send(b"ME?\n")
        assert second.line() == b"ME\n"
    assert "NEVER" not in bench.toy.log


def test_settings_of_a_client_that_leaves_are_executed(bench: Bench) -> None:
    first, second = bench.client(), bench.client()
    first.send(b"HOLD\n")
    assert bench.toy.held.wait(20)
    first.send(b"OUTPUT\nASK?\nOFF\n")
    first.close()
    second.send(b"ME?\n")
    bench.toy.release.set()
    assert second.line() == b"ME\n"
    assert bench.toy.log == ["HOLD", "OUTPUT", "ASK", "OFF", "ME"]


def test_half_closed_clients_get_their_reply(bench: Bench) -> None:
    client = bench.client()
    client.send(b"ASK?\nDATA? 3000000\n")
    client.socket.shutdown(socket.SHUT_WR)
    assert client.line() == b"ASK\n"
    assert len(client.read(3_000_012)) == 3_000_012
    assert client.read(1) == b""


@pytest.mark.parametrize("rude", [b"DATA #9009000000half a block", b'TEXT "half', b"DATA? 30000000\n", b"WAIT?\n"])
def test_a_client_that_vanishes_disturbs_nobody(bench: Bench, rude: bytes) -> None:
    polite = bench.client()
    for _ in range(3):
        client = bench.client()
        client.send(rude)
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # reset instead of goodbye
        client.close()
        polite.send(b"ME?\n")
        assert polite.line() == b"ME\n"


def test_large_replies_to_several_clients_at_once(bench: Bench) -> None:
    clients = [bench.client() for _ in range(3)]
    for client in clients:
        client.send(b"DATA? 5000000\nNEXT?\n")
    for client in reversed(clients):
        assert len(client.read(5_000_012)) == 5_000_012
        assert client.line() == b"NEXT\n"


def test_a_client_that_talks_without_listening_is_left_to_wait(bench: Bench) -> None:
    first, second = bench.client(), bench.client()
    first.send(b"DATA? 20000000\n", b"ASK?\n" * 3 * MOST_WAITING)
    second.send(b"ME?\n")
    assert second.line() == b"ME\n"
    assert len(first.read(20_000_012)) == 20_000_012
    assert [first.line() for _ in range(3 * MOST_WAITING)] == [b"ASK\n"] * 3 * MOST_WAITING


def test_a_client_that_sends_nothing_without_an_end_keeps_nobody_waiting(bench: Bench) -> None:
    flooding, other = bench.client(), bench.client()
    stopped = threading.Event()

    def flood() -> None:
        with suppress(OSError):
            while not stopped.is_set():
                flooding.send(b"\n" * 65536)

    sender = threading.Thread(target=flood)
    sender.start()
    other.send(b"ME?\n")
    assert other.line() == b"ME\n"
    stopped.set()
    sender.join()


@pytest.mark.skipif(sys.platform == "win32", reason="the limit of open files is the system's")
def test_a_client_too_many_is_turned_away(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    import resource

    first = bench.client()
    late = [socket.socket() for _ in range(3)]  # made here: none can be, soon
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (late[-1].fileno() + 1, limits[1]))
    holes = []
    with suppress(OSError):
        while True:
            holes.append(os.open(os.devnull, os.O_RDONLY))
    try:
        for one in late:
            one.settimeout(20)
            one.connect(("127.0.0.1", bench.port))
            assert one.recv(1) == b""
    finally:
        for hole in holes:
            os.close(hole)
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert "turned away" in caplog.text
    first.send(b"ME?\n")
    assert first.line() == b"ME\n"
    bench.client()
    for one in late:
        one.close()


def test_a_client_more_than_select_takes_is_turned_away(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Windows has nothing else than `select`, which fails there when it is asked about too many sockets."""
    monkeypatch.setattr(selectors, "DefaultSelector", FewSockets)
    monkeypatch.setattr("sim_backends.servers.loop.MOST_SOCKETS", FewSockets.most)
    with closing(Bench()) as bench:
        clients = [bench.client() for _ in range(FewSockets.most - 2)]  # besides what listens and what wakes the loop
        with closing(Wire(bench.port)) as late:
            assert late.line() == b""
        assert "turned away" in caplog.text
        clients.pop().close()
        for _ in range(2):  # the first answer may be sent before the other one is forgotten
            clients[0].send(b"ME?\n")
            assert clients[0].line() == b"ME\n"
        bench.client()


@pytest.mark.parametrize("gone", [ConnectionResetError, ConnectionAbortedError])
def test_a_client_that_is_gone_before_it_is_taken_in_disturbs_nobody(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, gone: type[OSError]
) -> None:
    """Windows says so of one that has reset its connection, other systems of one that has aborted it."""
    polite = bench.client()
    accept = socket.socket._accept  # type: ignore[attr-defined]

    def reset(listener: socket.socket) -> None:
        os.close(accept(listener)[0])
        monkeypatch.undo()
        raise gone

    monkeypatch.setattr(socket.socket, "_accept", reset)
    with closing(Wire(bench.port)) as rude:
        assert rude.line() == b""
    polite.send(b"ME?\n")
    assert polite.line() == b"ME\n"
    bench.client()


def test_rubbish_is_executed_as_malformed(bench: Bench) -> None:
    client = bench.client()
    client.send(bytes(range(256)), b"\nASK?\n")
    assert client.line() == b"ASK\n"
    assert "malformed" in bench.toy.log


def test_a_block_reaches_the_instrument(bench: Bench) -> None:
    client = bench.client()
    client.send(b"DATA #43000", b"\n" * 3000, b"ASK?\n")
    assert client.line() == b"ASK\n"
    assert bench.toy.log == ["DATA", "3000", "ASK"]


def test_an_error_inside_an_instrument_ends_the_loop_loudly(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench()
    first, second = bench.client(), bench.client()
    second.send(b"FAIL\n")
    assert first.line() == b""
    assert second.line() == b""
    with pytest.raises(ZeroDivisionError, match="toy"):
        bench.close()
    (record,) = [record for record in caplog.records if record.levelno == logging.ERROR]
    assert record.exc_info
    bench.close()


def test_a_taken_port_is_named(bench: Bench) -> None:
    loop = Loop()
    with pytest.raises(OSError, match=f"127.0.0.1:{bench.port}.*choose another port"):
        serve_socket(loop, bench.toy, port=bench.port)
    loop.stop()
    loop.stop()


def test_one_that_refuses_does_so_where_the_system_ends_only_connections(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Linux ends a socket that listens; Windows and macOS say that it is not connected."""

    def shutdown(_listener: socket.socket, _how: int) -> None:
        raise OSError(errno.ENOTCONN, os.strerror(errno.ENOTCONN))

    client = bench.client()
    with monkeypatch.context() as patch:
        patch.setattr(socket.socket, "shutdown", shutdown)
        for _ in range(2):  # a fault may strike again
            bench.loop.refuse(bench.port)
    with pytest.raises(ConnectionRefusedError):
        Wire(bench.port)
    client.send(b"ME?\n")
    assert client.line() == b"ME\n"


def test_the_port_of_one_that_refuses_is_given_to_nobody_else() -> None:
    """The system would give it away: nothing listens there."""
    loop = Loop()
    refusing = loop.listen("127.0.0.1", 0, lambda _client: None)
    loop.refuse(refusing)
    other = loop.listen("127.0.0.1", refusing, lambda _client: None)
    assert other != refusing
    assert loop.ports == (refusing, other)
    loop.stop()
