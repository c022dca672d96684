"""HiSLIP on one connection: 16 bytes of header, then the payload (IVI-6.1, chapter 3: message format)."""

import struct
from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

from sim_backends.scpi.messages import Chunk
from sim_backends.servers.disturbed import Disturbed, fragments
from sim_backends.servers.socket import Channel

HEADER = struct.Struct("!2sBBIQ")  # "HS", kind, control code, parameter, bytes of payload
LONGEST_PAYLOAD = 4096  # bytes, of all messages but Data and DataEnd; what is longer is cut
_SCRAP = memoryview(bytearray(65_536))  # where payloads end that nobody wants


class Kind(IntEnum):
    """Message types (IVI-6.1, table 4)."""

    INITIALIZE = 0
    INITIALIZE_RESPONSE = 1
    FATAL_ERROR = 2
    ERROR = 3
    ASYNC_LOCK = 4
    ASYNC_LOCK_RESPONSE = 5
    DATA = 6
    DATA_END = 7
    DEVICE_CLEAR_COMPLETE = 8
    DEVICE_CLEAR_ACKNOWLEDGE = 9
    ASYNC_REMOTE_LOCAL_CONTROL = 10
    ASYNC_REMOTE_LOCAL_RESPONSE = 11
    TRIGGER = 12
    ASYNC_MAX_MESSAGE_SIZE = 15
    ASYNC_MAX_MESSAGE_SIZE_RESPONSE = 16
    ASYNC_INITIALIZE = 17
    ASYNC_INITIALIZE_RESPONSE = 18
    ASYNC_DEVICE_CLEAR = 19
    ASYNC_STATUS_QUERY = 21
    ASYNC_STATUS_RESPONSE = 22
    ASYNC_DEVICE_CLEAR_ACKNOWLEDGE = 23
    ASYNC_LOCK_INFO = 24
    ASYNC_LOCK_INFO_RESPONSE = 25


class Fatal(IntEnum):
    """Codes of FatalError (IVI-6.1, table 13)."""

    POOR_HEADER = 1
    CHANNELS_NOT_ESTABLISHED = 2
    INVALID_INITIALIZATION = 3


UNRECOGNISED_TYPE = 1  # code of Error


class Frame(NamedTuple):
    """The header of a HiSLIP message; `kind` may be a number that is not in `Kind`."""

    kind: int
    control: int
    parameter: int
    length: int


def header(kind: Kind, control: int = 0, parameter: int = 0, length: int = 0) -> bytes:
    """The header of a message with `length` bytes of payload."""
    return HEADER.pack(b"HS", kind, control, parameter, length)


def fatal_error(code: int, reason: str) -> list[Chunk]:
    """A FatalError: the session ends."""
    text = reason.encode()
    return [header(Kind.FATAL_ERROR, code, 0, len(text)), text]


def error(code: int, reason: str) -> list[Chunk]:
    """An Error: the message it answers is dropped, the session goes on."""
    text = reason.encode()
    return [header(Kind.ERROR, code, 0, len(text)), text]


class FrameReader:
    """Cuts the bytes of a connection into HiSLIP messages.

    Args:
        data_room: Where the next bytes of a Data or DataEnd payload belong; None: nobody wants them.
        data: Called with the frame and the count of bytes that were received into `data_room()`.
        complete: Called with each complete message: its frame, and its payload unless that was data.
        rubbish: Called when what comes is not HiSLIP.
    """

    def __init__(
        self,
        *,
        data_room: Callable[[], memoryview | None],
        data: Callable[[Frame, int], None],
        complete: Callable[[Frame, bytes], None],
        rubbish: Callable[[], None],
    ) -> None:
        self._data_room = data_room
        self._data = data
        self._complete = complete
        self._rubbish = rubbish
        self._header = bytearray(HEADER.size)
        self._payload = bytearray(LONGEST_PAYLOAD)
        self._frame: Frame | None = None
        self._got = 0  # of the header, then of the payload

    def read(self, channel: Channel) -> bool:
        """Receive what is there, at most to the end of one message; returns False at the end of the connection."""
        while True:
            frame = self._frame
            data_room = self._data_room() if frame and frame.kind in (Kind.DATA, Kind.DATA_END) else None
            count = channel.receive(self._room(frame, data_room))
            if not count:
                return count is None
            self._got += count
            if frame is None:
                if self._got < HEADER.size:
                    continue
                prologue, *fields = HEADER.unpack(self._header)
                if prologue != b"HS":
                    self._rubbish()
                    return True
                frame = self._frame = Frame(*fields)
                self._got = 0
            elif data_room is not None:
                self._data(frame, count)
            if self._got == frame.length:
                payload = bytes(self._payload[: self._got]) if data_room is None else b""
                self._frame, self._got = None, 0
                self._complete(frame, payload)
                return True

    def _room(self, frame: Frame | None, data_room: memoryview | None) -> memoryview:
        if frame is None:
            return memoryview(self._header)[self._got :]
        if data_room is not None:
            return data_room[: frame.length - self._got]
        if frame.kind not in (Kind.DATA, Kind.DATA_END) and self._got < LONGEST_PAYLOAD:
            return memoryview(self._payload)[self._got : frame.length]
        return _SCRAP[: frame.length - self._got]


def data_frames(chunks: list[Chunk], message_id: int, largest: int) -> list[Chunk]:
    """`chunks` as Data messages and a last DataEnd, each of at most `largest` bytes with its header; without a copy."""
    pieces: list[Chunk] = []
    views = [memoryview(chunk).cast("B") for chunk in chunks if len(chunk)]
    left = sum(map(len, views))
    room = largest - HEADER.size
    while True:
        length = min(left, room)
        left -= length
        pieces.append(header(Kind.DATA if left else Kind.DATA_END, 0, message_id, length))
        while length:
            view = views.pop(0)
            pieces.append(view[:length])
            if len(view) > length:
                views.insert(0, view[length:])
            length -= len(pieces[-1])
        if not left:
            return pieces


def disturbed_frames(disturbed: Disturbed, message_id: int) -> bytes:
    """What of a reply's messages comes; empty if nothing does."""
    if not disturbed.data or disturbed.ends_after == 0:
        return b""
    payloads = fragments(disturbed.data, disturbed.fragments)
    frames = [
        header(
            Kind.DATA_END if disturbed.ends and place == len(payloads) else Kind.DATA,
            0,
            (message_id + disturbed.numbered) % 2**32,
            max(0, len(payload) + disturbed.announced),
        )
        + payload
        for place, payload in enumerate(payloads, 1)
    ]
    missing = 0 if disturbed.ends_after is None else len(disturbed.data) - disturbed.ends_after
    whole = b"".join(frames)
    return whole[: len(whole) - max(0, missing)]
