"""What the loop knows of a client and of an instrument."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Generator
from typing import TYPE_CHECKING, NamedTuple, Protocol

from sim_backends.scpi.messages import Message, MessageReader
from sim_backends.servers.channel import Chunk
from sim_backends.servers.disturbed import Disturbed

if TYPE_CHECKING:
    from sim_backends.servers.loop import Loop

MOST_WAITING = 256  # messages of one client; more are left on its side of the wire

Execution = Generator[list[Chunk] | None, None, list[Chunk] | Disturbed]


class Instrument(Protocol):
    """What the loop asks of a virtual instrument."""

    def run(self, message: Message) -> Execution:
        """Execute `message`: yields while it is blocked, returns the reply without its terminator, [] for none.

        A reply without end comes in parts: each is yielded, [] while there is none. It ends when the client says
        something.
        """

    def listens(self, begun: bytes) -> bool:
        """Whether it goes on to receive a message that has begun with `begun` and is inside a block."""

    def clear(self) -> None:
        """Drop pending output and blocked execution (device clear)."""

    def status_byte(self) -> int:
        """The status byte of IEEE 488.2, as a serial poll reads it."""


class Request(NamedTuple):
    """A message that waits to be executed."""

    arrival: int
    message: Message
    queries: bool
    tag: int  # what the transport wants to know again when the reply is sent


class Client(ABC):
    """One client of one instrument: the messages it has sent and the one that is blocked, if any."""

    def __init__(self, loop: "Loop", instrument: Instrument) -> None:
        self.loop = loop
        self.instrument = instrument
        self.reader = MessageReader()
        self.waiting: deque[Request] = deque()
        self.blocked: tuple[Execution, int] | None = None
        self.part: list[Chunk] | None = None  # what `blocked` has yielded
        self.number = loop.join(self)

    def deliver(self, messages: list[Message], tag: int = 0) -> None:
        """Queue `messages` for execution."""
        for message in messages:
            self.waiting.append(Request(self.loop.count_arrival(), message, message.queries, tag))

    def take(self, count: int) -> list[Message]:
        """The messages that `count` more bytes in the reader's buffer complete."""
        messages = self.reader.received(count)
        if self.reader.begun and not self.instrument.listens(self.reader.begun):
            self.hang_up()
        return messages

    def abandon(self) -> None:
        """Forget what is waiting and what is blocked."""
        self.waiting.clear()
        self.drop()

    def drop(self) -> None:
        """Forget what is blocked."""
        self.part = None
        if self.blocked:
            self.blocked[0].close()
            self.blocked = None

    def held_off(self) -> bool:
        """Whether this client must wait although it has sent something (another one holds the lock)."""
        return False

    @property
    @abstractmethod
    def sending(self) -> bool:
        """Whether a reply is still on its way."""

    @abstractmethod
    def reply(self, chunks: list[Chunk], tag: int) -> None:
        """Send the reply to the request that came with `tag`."""

    @abstractmethod
    def disturb(self, disturbed: Disturbed, tag: int) -> None:
        """Send what a fault has made of the reply to the request that came with `tag`."""

    @abstractmethod
    def hang_up(self) -> None:
        """End the connection at once: what was not sent is dropped; what was heard is still executed."""

    @abstractmethod
    def resume(self) -> None:
        """Called when a message was executed, or is blocked: read on, if too much was waiting to do so before."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection."""
