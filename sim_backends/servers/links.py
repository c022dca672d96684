"""One VXI-11 link: what its client writes, and what it reads of the replies (VXI-11, appendix B.6)."""

from collections import deque
from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

from sim_backends.scpi.messages import Chunk
from sim_backends.scpi.status import MESSAGE_AVAILABLE
from sim_backends.servers.disturbed import INTACT, Disturbed
from sim_backends.servers.locks import LockAnswer, Locks
from sim_backends.servers.loop import TRIGGER, Client, Instrument, Loop

COUNT_REACHED, TERMINATOR_FOUND, END_REACHED = 1, 2, 4  # why a device_read ended
_SEARCHED_AT_ONCE = 1024  # bytes


class DeviceError(IntEnum):
    """Error codes of VXI-11 (table B.2)."""

    NONE = 0
    NOT_ACCESSIBLE = 3
    INVALID_LINK = 4
    NOT_SUPPORTED = 8
    LOCKED = 11
    NO_LOCK = 12
    TIMED_OUT = 15
    ABORTED = 23


class Read(NamedTuple):
    """A device_read: the most bytes it takes, the byte it ends at (None: any), and how it is answered.

    It is answered with an error, the reason why it ended, the data, and how the answer is disturbed on its way.
    """

    size: int
    ends_at: int | None
    answer: Callable[[int, int, list[Chunk], Disturbed], None]


class Link(Client):
    """A client on VXI-11.

    A read waits while a message of the link is being executed. When nothing is, nothing will come: the read is answered
    as timed out at once, because nothing here waits on a clock.

    Args:
        loop: Where its messages are executed.
        instrument: By which.
        locks: Who may use the instrument.
        read_on: Reads the link's connection on, unless too many messages are waiting.
        transmitting: Whether its connection still has something to send.
        hang_up: Closes its connection.
    """

    def __init__(
        self,
        loop: Loop,
        instrument: Instrument,
        locks: "Locks[Link]",
        *,
        read_on: Callable[[], None],
        transmitting: Callable[[], bool],
        hang_up: Callable[[], None],
    ) -> None:
        super().__init__(loop, instrument)
        self._locks = locks
        self._read_on = read_on
        self._transmitting = transmitting
        self._hang_up = hang_up
        self._output: deque[memoryview] = deque()  # of one reply
        self._read: Read | None = None
        self._ended = False
        self._late = b""
        self._disturbed = INTACT  # what becomes of the answer to the next read

    @property
    def sending(self) -> bool:
        """Whether a reply was not read to its end."""
        return not self._ended and (bool(self._output) or self._transmitting())

    def held_off(self) -> bool:
        """Whether another link holds the lock."""
        return self._locks.hold_off(self)

    def write(self, data: memoryview, *, last: bool) -> None:
        """Take the next bytes of a program message; `last` ends it."""
        while len(data) and not self._ended:
            room = self.reader.buffer()
            count = min(len(room), len(data))
            room[:count] = data[:count]
            self.receive(count)
            data = data[count:]
        if last and not self._ended:
            self.deliver(self.reader.end())

    def trigger(self) -> None:
        """Queue a group execute trigger."""
        self.deliver([TRIGGER])

    def read(self, read: Read) -> None:
        """Answer `read` as soon as there is a reply; it takes the place of one that is still waiting."""
        self._fail_read(DeviceError.TIMED_OUT)
        self._read = read
        self._transfer()
        if self._read:
            self.loop.when_idle(self._give_up)

    def abort_read(self) -> None:
        """End a read that waits (device_abort)."""
        self._fail_read(DeviceError.ABORTED)

    def clear(self) -> None:
        """Device clear: forget what was sent, what is blocked and what was not read."""
        self.abandon()
        self.reader.clear()
        self._output.clear()
        self._fail_read(DeviceError.ABORTED)
        self.instrument.clear()

    def status_byte(self) -> int:
        """The instrument's status byte, with the bit of this link's own reply."""
        available = MESSAGE_AVAILABLE if self._output else 0
        return self.instrument.status_byte() & ~MESSAGE_AVAILABLE | available

    def lock(self) -> bool:
        """Ask for the lock; returns whether the link has it now."""
        return self._locks.request(self, b"") is LockAnswer.SUCCESS or self._locks.exclusive is self

    def unlock(self) -> bool:
        """Give the lock back; returns whether the link had it."""
        return self._locks.release(self) is LockAnswer.SUCCESS

    def reply(self, chunks: list[Chunk], tag: int) -> None:
        """Keep `chunks` and a newline for the next reads."""
        if not self._ended:
            self._output.extend(memoryview(chunk).cast("B") for chunk in (*chunks, b"\n") if len(chunk))
            self._transfer()

    def disturb(self, disturbed: Disturbed, tag: int) -> None:
        """Keep what a fault has made of a reply for the next reads."""
        if disturbed.late:
            self._late += disturbed.data
        elif disturbed.ends_after == 0:
            self.hang_up()
        elif disturbed.data and not self._ended:
            late, self._late = self._late, b""
            self._output.append(memoryview(late + disturbed.data))
            self._disturbed = disturbed
            self._transfer()

    def pace(self) -> None:
        """Read on, unless too many messages are waiting; a read that waits for a message without reply is given up."""
        if not self._ended:
            self._read_on()
        if self._read:
            self.loop.when_idle(self._give_up)

    def end(self) -> None:
        """The client is gone: what it has sent is still executed."""
        self._ended = True
        self._read = None
        self._output.clear()
        self._locks.forget(self)
        self.loop.leave(self)

    def hang_up(self) -> None:
        """End the connection at once, and every link on it."""
        self._hang_up()

    def close(self) -> None:
        """Close the connection, unless only this link has ended and others live on it."""
        if not self._ended:
            self._hang_up()

    def _transfer(self) -> None:
        if not (self._read and self._output):
            return
        read, self._read = self._read, None
        disturbed, self._disturbed = self._disturbed, INTACT
        if disturbed.error is not None:
            self._output.clear()
            read.answer(disturbed.error, 0, [], INTACT)
            return
        data: list[Chunk] = []
        left = read.size
        reason = 0
        while left and self._output and not reason:
            chunk = self._output.popleft()
            piece = chunk[:left]
            if read.ends_at is not None and (found := _find(piece, read.ends_at)) >= 0:
                piece = piece[: found + 1]
                reason = TERMINATOR_FOUND
            if len(piece) < len(chunk):
                self._output.appendleft(chunk[len(piece) :])
            data.append(piece)
            left -= len(piece)
        reason |= 0 if left else COUNT_REACHED
        reason |= 0 if self._output or not disturbed.ends else END_REACHED
        read.answer(DeviceError.NONE, reason, data, disturbed)
        if disturbed.hangs_up:
            self.hang_up()

    def _give_up(self) -> None:
        if self._read and not (self.waiting or self.blocked):
            self._fail_read(DeviceError.TIMED_OUT)

    def _fail_read(self, error: DeviceError) -> None:
        read, self._read = self._read, None
        if read:
            read.answer(error, 0, [], INTACT)


def _find(view: memoryview, byte: int) -> int:
    """Where `byte` first is, or -1; without a copy of everything behind it."""
    for start in range(0, len(view), _SEARCHED_AT_ONCE):
        at = bytes(view[start : start + _SEARCHED_AT_ONCE]).find(byte)
        if at >= 0:
            return start + at
    return -1
