"""Every transport, as stock pyvisa-py sees them: one instrument, several clients."""

import gc
import struct
from collections.abc import Generator, Iterator
from contextlib import AbstractContextManager, nullcontext

import numpy as np
import pytest
from pyvisa.resources import MessageBasedResource

from sim_backends.scpi.messages import Chunk, Message
from sim_backends.servers.hislip import serve_hislip
from sim_backends.servers.loop import Instrument, Loop
from sim_backends.servers.socket import serve_socket
from sim_backends.servers.vxi11 import serve_vxi11
from tests.sim_backends.servers.clients import StockClients

TRANSPORTS = ["socket", "hislip", "vxi11"]
FRAMED = ["hislip", "vxi11"]


class Memory:
    """An instrument with one block of memory and a status byte."""

    def __init__(self) -> None:
        self.block = b""
        self.triggers = 0
        self.clears = 0
        self.open = True

    def run(self, message: Message) -> Generator[None, None, list[Chunk]]:
        replies: list[Chunk] = []
        for unit in message.units:
            match unit.header:
                case "BLOCK" if unit.query:
                    replies += [f"#9{len(self.block):09d}".encode(), memoryview(self.block)]
                case "BLOCK":
                    assert isinstance(unit.arguments[0], memoryview)
                    self.block = bytes(unit.arguments[0])
                case "*TRG":
                    self.triggers += 1
                case "OPEN":
                    self.open = unit.arguments[0] == "1"
                case "*OPC":
                    while not self.open:
                        yield
                    replies.append(b"1")
                case _ if unit.query:
                    replies.append(f"{unit.header},{self.triggers}".encode())
        return replies

    def clear(self) -> None:
        self.clears += 1

    def status_byte(self) -> int:
        return 4

    def listens(self, begun: bytes) -> bool:
        return True

    def connection(self) -> AbstractContextManager[Instrument]:
        return nullcontext(self)


class Server:
    def __init__(self) -> None:
        self.memory = Memory()
        self.loop = Loop()
        self.resources = {
            "socket": f"TCPIP0::127.0.0.1::{serve_socket(self.loop, self.memory)}::SOCKET",
            "hislip": f"TCPIP0::127.0.0.1::hislip0,{serve_hislip(self.loop, self.memory)}::INSTR",
            "vxi11": f"TCPIP0::127.0.0.1,{serve_vxi11(self.loop, self.memory)}::inst0::INSTR",
        }
        self.loop.start()
        self._clients = StockClients()

    def open(self, transport: str) -> MessageBasedResource:
        return self._clients.open(self.resources[transport])

    def close(self) -> None:
        self._clients.close()
        self.loop.stop()


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.close()
    gc.collect()  # a socket left open is reported here


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_text(server: Server, transport: str) -> None:
    client = server.open(transport)
    assert client.query("*IDN?") == "*IDN,0"
    client.write("*TRG")
    assert client.query("*IDN?;*OPC?") == "*IDN,11"
    client.write_termination = "\r\n"
    assert client.query("*OPC?") == "1"


@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("size", [0, 1, 1000, 3_000_001])
def test_blocks_of_any_bytes(server: Server, transport: str, size: int) -> None:
    client = server.open(transport)
    samples = np.random.default_rng(1).integers(0, 256, size, dtype=np.uint8).tobytes()
    client.write_binary_values("BLOCK ", samples, datatype="B")
    assert client.query("*OPC?") == "1"
    assert server.memory.block == samples
    if size:
        assert client.query_binary_values("BLOCK?", datatype="B", container=bytes, chunk_size=1 << 20) == samples


@pytest.mark.parametrize("transport", FRAMED)
def test_an_unterminated_message_ends_with_its_transport_message(server: Server, transport: str) -> None:
    client = server.open(transport)
    client.write_raw(b"*IDN?")
    assert client.read() == "*IDN,0"


def test_both_transports_reach_one_instrument(server: Server) -> None:
    by_socket, by_hislip, other = server.open("socket"), server.open("hislip"), server.open("hislip")
    by_socket.write("*TRG")
    assert by_socket.query("*OPC?") == "1"
    by_hislip.visalib.sessions[by_hislip.session].interface.trigger()  # type: ignore[attr-defined]
    assert by_hislip.query("*OPC?") == "1"
    assert other.query("*IDN?") == by_socket.query("*IDN?") == "*IDN,2"
    other.close()
    assert by_hislip.query("*IDN?") == "*IDN,2"


@pytest.mark.parametrize("transport", FRAMED)
def test_status_byte_says_whether_a_reply_waits(server: Server, transport: str) -> None:
    client = server.open(transport)
    assert client.read_stb() == 4
    client.write("*IDN?")
    assert client.read_stb() == 4 + 16
    assert client.read() == "*IDN,0"
    assert client.read_stb() == 4


@pytest.mark.parametrize("transport", FRAMED)
def test_device_clear_ends_a_blocked_query(server: Server, transport: str) -> None:
    client, other = server.open(transport), server.open(transport)
    client.write("OPEN 0")
    client.write("*OPC?")
    assert client.read_stb() == 4
    client.clear()
    assert server.memory.clears == 1
    assert client.query("*IDN?") == "*IDN,0"
    other.write("OPEN 1")
    assert client.query("*OPC?") == "1"


def test_a_client_after_the_other(server: Server) -> None:
    for _ in range(20):
        for transport in TRANSPORTS:
            client = server.open(transport)
            assert client.query("*IDN?") == "*IDN,0"
            client.close()


def test_a_message_size_the_client_asks_for(server: Server) -> None:
    client = server.open("hislip")
    session = client.visalib.sessions[client.session]  # type: ignore[attr-defined]
    session.interface.max_msg_size = 100
    server.memory.block = struct.pack("1000H", *range(1000))
    assert client.query_binary_values("BLOCK?", datatype="H") == list(range(1000))
