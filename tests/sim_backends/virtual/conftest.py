"""Virtual instruments on one world, driven by messages, as a server would drive them."""

import pytest

from sim_backends.scpi.messages import Message, MessageReader
from sim_backends.virtual import VirtualAwg70002a, VirtualInstrument
from tests.sim_backends.virtual.watched import Ask, Read, Watched


def messages(text: str | bytes) -> list[Message]:
    stream = (text.encode("latin-1") if isinstance(text, str) else text) + b"\n"
    reader, found = MessageReader(), []
    while stream:
        room = reader.buffer()
        count = min(len(room), len(stream))
        room[:count] = stream[:count]
        stream = stream[count:]
        found += reader.received(count)
    return found


@pytest.fixture
def read() -> Read:
    """Messages as a connection would deliver them."""
    return messages


@pytest.fixture
def ask() -> Ask:
    """Send a text to an instrument; its replies, joined. A message that blocks raises."""

    def asked(instrument: VirtualInstrument, text: str | bytes) -> bytes:
        reply = b""
        for message in messages(text):
            execution = instrument.run(message)
            try:
                next(execution)
            except StopIteration as end:
                reply += b"".join(end.value)
            else:
                raise BlockingIOError(text)
        return reply

    return asked


@pytest.fixture
def world() -> Watched:
    return Watched()


@pytest.fixture
def awg(world: Watched) -> VirtualAwg70002a:
    return VirtualAwg70002a(world)
