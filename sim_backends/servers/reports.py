"""HID reports in frames over TCP: on a raw socket what a USB cable carries between a program and a device.

A frame is one report of 64 bytes, in both directions; frames follow one another with nothing in between. The report
number, which HID libraries put in front of what they write, is not sent: there is one kind of report, number 0. What
is longer than a report (the first one says how long, little-endian, at byte 2, without those 4 bytes) goes on in
further ones, the last of them filled up. Source: TI DLPC900 programmer's guide (DLPU018J), section 1.2.1.
"""

import struct

from sim_backends.scpi.messages import Message, Unit
from sim_backends.servers.socket import Framing

REPORT = 64  # bytes
WANTS_REPLY = 0x40  # flag, the first byte

_LENGTH = struct.Struct("<H")
_LENGTH_AT, _COMMAND_AT = 2, 4
_ROOM = 1 << 16


class ReportReader:
    """Cuts the bytes of one connection into packets of whole reports, each a message of one unit.

    The unit's header is the command's number (`0x1A1B`), its argument the packet; it is a query if it wants a reply.
    """

    begun = b""

    def __init__(self) -> None:
        self._received = bytearray()
        self._room = memoryview(bytearray(_ROOM))

    def buffer(self) -> memoryview:
        """Where the next bytes belong; never empty."""
        return self._room

    def received(self, count: int) -> list[Message]:
        """Take over `count` bytes written to the start of `buffer()`; returns the messages they complete."""
        self._received += self._room[:count]
        found = []
        while len(self._received) >= (size := self._packet_size()):
            found.append(_message(bytes(self._received[:size])))
            del self._received[:size]
        return found

    def end(self) -> list[Message]:
        """Nothing ends a packet but its length."""
        return []

    def clear(self) -> None:
        """Forget what is not a whole packet."""
        self._received.clear()

    def _packet_size(self) -> int:
        if len(self._received) < REPORT:
            return REPORT
        (length,) = _LENGTH.unpack_from(self._received, _LENGTH_AT)
        return -(-(_LENGTH_AT + _LENGTH.size + int(length)) // REPORT) * REPORT


def _message(packet: bytes) -> Message:
    (command,) = _LENGTH.unpack_from(packet, _COMMAND_AT)
    return Message((Unit(f"0x{command:04X}", bool(packet[0] & WANTS_REPLY), (memoryview(packet),)),))


REPORTS = Framing(ReportReader, b"")
"""The framing of a raw socket that carries reports."""
