"""The replay at the socket: exact answers, the first difference, and how it is told."""

import socket
from collections.abc import Sequence
from functools import partial

import pytest

from sim_backends.replay.server import Conversation, Replay, Step


def conversation(*messages: tuple[str, bytes], cut: bool = False) -> Conversation:
    return Conversation(tuple(Step(way == ">", partial(bytes, text)) for way, text in messages), cut)


def connect(replay: Replay, instrument: str = "awg", bench: str = "bench") -> socket.socket:
    port = int(replay.resources[bench][instrument].split("::")[2])
    return socket.create_connection(("127.0.0.1", port), timeout=10)


def played(recorded: Sequence[Conversation], *clients: Sequence[bytes]) -> tuple[list[bytes], Replay]:
    """What each client receives until the end, and the replay after it."""
    answers = []
    with Replay({"bench": {"awg": recorded}}) as replay:
        for messages in clients:
            with connect(replay) as client:
                received = b""
                try:
                    for message in messages:
                        client.sendall(message)
                    client.shutdown(socket.SHUT_WR)
                    while chunk := client.recv(65536):
                        received += chunk
                except OSError:
                    pass
                answers.append(received)
        assert replay.ended.wait(10)
    return answers, replay


IDENTITY = (">", b"*IDN?\n"), ("<", b"TEKTRONIX,AWG70002A,1,2\n")
SETTING = (">", b"CLOCk:SRATe 2.5E10\n")
BLOCK = (">", b"DATA #15" + b"abcde" + b"\n")


def test_the_recorded_answers_come_back() -> None:
    answers, replay = played(
        [conversation(*IDENTITY), conversation(SETTING, BLOCK, *IDENTITY)],
        [b"*IDN?\n"],
        [b"CLOCk:SRATe 2.5E10\nDATA #15ab", b"cde", b"\n*ID", b"N?\n"],
    )
    assert answers == [IDENTITY[1][1], IDENTITY[1][1]]
    assert replay.complete
    assert (replay.played, replay.total) == (6, 6)


@pytest.mark.parametrize(
    ("recorded", "sent", "told"),
    [
        (conversation(*IDENTITY), b"*OPC?\n", "message 1 of connection 1: expected '*IDN?', was sent '*OPC?'"),
        (
            conversation(SETTING, *IDENTITY),
            SETTING[1] + b"*IDN",
            "message 2 of connection 1: expected '*IDN?', was sent '*IDN'",
        ),
        (conversation(SETTING), b"", "expected 'CLOCk:SRATe 2.5E10', was sent the end of the connection"),
        (
            conversation(*IDENTITY),
            b"*IDN?\n*RST\n",
            "message 2 of connection 1: expected nothing more, was sent '*RST'",
        ),
        (conversation(BLOCK), b"DATA #15abXde\n", "first differing byte of the block 2: 0x63 expected, 0x58 sent"),
        (conversation(BLOCK), b"DATA #13abc\n", "the blocks agree in their first 3 bytes"),
        (conversation(BLOCK), b"DATA #15ab\nde\n", "was sent 'DATA ' #<5 bytes, crc32"),
        (conversation(IDENTITY[0], cut=True), b"*IDN?\n", "nothing more, because the recording breaks off here"),
    ],
)
def test_the_first_difference_is_told(recorded: Conversation, sent: bytes, told: str) -> None:
    _, replay = played([recorded], [sent])
    assert not replay.complete
    assert told in str(replay.difference)
    assert "\n" not in str(replay.difference)


def test_a_connection_too_many() -> None:
    with Replay({"bench": {"awg": [], "scope": [conversation(*IDENTITY)]}}) as replay, connect(replay) as client:
        client.sendall(b"*IDN?\n")
        assert replay.ended.wait(10)
        assert "expected no further connection, was sent '*IDN?'" in str(replay.difference)
        with connect(replay, "scope") as late:
            late.sendall(b"*IDN?\n")
            with pytest.raises(ConnectionResetError):
                late.recv(10)
        assert replay.played == 0


def test_a_client_learns_at_once() -> None:
    with Replay({"bench": {"awg": [conversation(*IDENTITY)]}}) as replay, connect(replay) as client:
        client.sendall(b"*OPC?\n")
        with pytest.raises(ConnectionResetError):
            client.recv(10)


def test_a_taken_port_is_told() -> None:
    with Replay({"bench": {"awg": []}}) as replay:
        port = int(replay.resources["bench"]["awg"].split("::")[2])
        with pytest.raises(OSError, match="cannot listen"):
            Replay({"bench": {"scope": []}}, port_base=port).start()


def test_benches_are_played_side_by_side_and_named_where_there_are_several() -> None:
    benches = {name: {"awg": [conversation(SETTING, *IDENTITY)]} for name in ("one", "two")}
    with Replay(benches) as replay, connect(replay, bench="two") as second, connect(replay, bench="one") as first:
        for client in (first, second):
            client.sendall(SETTING[1] + IDENTITY[0][1])
        for client in (second, first):
            assert client.recv(100) == IDENTITY[1][1]
        second.sendall(b"*RST\n")
        assert replay.ended.wait(10)
    assert str(replay.difference).startswith("two: awg: message 3 of connection 1: expected nothing more, was sent")


def test_what_was_sent_before_the_stop_is_heard() -> None:
    with Replay({"bench": {"awg": [conversation(SETTING, SETTING)]}}) as replay:
        with connect(replay) as client:
            client.sendall(SETTING[1] * 2)
        replay.stop()
        assert replay.complete
