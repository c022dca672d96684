"""One HiSLIP session: what its client sends on both connections, and what it gets (IVI-6.1, chapters 4 to 6).

A reply carries the identifier of the message that asked for it; clients drop replies that do not.
"""

import struct
from collections.abc import Callable

from sim_backends.scpi.messages import Chunk
from sim_backends.scpi.status import MESSAGE_AVAILABLE
from sim_backends.servers.disturbed import Disturbed, pieces
from sim_backends.servers.frames import Fatal, Frame, Kind, data_frames, disturbed_frames, fatal_error, header
from sim_backends.servers.locks import Locks
from sim_backends.servers.loop import MOST_WAITING, TRIGGER, Client, Instrument, Loop
from sim_backends.servers.socket import Channel

LARGEST_MESSAGE = 1 << 20  # bytes, header included: what clients propose as well
REPLY_DELIVERED = 1  # control bit of a client that has read a reply to its end
LOCK_REQUESTED = 1  # control code of AsyncLock; 0 releases


class Session(Client):
    """A client on HiSLIP.

    Args:
        loop: Where its messages are executed.
        instrument: By which.
        identifier: The number by which its second connection names it.
        channel: The synchronous connection; the asynchronous one is assigned when it comes.
        locks: Who may use the instrument.
        ended: Called when the client is gone.
    """

    def __init__(
        self,
        loop: Loop,
        instrument: Instrument,
        identifier: int,
        channel: Channel,
        locks: "Locks[Session]",
        *,
        ended: Callable[[], object],
    ) -> None:
        super().__init__(loop, instrument)
        self.identifier = identifier
        self.asynchronous: Channel | None = None
        self._channel = channel
        self._locks = locks
        self._forget = ended
        self._largest = LARGEST_MESSAGE  # that the client takes
        self._clearing = False
        self._available = False  # a reply was sent and not yet read to its end
        self._ended = False
        self._late = b""

    def synchronous_handlers(self) -> dict[int, Callable[[Frame, bytes], None]]:
        """What to do with the messages of the synchronous connection."""
        return {
            Kind.DATA: self._data_complete,
            Kind.DATA_END: self._data_complete,
            Kind.TRIGGER: self._trigger,
            Kind.DEVICE_CLEAR_COMPLETE: self._complete_clear,
            Kind.ERROR: self._ignore,
            Kind.FATAL_ERROR: self._give_up,
        }

    def asynchronous_handlers(self) -> dict[int, Callable[[Frame, bytes], None]]:
        """What to do with the messages of the asynchronous connection."""
        return {
            Kind.ASYNC_MAX_MESSAGE_SIZE: self._agree_on_size,
            Kind.ASYNC_STATUS_QUERY: self._report_status,
            Kind.ASYNC_DEVICE_CLEAR: self._begin_clear,
            Kind.ASYNC_LOCK: self._lock,
            Kind.ASYNC_LOCK_INFO: self._report_locks,
            Kind.ASYNC_REMOTE_LOCAL_CONTROL: self._acknowledge_remote,
            Kind.ERROR: self._ignore,
            Kind.FATAL_ERROR: self._give_up,
        }

    @property
    def sending(self) -> bool:
        """Whether a reply is still on its way."""
        return bool(self._channel.unsent)

    def held_off(self) -> bool:
        """Whether another session holds the lock."""
        return self._locks.hold_off(self)

    def reply(self, chunks: list[Chunk], tag: int) -> None:
        """Send `chunks` and a newline under the identifier of the message that asked."""
        self._available = True
        self._channel.send(data_frames([*chunks, b"\n"], tag, self._largest))

    def disturb(self, disturbed: Disturbed, tag: int) -> None:
        """Send what a fault has made of a reply."""
        self._available = True
        if disturbed.error is not None:
            self._channel.send(fatal_error(disturbed.error, "injected"))
            self.end()
            return
        frames = disturbed_frames(disturbed, tag)
        if disturbed.late:
            self._late += frames
            return
        late, self._late = self._late, b""
        for piece in (late, *pieces(frames, disturbed.packet)):
            self._channel.send((piece,))
        if disturbed.hangs_up:
            self.hang_up()

    def hang_up(self) -> None:
        """End both connections at once."""
        self._channel.close()
        self.end()

    def pace(self) -> None:
        """Read on, unless too many messages are waiting."""
        self._channel.read(wanted=not self._ended and len(self.waiting) < MOST_WAITING)

    def end(self) -> None:
        """The client is gone: what it has sent is still executed."""
        if not self._ended:
            self._ended = True
            self._forget()
            self._locks.forget(self)
            self._channel.read(wanted=False)
            if self.asynchronous:
                self.asynchronous.close()
            self.loop.leave(self)

    def close(self) -> None:
        """Close both connections."""
        self._channel.close()
        if self.asynchronous:
            self.asynchronous.close()

    def data_room(self) -> memoryview | None:
        """Where the next bytes of a program message belong; None during a device clear."""
        return None if self._clearing or self.asynchronous is None else self.reader.buffer()

    def data(self, frame: Frame, count: int) -> None:
        """`count` bytes of a program message came into `data_room()`."""
        self.receive(count, frame.parameter)

    def _data_complete(self, frame: Frame, _payload: bytes) -> None:
        if self.asynchronous is None:
            self._channel.send(fatal_error(Fatal.CHANNELS_NOT_ESTABLISHED, "the asynchronous channel is missing"))
            self.end()
        elif not (self._clearing or self._ended):
            self._note_delivery(frame)
            if frame.kind == Kind.DATA_END:
                self.deliver(self.reader.end(), frame.parameter)

    def _note_delivery(self, frame: Frame) -> None:
        if frame.control & REPLY_DELIVERED:
            self._available = False

    def _trigger(self, frame: Frame, _payload: bytes) -> None:
        self._note_delivery(frame)
        self.deliver([TRIGGER], frame.parameter)

    def _answer(self, kind: Kind, control: int = 0, parameter: int = 0, payload: bytes = b"") -> None:
        if self.asynchronous:
            self.asynchronous.send([header(kind, control, parameter, len(payload)), payload])

    def _agree_on_size(self, _frame: Frame, payload: bytes) -> None:
        if len(payload) == 8:
            (proposed,) = struct.unpack("!Q", payload)
            self._largest = max(64, min(proposed, LARGEST_MESSAGE))
        self._answer(Kind.ASYNC_MAX_MESSAGE_SIZE_RESPONSE, payload=struct.pack("!Q", LARGEST_MESSAGE))

    def _report_status(self, frame: Frame, _payload: bytes) -> None:
        self._note_delivery(frame)

        def report() -> None:  # when what was sent before has been executed
            available = MESSAGE_AVAILABLE if self._available else 0
            self._answer(Kind.ASYNC_STATUS_RESPONSE, self.instrument.status_byte() & ~MESSAGE_AVAILABLE | available)

        self.loop.when_idle(report)

    def _begin_clear(self, _frame: Frame, _payload: bytes) -> None:
        self._clearing = True  # what still comes before DeviceClearComplete was sent before the clear
        self._available = False
        self.abandon()
        self.reader.clear()
        self.instrument.clear()
        self.pace()
        self._answer(Kind.ASYNC_DEVICE_CLEAR_ACKNOWLEDGE)

    def _complete_clear(self, _frame: Frame, _payload: bytes) -> None:
        self._clearing = False
        self._channel.send([header(Kind.DEVICE_CLEAR_ACKNOWLEDGE)])

    def _lock(self, frame: Frame, payload: bytes) -> None:
        def decide() -> None:  # what was sent under the lock is executed before it is released
            asked = frame.control == LOCK_REQUESTED
            answer = self._locks.request(self, payload) if asked else self._locks.release(self)
            self._answer(Kind.ASYNC_LOCK_RESPONSE, answer)

        self.loop.when_idle(decide)

    def _report_locks(self, _frame: Frame, _payload: bytes) -> None:
        held = self._locks.exclusive is not None
        self._answer(Kind.ASYNC_LOCK_INFO_RESPONSE, int(held), self._locks.holders)

    def _acknowledge_remote(self, _frame: Frame, _payload: bytes) -> None:
        self._answer(Kind.ASYNC_REMOTE_LOCAL_RESPONSE)

    def _ignore(self, _frame: Frame, _payload: bytes) -> None:
        """An Error of the client concerns a message that is over."""

    def _give_up(self, _frame: Frame, _payload: bytes) -> None:
        self.end()
