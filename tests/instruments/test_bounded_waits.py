"""Peers that never come to an end, or never listen: every wait ends, by the clock of the link or by the length."""

import contextlib
import itertools
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO

import numpy as np
import pytest

from instruments.errors import InstrumentError, LinkError
from instruments.sessions import LEAST_RATE, PIECE
from instruments.visa import NoAnswer, VisaLink, scpi_error_queue

TIMEOUT_S = 0.3
HEADER = struct.Struct("!2sBBIQ")
"""Of a HiSLIP message: prologue, kind, control code, parameter, length of the payload (IVI-6.1, 6.1)."""
DATA, DATA_END = 6, 7
ANSWERS = {
    0: HEADER.pack(b"HS", 1, 0, 0x0100_0007, 0),  # Initialize: version 1.0, session 7
    4: HEADER.pack(b"HS", 5, 1, 0, 0),  # AsyncLock: granted
    8: HEADER.pack(b"HS", 9, 0, 0, 0),  # DeviceClearComplete
    15: HEADER.pack(b"HS", 16, 0, 0, 8) + (1 << 20).to_bytes(8, "big"),  # AsyncMaxMsgSize
    17: HEADER.pack(b"HS", 18, 0, 0, 0),  # AsyncInitialize
    19: HEADER.pack(b"HS", 23, 0, 0, 0),  # AsyncDeviceClear
}
"""What a server says to messages of these kinds."""
Peer = Callable[..., VisaLink]


class EndlessPeer:
    """Reads one line, says `first` once and `again`, if anything, until the connection ends; `deaf` does not read."""

    def __init__(self, first: bytes, again: bytes, *, deaf: bool = False) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"TCPIP0::127.0.0.1::{self._listener.getsockname()[1]}::SOCKET"
        self._said = first, again
        self._deaf = deaf
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._listener.close()

    def _serve(self) -> None:
        try:
            client, _ = self._listener.accept()
        except OSError:
            return
        with client:
            if self._deaf:
                self._ended.wait()
                return
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client.recv(1 << 16)
            first, again = self._said
            with contextlib.suppress(OSError):  # hung up, which is what ends it
                client.sendall(first)
                while again:
                    client.sendall(again)
            self._ended.wait()


@pytest.fixture
def peer(log: Any) -> Iterator[Peer]:
    opened: list[EndlessPeer | VisaLink] = []

    def connect(first: bytes, again: bytes, **options: bool) -> VisaLink:
        endless = EndlessPeer(first, again, **options)
        link = VisaLink(endless.address, name="peer", timeout_s=TIMEOUT_S, transcript=log)
        opened.extend((link, endless))
        return link

    yield connect
    for found in opened:
        found.close()


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], Iterator[float]]:
    """A clock that is later by so many seconds whenever somebody looks at it."""

    def install(step_s: float) -> Iterator[float]:
        ticks = itertools.count(0.0, step_s)
        monkeypatch.setattr("instruments.sessions.time.monotonic", lambda: next(ticks))
        return ticks

    return install


@pytest.mark.parametrize("dripped", [b"1", b'1"', b'""\n', b"1;"])
def test_a_line_that_drips_in_for_ever_is_one_wait(dripped: bytes, peer: Peer, looks: Any) -> None:
    link = peer(b'"', dripped)
    ticks = looks(0.01)
    with pytest.raises(NoAnswer, match=r"peer at TCPIP0.* did not answer in time \(at '\*IDN\?'\)"):
        link.query("*IDN?")
    assert next(ticks) < 2 * TIMEOUT_S, "each byte came in time, the line did not"


def test_a_longer_wait_is_one_wait_too(peer: Peer, looks: Any) -> None:
    link = peer(b"", b"1")
    ticks = looks(0.01)
    with pytest.raises(NoAnswer):
        link.query("*OPC?", timeout_s=5 * TIMEOUT_S)
    assert 5 * TIMEOUT_S < next(ticks) < 6 * TIMEOUT_S


def test_a_text_without_an_end_is_given_up_by_its_length(
    peer: Peer, looks: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("instruments.sessions.LONGEST_TEXT", 1 << 20)
    link = peer(b"", bytes(range(48, 58)) * 5000)
    looks(0.0)
    with pytest.raises(
        LinkError, match=r"cannot be understood \(more than 1048576 bytes came, which begin with b'0123"
    ):
        link.query("*IDN?")


def test_an_error_queue_without_an_end_is_not_read_for_ever(peer: Peer) -> None:
    """Unasked answers are noticed at the second question."""
    link = peer(2 * b'-100,"Command error"\n', b'-100,"Command error"\n')
    with pytest.raises(LinkError, match="came unasked"):
        scpi_error_queue(link)


def test_a_block_that_drips_in_for_ever_is_given_up_within_its_first_piece(peer: Peer, looks: Any) -> None:
    link = peer(b"#9100000000", b"1")
    ticks = looks(0.05)
    with pytest.raises(NoAnswer, match=r"did not answer in time \(at 'CURVe\?'\)"):
        link.read_block("CURVe?", np.empty(100_000_000, np.int8))
    assert next(ticks) < 2 * (TIMEOUT_S + PIECE / LEAST_RATE)


def test_the_head_of_a_block_that_drips_in_is_one_wait(peer: Peer, looks: Any) -> None:
    link = peer(b"1;", b"")
    ticks = looks(0.6 * TIMEOUT_S)
    with pytest.raises(NoAnswer):
        link.read_described_block(("WFMO?", "PT_Off?", "CURVe?"), np.empty(1, np.int8))
    assert next(ticks) < 2 * TIMEOUT_S, "each part of it came in time, the head did not"


STALE = 2
"""Message ids count by twos: that of a frame which belongs to the next message, not to the one that was sent."""


@pytest.mark.parametrize(
    ("said", "again", "message"),
    [
        ((DATA_END, STALE, 100, b"x" * 10), False, r"cannot be reached \(the instrument closed the connection\)"),
        ((DATA, STALE, 10, b"x" * 10), True, "did not answer in time"),
        ((DATA, 0, 0, b""), True, "did not answer in time"),
    ],
    ids=["cut off in a stale frame", "stale frames for ever", "empty frames for ever"],
)
def test_hislip_frames_come_to_an_end(said: tuple[int, int, int, bytes], again: bool, message: str, log: Any) -> None:
    with hislip_peer(said, again=again) as address:
        link = VisaLink(address, name="peer", timeout_s=TIMEOUT_S, transcript=log)
        with pytest.raises(LinkError, match=message):
            link.query("*IDN?")


@contextlib.contextmanager
def hislip_peer(said: tuple[int, int, int, bytes], *, again: bool) -> Iterator[str]:
    """A server that takes sessions and answers every message with a frame, of another length than it says perhaps.

    said: kind, how far the message's id is from that of the message, announced length, payload; again: without an end.
    """
    kind, off, length, payload = said

    def talk(client: socket.socket) -> None:
        with client, contextlib.suppress(OSError, EOFError):
            received = client.makefile("rb")
            while True:
                _, asked, _, number, size = HEADER.unpack(_exactly(received, HEADER.size))
                _exactly(received, size)
                if asked in ANSWERS:
                    client.sendall(ANSWERS[asked])
                if asked == DATA_END:
                    frame = HEADER.pack(b"HS", kind, 0, (number + off) % (1 << 32), length) + payload
                    client.sendall(frame)
                    while again:
                        client.sendall(frame)
                    return

    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                threading.Thread(target=talk, args=(listener.accept()[0],), daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=serve, daemon=True).start()
        yield f"TCPIP0::127.0.0.1::hislip0,{listener.getsockname()[1]}::INSTR"


def _exactly(received: BinaryIO, size: int) -> bytes:
    if len(found := received.read(size)) < size:
        raise EOFError
    return found


def test_a_long_block_has_a_wait_for_each_of_its_pieces(peer: Peer, looks: Any) -> None:
    """So slowly that it takes many timeouts in all."""
    pieces = 20
    link = peer(b"#8%08d" % (pieces * PIECE) + bytes(pieces * PIECE) + b"\n", b"")
    ticks = looks(0.9 * TIMEOUT_S / 4)
    link.read_block("CURVe?", np.empty(pieces * PIECE, np.int8))
    assert next(ticks) > 3 * TIMEOUT_S


def test_a_block_longer_than_any_is_not_waited_for(peer: Peer) -> None:
    link = peer(b"#F999999999999999", b"1")
    with pytest.raises(InstrumentError, match=r"CURVe\? gave 999999999999999 bytes, not 1: its settings were changed"):
        link.read_block("CURVe?", np.empty(1, np.int8))


def test_a_peer_that_does_not_read_is_not_written_to_for_ever(peer: Peer) -> None:
    link = peer(b"", b"", deaf=True)
    longer_than_all_buffers = "X" * (1 << 25)
    with pytest.raises(NoAnswer, match=r"peer at .* did not answer in time \(at 'X{100}'\)"):
        link.write(f"{'X' * 100},{longer_than_all_buffers}")


def test_a_peer_that_does_not_read_gets_no_block_either(peer: Peer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("instruments.sessions.LEAST_RATE", 10 * PIECE)
    link = peer(b"", b"", deaf=True)
    with pytest.raises(NoAnswer, match=r"did not answer in time \(at 'DATA '\)"):
        link.write_block("DATA ", np.zeros(1 << 25, np.int8))
