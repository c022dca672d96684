"""The one thread that reads what every client of the simulated bench sends, and in which every virtual instrument runs.

What an instrument does depends on the order in which messages reach it, and messages of several clients reach the
sockets in an order that nobody controls. The loop makes the order as firm as it can: it reads all that was sent before
anything is executed, executes settings before queries, and answers queries one by one, in the order in which clients
connected.
"""

import errno
import logging
import os
import selectors
import socket
import sys
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, ExitStack, suppress
from itertools import count
from typing import NamedTuple, Protocol
from weakref import WeakSet

from sim_backends.scpi.messages import Chunk, Message, MessageReader, Unit
from sim_backends.servers.disturbed import Disturbed
from sim_backends.world.receivers import CardFull
from sim_backends.world.world import ClockEnded

logger = logging.getLogger(__name__)

MOST_WAITING = 256  # messages of one client; more are left on its side of the wire
MOST_IN_VAIN = 16  # rounds of reading that complete no message; others are answered then
MOST_SOCKETS = 512 if sys.platform == "win32" else sys.maxsize  # which `select` takes there; other systems have better
FULL = (errno.EMFILE, errno.ENFILE)
TRIGGER = Message((Unit("*TRG", query=False, arguments=()),))
"""What a trigger of the transport's own means."""

Execution = Generator[list[Chunk] | None, None, list[Chunk] | Disturbed]


class Instrument(Protocol):
    """What the loop needs of a virtual instrument."""

    def run(self, message: Message) -> Execution:
        """Execute `message`: yields while it is blocked, returns the reply without its terminator, [] for none.

        A reply without end comes in parts: each is yielded, [] while there is none. It ends when the client sends
        something.
        """

    def listens(self, begun: bytes) -> bool:
        """Whether it goes on to receive a message that has begun with `begun` and is inside a block."""

    def connection(self) -> AbstractContextManager["Instrument"]:
        """The instrument as one client has it, entered when it comes and left when all it has sent is executed."""

    def clear(self) -> None:
        """Drop pending output and blocked execution (device clear)."""

    def status_byte(self) -> int:
        """The status byte of IEEE 488.2, as a serial poll reads it."""


class Reader(Protocol):
    """What cuts the bytes of a connection into messages; see `MessageReader`, whose words these are."""

    begun: bytes

    def buffer(self) -> memoryview:
        """Where the next bytes belong; never empty."""

    def received(self, count: int) -> list[Message]:
        """Take over `count` bytes written to the start of `buffer()`; returns the messages they complete."""

    def end(self) -> list[Message]:
        """End the present message here; the messages that this completes."""

    def clear(self) -> None:
        """Forget everything that has not been handed out."""


class Request(NamedTuple):
    """A message that waits to be executed."""

    arrival: int
    message: Message
    tag: int  # what the transport needs again when the reply is sent


class Client(ABC):
    """One client of one instrument: the messages it has sent and the one that is blocked, if any.

    Its transport makes it and joins it to the loop.
    """

    def __init__(self, loop: "Loop", instrument: Instrument, reader: Reader | None = None) -> None:
        self.loop = loop
        self.connection = ExitStack()
        self.instrument = self.connection.enter_context(instrument.connection())
        self.reader: Reader = reader or MessageReader()
        self.number = 0  # its rank among clients with queries at the same time; the loop gives it
        self.waiting: deque[Request] = deque()
        self.blocked: tuple[Execution, int] | None = None
        self.part: list[Chunk] | None = None  # what `blocked` has yielded

    def receive(self, size: int, tag: int = 0) -> None:
        """Take `size` more bytes in the reader's buffer, and queue the messages that they complete."""
        messages = self.reader.received(size)
        self.loop.heard = self.loop.heard or bool(self.reader.begun)
        if self.reader.begun and not self.instrument.listens(self.reader.begun):
            self.hang_up()
        self.deliver(messages, tag)

    def deliver(self, messages: list[Message], tag: int = 0) -> None:
        """Queue `messages` for execution."""
        for message in messages:
            self.waiting.append(Request(next(self.loop.arrivals), message, tag))
            self.loop.heard = True
        if len(self.waiting) >= MOST_WAITING:
            self.pace()

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
        """End the connection at once: what was not sent is dropped; what was received is still executed."""

    @abstractmethod
    def pace(self) -> None:
        """Read on, unless too many messages are waiting; called when one was executed, or is blocked."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection."""


class Loop:
    """Listens, reads, executes, replies; in one thread between `start` and `stop`."""

    def __init__(self) -> None:
        self.selector = selectors.DefaultSelector()
        self._clients: list[Client] = []
        self._listeners: dict[int, socket.socket] = {}
        self._connections: WeakSet[socket.socket] = WeakSet()
        self._leaving: list[Client] = []
        self._later: list[Callable[[], None]] = []
        self.arrivals = count(1)  # the rank of a message among all messages
        self.heard = False  # a client has sent a message, or more of a block
        self._spare: int | None = os.open(os.devnull, os.O_RDONLY)  # what the system has left when it is full
        self._numbers = count(1)
        self._stopping = False
        self._failure: BaseException | None = None
        self._alarm, self._bell = socket.socketpair()
        self.selector.register(self._alarm, selectors.EVENT_READ, self._woken)
        self._thread = threading.Thread(target=self._run, name="simulated bench", daemon=True)

    def listen(self, host: str, port: int, accept: Callable[[socket.socket], object]) -> int:
        """Call `accept` with every connection to `port` (0: any free one) of `host`; before `start`. Returns the port.

        Raises:
            OSError: The port is taken or the address is not one of this machine.
        """
        try:
            listener = socket.create_server((host, port))
        except OSError as error:
            reason = f"cannot listen on {host}:{port} ({error.strerror}): choose another port or address"
            raise OSError(error.errno, reason) from error
        port = int(listener.getsockname()[1])
        if port in self._listeners:  # one that refuses does not keep the system from giving its port away
            with listener:
                return self.listen(host, 0, accept)
        listener.settimeout(0)
        self.selector.register(listener, selectors.EVENT_READ, lambda _events: self._accept(listener, accept))
        self._listeners[port] = listener
        return port

    @property
    def ports(self) -> tuple[int, ...]:
        """The ports that are listened to, those that refuse included."""
        return tuple(self._listeners)

    def refuse(self, port: int) -> None:
        """Refuse new connections to `port` from now on; nothing else of this loop gets it."""
        listener = self._listeners[port]
        with suppress(KeyError, ValueError):  # it does so already
            self.selector.unregister(listener)
            try:
                listener.shutdown(socket.SHUT_RDWR)
            except OSError:  # Windows and macOS shut down only what is connected
                listener.close()

    @property
    def running(self) -> bool:
        """Whether the thread is at work."""
        return self._thread.is_alive()

    @property
    def failed(self) -> bool:
        """Whether an error in a virtual instrument has ended it."""
        return self._failure is not None

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def stop(self) -> None:
        """End serving and close every connection; may be called again.

        Raises:
            BaseException: Whatever a virtual instrument raised: that ended the loop.
        """
        if self._thread.is_alive():
            self._stopping = True
            with suppress(OSError):  # the loop has just failed and closed its end
                self._bell.send(b".")
            self._thread.join()
        self._close()
        self._bell.close()
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def join(self, client: Client) -> None:
        """Take in a client, and give it its number."""
        client.number = next(self._numbers)
        self._clients.append(client)

    def leave(self, client: Client) -> None:
        """The client sends nothing any more: execute what it has sent, then close it."""
        if client.blocked:
            client.abandon()
        self._leaving.append(client)
        self._bid_farewell(client)

    def when_idle(self, call: Callable[[], None]) -> None:
        """Call once, as soon as everything that can be executed is executed."""
        self._later.append(call)

    def _run(self) -> None:
        try:
            self._serve()
        except (CardFull, ClockEnded) as end:  # of which the traceback says no more
            self._failure = end
        except BaseException as failure:  # an error of a virtual instrument: for `stop` to raise
            logger.exception("the simulated bench failed and closes its connections")
            self._failure = failure
        finally:
            self._close()

    def _serve(self) -> None:
        while not self._stopping:  # the bell may have rung between two queries
            self._poll(0 if any(client.part and not client.sending for client in self._clients) else None)
            self._read_everything()
            self._retry_blocked()  # a device clear may have set them free
            self._execute_everything()
            while self._later:
                later, self._later = self._later, []
                for call in later:
                    call()
                self._execute_everything()
            self._close_leaving()
        self._read_everything()  # what was sent before `stop`

    def _poll(self, timeout: float | None) -> bool:
        """Read what is there (None: wait for it) and send on where there is room; returns whether anything happened."""
        events = self.selector.select(timeout)
        for key, mask in events:
            key.data(mask)
        return bool(events)

    def _read_everything(self) -> None:
        """All that was sent; but who sends without an end and says nothing keeps nobody waiting."""
        in_vain = 0
        while in_vain < MOST_IN_VAIN and self._poll(0):
            in_vain = 0 if self.heard else in_vain + 1
            self.heard = False

    def _execute_everything(self) -> None:
        everything_read = True
        while (client := self._next()) is not None:
            if client.waiting[0].message.queries and not everything_read:
                self._read_everything()  # settings that came in the meantime go first
                everything_read = True
                continue
            self._execute(client)
            everything_read = False

    def _next(self) -> Client | None:
        """Whose turn it is: settings in the order of arrival, then queries in the order of the clients."""
        chosen: Client | None = None
        rank = (True, 0)
        for client in self._clients:
            if not client.waiting or client.blocked or client.held_off():
                continue
            head = client.waiting[0]
            queries = head.message.queries
            if queries and client.sending:
                continue  # who does not fetch a reply gets no other
            candidate = (queries, client.number if queries else head.arrival)
            if chosen is None or candidate < rank:
                chosen, rank = client, candidate
        return chosen

    def _execute(self, client: Client) -> None:
        request = client.waiting.popleft()
        client.blocked = (client.instrument.run(request.message), request.tag)
        if not self._advance(client):
            client.pace()
        self._bid_farewell(client)
        self._retry_blocked()

    def _bid_farewell(self, client: Client) -> None:
        """What others send after the last message of a client that leaves, they send to an instrument without it."""
        if client in self._leaving and not client.waiting and not client.blocked:
            client.connection.close()

    def _retry_blocked(self) -> None:
        while any(self._advance(client) for client in self._clients if client.blocked):
            pass  # what one execution set free may set others free

    def _advance(self, client: Client) -> bool:
        """Execute on what a client is blocked in; returns whether that is now complete."""
        if client.blocked is None:
            return False
        execution, tag = client.blocked
        if client.part is not None and client.waiting:
            client.drop()
            client.pace()
            return True
        if client.part and client.sending:
            return False
        try:
            client.part = next(execution)
        except StopIteration as end:
            client.blocked = client.part = None
            if isinstance(end.value, Disturbed):
                if end.value.hangs_up:
                    client.waiting.clear()  # it was sent after the message at which the link ends
                client.disturb(end.value, tag)
            elif end.value:
                client.reply(end.value, tag)
            client.pace()
            return True
        if client.part:
            client.reply(client.part, tag)
        return False

    def _close_leaving(self) -> None:
        for client in list(self._leaving):
            if client.blocked:
                client.abandon()
            if not client.waiting and not client.sending:
                self._bid_farewell(client)
                self._leaving.remove(client)
                self._clients.remove(client)
                client.close()

    def _accept(self, listener: socket.socket, accept: Callable[[socket.socket], object]) -> None:
        try:
            connection, _ = listener.accept()
        except (BlockingIOError, ConnectionError):
            return  # gone again
        except OSError as error:
            if error.errno not in FULL:
                raise
            self._turn_away(listener)
            return
        if len(self._listeners) + sum(one.fileno() >= 0 for one in self._connections) + 1 >= MOST_SOCKETS:
            logger.warning("a client is turned away: too many connections are open")
            connection.close()
            return
        self._connections.add(connection)
        accept(connection)

    def _turn_away(self, listener: socket.socket) -> None:
        """End a connection for which the system has no room: it would be reported for ever."""
        if self._spare is not None:
            os.close(self._spare)
            self._spare = None
        with suppress(OSError):
            listener.accept()[0].close()
            logger.warning("a client is turned away: too many files and connections are open (see ulimit -n)")
        with suppress(OSError):
            self._spare = os.open(os.devnull, os.O_RDONLY)

    def _woken(self, _events: int) -> None:
        self._alarm.recv(16)

    def _close(self) -> None:
        for client in self._clients:
            client.abandon()
            client.close()
        self._clients.clear()
        self._leaving.clear()
        for watched in list((self.selector.get_map() or {}).values()):
            if isinstance(watched.fileobj, socket.socket):  # a listener, the alarm, a connection without a client yet
                watched.fileobj.close()
        for listener in self._listeners.values():  # those that refuse are not watched
            listener.close()
        self.selector.close()
        if self._spare is not None:
            os.close(self._spare)
            self._spare = None
