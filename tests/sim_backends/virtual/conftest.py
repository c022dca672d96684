"""Virtual instruments on one world, driven by messages, as a server would drive them."""

import pytest

from sim_backends.virtual import VirtualAwg70002a, VirtualInstrument
from tests.sim_backends.virtual.watched import Ask, Read, Watched, messages


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
