"""A connection that never waits, where the platform gathers chunks and where it does not."""

import selectors
import socket

import pytest

from sim_backends.servers.socket import Channel


@pytest.mark.parametrize("gathers", [True, False])
def test_chunks_arrive_in_order_however_slowly_they_are_read(gathers: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim_backends.servers.socket._GATHERS", gathers and hasattr(socket.socket, "sendmsg"))
    chunks = [bytes([i % 256]) * size for i, size in enumerate([1, 0, 3, 2_000_000] * 40)]
    with selectors.DefaultSelector() as selector, socket.create_server(("127.0.0.1", 0)) as listener:
        reader = socket.create_connection(listener.getsockname())
        channel = Channel(selector, listener.accept()[0], readable=lambda: None, lost=lambda: None)
        channel.send(chunks)
        assert channel.unsent
        received = bytearray()
        while channel.unsent:
            received += reader.recv(1 << 20)
            for key, events in selector.select(0):
                key.data(events)
        channel.close()
        while more := reader.recv(1 << 20):
            received += more
        reader.close()
    assert received == b"".join(chunks)


def test_a_lost_connection_is_reported_once_and_swallows_the_rest() -> None:
    lost: list[bool] = []
    with selectors.DefaultSelector() as selector, socket.create_server(("127.0.0.1", 0)) as listener:
        reader = socket.create_connection(listener.getsockname())
        channel = Channel(selector, listener.accept()[0], readable=lambda: None, lost=lambda: lost.append(True))
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        reader.close()
        for _ in range(5):
            channel.send([b"anybody there?"])
        assert lost == [True]
        assert not channel.unsent
        assert channel.receive(memoryview(bytearray(10))) == 0
        channel.close()
        channel.send([b"no"])
        assert not channel.unsent
