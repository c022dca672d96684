"""Commands of a DLPC900, each a packet of reports with a reply, and what the controller says of its errors.

Source: TI DLPC900 programmer's guide (DLPU018J), 1.2 (packets), 2.1.6 and 2.1.7 (errors); instrument facts 4.3.
"""

import struct

from instruments.dlpc900_reports import REPORT, HidDevice
from instruments.errors import InstrumentError, LinkError
from instruments.transcripts import Transcript

WRITE, READ = 0x40, 0xC0  # flags: both ask for a reply
REFUSED = 0x20  # flag of a reply
LAST_ERROR, ERROR_TEXT = 0x0100, 0x0101

ERROR_BYTES = (4, 6)
"""Where the reply to `LAST_ERROR` may hold the code: public drivers of the device disagree; elsewhere it is zero."""

ERRORS = {
    1: "batch file checksum error",
    2: "device failure",
    3: "invalid command number",
    4: "controller and DMD do not fit",
    5: "command not allowed in the present mode",
    6: "invalid command parameter",
    7: "the item a parameter refers to is not present",
    8: "out of memory",
    9: "invalid image compression",
    10: "pattern bit number out of range",
    11: "pattern image not present in flash",
    12: "pattern dark time out of range",
    13: "signal delay out of range",
    14: "pattern exposure time out of range",
    15: "pattern number out of range",
    16: "invalid pattern definition",
    17: "pattern image address out of range",
    255: "internal error",
}
"""What the controller's error codes mean, as public drivers of the device list them."""


class Commands:
    """What a controller is told and asked.

    Every command asks for a reply, and after a command the controller is asked for its last error: it takes a wrong
    command silently.
    """

    def __init__(self, device: HidDevice, transcript: Transcript) -> None:
        """Talk to the controller behind `device`."""
        self._device = device
        self._transcript = transcript
        self._sequence = 0

    def write(self, command: int, data: bytes) -> None:
        """Carry out a command.

        Raises:
            InstrumentError: the controller refused it, with the reason it gives.
            LinkError: no reply, or none that belongs to it.
        """
        self.send(command, data)
        self.check(command)

    def send(self, command: int, data: bytes) -> None:
        """`write` without asking for the last error: for the many pieces of an image or of the pattern table."""
        self._transact(WRITE, command, data)

    def read(self, command: int) -> bytes:
        """The data of the reply to a question, filled up with zeros.

        Raises:
            InstrumentError, LinkError: as `write`.
        """
        return self._transact(READ, command, b"")

    def check(self, command: int) -> None:
        """Raise the error that the controller has kept of `command`."""
        reply = self._exchange(READ, LAST_ERROR, b"")
        code = next((reply[at] for at in ERROR_BYTES if reply[at]), 0)
        if code:
            own = self._exchange(READ, ERROR_TEXT, b"")[4:].split(b"\0")[0].decode("ascii", "replace").strip()
            meaning = ERRORS.get(code, "unknown error")
            raise InstrumentError(f"dmd: command 0x{command:04X} refused, error {code}: {own or meaning}")

    def close(self) -> None:
        """Release the device."""
        self._device.close()

    def _transact(self, flags: int, command: int, data: bytes) -> bytes:
        reply = self._exchange(flags, command, data)
        if reply[0] & REFUSED:
            self.check(command)
            raise InstrumentError(f"dmd: the DLPC900 refused command 0x{command:04X} and gives no reason")
        return reply[4:]

    def _exchange(self, flags: int, command: int, data: bytes) -> bytes:
        self._sequence = (self._sequence + 1) % 256
        packet = struct.pack("<BBHH", flags, self._sequence, len(data) + 2, command) + data
        self._transcript("dmd", ">", f"0x{command:04X}{' ?' if flags == READ else ''} {_shown(data)}".rstrip())
        for start in range(0, len(packet), REPORT):
            self._device.write(packet[start : start + REPORT].ljust(REPORT, b"\0"))
        reply = self._device.read()
        # Whatever still comes belongs to a command that is given up: the next one is asked over a new connection.
        if not reply:
            self._device.close()
            raise LinkError(f"dmd: no answer to command 0x{command:04X}: check the cable and the power supply")
        if len(reply) != REPORT or reply[1] != self._sequence:
            self._device.close()
            raise LinkError(f"dmd: the reply to command 0x{command:04X} does not belong to it: close other programs")
        self._transcript("dmd", "<", f"{'refused ' if reply[0] & REFUSED else ''}{_shown(reply[4:].rstrip(bytes(1)))}")
        return reply


def _shown(data: bytes) -> str:
    return data.hex(" ") if len(data) <= REPORT else f"<{len(data)} bytes>"
