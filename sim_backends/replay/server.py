"""Recorded conversations served as instruments: the answer to every message is the recorded one, and no other is given.

Nothing here knows what the messages mean; bytes are compared with bytes. Each new connection to an instrument plays the
next of its recorded ones. At the first difference everything is closed, and `Replay.difference` says what it was.
"""

import itertools
import os
import socket
import struct
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import TracebackType
from typing import Self

from sim_backends.replay.differences import Difference, describe, first_difference, message_end
from sim_backends.servers.loop import Loop
from sim_backends.servers.socket import Channel

ROOM = 1 << 18  # bytes received at once

_NO_LINGER = struct.pack("ii" if os.name != "nt" else "hh", 1, 0)


@dataclass(frozen=True)
class Step:
    """One recorded message: `sent` by the client or to it. `read` gives its bytes."""

    sent: bool
    read: Callable[[], bytes]


@dataclass(frozen=True)
class Conversation:
    """One recorded connection. `cut`: the recording broke off in the middle of it."""

    steps: Sequence[Step]
    cut: bool = False


class Replay:
    """Serves conversations as long as the context lasts.

    Args:
        benches: Bench -> instrument -> its recorded connections, in the order in which they were opened. Benches are
            named in reports where there are several.
        host: The address to listen on.
        port_base: Instruments listen on `port_base`, `port_base` + 1, ... in their order; None: any free ports.
    """

    def __init__(
        self,
        benches: Mapping[str, Mapping[str, Sequence[Conversation]]],
        *,
        host: str = "127.0.0.1",
        port_base: int | None = None,
    ) -> None:
        self.resources: dict[str, dict[str, str]] = {}
        """Bench -> instrument -> VISA address."""
        self.played = 0
        self.difference: Difference | None = None
        self.ended = threading.Event()
        """Set when the whole recording was played and its connections were closed, or at the first difference."""
        conversations = [one for bench in benches.values() for found in bench.values() for one in found]
        self.total = sum(len(conversation.steps) for conversation in conversations)
        self._benches = benches
        self._unfinished = len(conversations)
        self._host = host
        self._port_base = port_base
        self._loop = Loop()
        self._players: list[_Player] = []

    @property
    def complete(self) -> bool:
        """Whether every message was played and none differed."""
        return self.difference is None and self.played == self.total

    @property
    def running(self) -> bool:
        """Whether clients are served; False again when the recording could not be read on."""
        return self._loop.running

    def start(self) -> None:
        """Begin to listen; every address in `resources` answers when this returns.

        Raises:
            OSError: A port is taken.
        """
        ports = itertools.repeat(0) if self._port_base is None else itertools.count(self._port_base)
        try:
            for bench, instruments in self._benches.items():
                self.resources[bench] = {}
                for instrument, conversations in instruments.items():
                    name = instrument if len(self._benches) == 1 else f"{bench}: {instrument}"
                    accept = partial(self._accept, name, iter(enumerate(conversations, 1)))
                    port = self._loop.listen(self._host, next(ports), accept)
                    self.resources[bench][instrument] = f"TCPIP0::{self._host}::{port}::SOCKET"
        except OSError:
            self._loop.stop()
            raise
        self._loop.start()

    def stop(self) -> None:
        """Read what clients have sent so far, then close every connection; waits until nothing runs any more."""
        self._loop.stop()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    def finished(self) -> None:
        """A recorded connection was played to its end and closed."""
        self._unfinished -= 1
        if self._unfinished == 0:
            self.ended.set()

    def differs(self, difference: Difference) -> None:
        """Keep the first difference and close everything."""
        if self.difference is None:
            self.difference = difference
        for player in self._players:
            player.close()
        self.ended.set()

    def _accept(self, instrument: str, recorded: Iterator[tuple[int, Conversation]], connection: socket.socket) -> None:
        over = self.difference is not None  # whoever comes now learns that at the first message
        number, conversation = (0, None) if over else next(recorded, (0, None))
        self._players.append(_Player(self, self._loop, instrument, number, conversation, connection))


class _Player:
    """One connection of a client, and the recorded one that it should repeat; None: there is none any more."""

    def __init__(
        self,
        replay: Replay,
        loop: Loop,
        instrument: str,
        number: int,
        conversation: Conversation | None,
        connection: socket.socket,
    ) -> None:
        self._replay = replay
        self._instrument = instrument
        self._number = number
        self._conversation = conversation
        self._steps = iter(conversation.steps if conversation else ())
        self._expected = b""  # the message under way; b"": none is left
        self._message = 0
        self._pending = bytearray()
        self._same = 0  # bytes of `_pending` that are as expected
        self._room = memoryview(bytearray(ROOM))
        self._connection = connection
        self._over = False
        # A reply that cannot be sent is no difference by itself: the end of the stream follows, and is judged.
        self._channel = Channel(loop.selector, connection, readable=self._readable, lost=lambda: None)
        self._proceed()

    def close(self) -> None:
        """Break the connection."""
        if not self._over:
            self._over = True
            _reset(self._connection)
            self._channel.close()

    def _proceed(self) -> None:
        """Send the recorded replies, as far as the next message of the client."""
        expected = self._expected
        self._expected = b""
        for step in self._steps:
            if step.sent:
                self._expected = step.read()
                self._message += 1
                return
            expected = b""
            self._channel.send([step.read()])
            self._replay.played += 1
        if expected and self._conversation is not None and self._conversation.cut:
            self._differ(expected)  # its reply was lost with the rest of the recording
        self._message += 1

    def _readable(self) -> None:
        count = self._channel.receive(self._room)
        if count == 0:
            self._end()
        elif count:
            self._pending += self._room[:count]
            self._compare()

    def _compare(self) -> None:
        while self._pending and not self._over:
            expected = self._expected
            stop = min(len(expected), len(self._pending))
            if not expected or self._pending[self._same : stop] != expected[self._same : stop]:
                end = message_end(self._pending, expected[-1:] or b"\n")
                if end is not None:
                    self._differ(bytes(self._pending[:end]))
                return
            self._same = stop
            if stop < len(expected):
                return
            del self._pending[:stop]
            self._same = 0
            self._replay.played += 1
            self._proceed()

    def _end(self) -> None:
        if self._over:
            return
        if self._pending or self._expected:
            self._differ(bytes(self._pending))
            return
        self._over = True
        self._channel.close()
        if self._conversation is not None:
            self._replay.finished()

    def _differ(self, sent: bytes) -> None:
        if self._conversation is None:
            expected = "no further connection"
        elif self._expected:
            expected = describe(self._expected)
        elif self._conversation.cut:
            expected = "nothing more, because the recording breaks off here"
        else:
            expected = "nothing more"
        found = describe(sent) if sent else "the end of the connection"
        found += first_difference(self._expected, sent)
        self._replay.differs(Difference(self._instrument, self._number, self._message, expected, found))


def _reset(connection: socket.socket) -> None:
    """Let the connection end in a reset, which clients notice at once; many take an orderly end for a slow reply."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
