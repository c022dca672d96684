"""TI DLPC900 DMD controllers (LightCrafter 6500) over USB HID.

The driver talks to a `HidDevice`: reports of 64 bytes out and in. The extra `dlpc900` puts `hidapi` behind it; the
simulated device offers the same two calls. Source: instrument facts 4.3.
"""

import importlib
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from instruments import dlpc900_image
from instruments.driver import Driver
from instruments.errors import InstrumentError, LinkError, NotConfigured
from instruments.interfaces import Dmd
from instruments.sections import USB, DmdSection
from instruments.values import Identity


class TiDlpc900Section(DmdSection):
    """The micromirror device, on USB only."""

    address: Literal["usb"] = USB


DRIVER = Driver(
    section=TiDlpc900Section,
    open=lambda _section, opening: TiDlpc900(HidApi.at(opening.address)),
    sent_anew=("display_mode",),
)

VENDOR, PRODUCT = 0x0451, 0xC900
REPORT = 64  # bytes
WRITE, READ = 0x40, 0xC0  # flags: both ask for a reply
REFUSED = 0x20  # flag of a reply
IMAGE_CHUNK = 504  # bytes of image data in one command

LAST_ERROR, ERROR_TEXT = 0x0100, 0x0101
POWER, FIRMWARE_VERSION, FIRMWARE_TYPE = 0x0200, 0x0205, 0x0206
HARDWARE_STATUS, SYSTEM_STATUS = 0x1A0A, 0x1A0B
DISPLAY_MODE, RUN = 0x1A1B, 0x1A24
ANNOUNCE_IMAGE, LOAD_IMAGE = 0x1A2A, 0x1A2B
CONFIGURE_PATTERNS, DEFINE_PATTERN = 0x1A31, 0x1A34

AWAKE = 0
PATTERN_ON_THE_FLY = 3
STOP, START = 0, 2
FOR_EVER = 0
ALL_COLOURS = 0b111

EXPOSURE_US = 100_000
"""How long a picture is shown before it is shown again. Any time will do: the picture is static."""

ERROR_BYTES = (4, 6)
"""Where the reply to `LAST_ERROR` may hold the code: public drivers of the device disagree; elsewhere it is zero."""

TIMEOUT_S = 5.0
ROWS, COLUMNS = 1080, 1920

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

HARDWARE_FAULTS = {
    1: "controller and DMD do not fit",
    2: "DMD reset controller error",
    3: "forced swap error",
    6: "sequence aborted",
    7: "sequencer error",
}
"""Bits of the hardware status that report a fault; bit 0 is set once the controller has initialised itself."""


class HidDevice(Protocol):
    """A USB HID device that exchanges reports of 64 bytes."""

    def write(self, report: bytes) -> None:
        """Send one report."""

    def read(self) -> bytes:
        """Receive one report; nothing if none came in time."""

    def close(self) -> None:
        """Release the device."""


class HidApi:
    """The first DLPC900 on USB, through `hidapi`."""

    def __init__(self) -> None:
        """Open the device.

        Raises:
            NotConfigured: hidapi is not installed.
            LinkError: there is no such device, or it may not be opened.
        """
        try:
            hid: Any = importlib.import_module("hid")
        except ImportError:
            raise NotConfigured("dmd: hidapi is not installed: pip install 'photonic-labctl[dlpc900]'") from None
        self._hid = hid
        self._device: Any = None
        self._open()

    @classmethod
    def at(cls, address: str) -> "HidApi":
        """The device at `address`, of which there is one only: a replay has another.

        Raises:
            NotConfigured: it is not `USB`.
        """
        if address != USB:
            raise NotConfigured(f"dmd.address = {address!r}: a DLPC900 is on USB only: write address = {USB!r}")
        return cls()

    def write(self, report: bytes) -> None:
        """Send one report; report number 0, which hidapi wants in front, is not part of it.

        Raises:
            LinkError: the cable is out; the next report opens the device anew.
        """
        with self._conversation() as device:
            if device.write(b"\0" + report) < 0:
                raise OSError("it takes no report")

    def read(self) -> bytes:
        """Receive one report; nothing if none came within `TIMEOUT_S`.

        Raises:
            LinkError: as `write`.
        """
        with self._conversation() as device:
            return bytes(device.read(REPORT, int(TIMEOUT_S * 1e3)))

    def close(self) -> None:
        """Release the device."""
        device, self._device = self._device, None
        if device is not None:
            device.close()

    @contextmanager
    def _conversation(self) -> Iterator[Any]:
        """The open device; what breaks inside closes it."""
        if self._device is None:
            self._open()
        try:
            yield self._device
        except OSError as error:
            self.close()
            raise LinkError(f"dmd: the link to the DLPC900 is lost ({error}): check power and USB cable") from None

    def _open(self) -> None:
        device = self._hid.device()
        try:
            device.open(VENDOR, PRODUCT)
        except OSError as error:
            raise LinkError(f"dmd: no DLPC900 on USB ({error}): check power, cable and permissions") from None
        self._device = device


class TiDlpc900(Dmd):
    """A DLPC900 in pattern-on-the-fly mode, showing one binary picture for ever.

    Every command asks for a reply, and after every command the controller is asked for its last error: it takes a wrong
    command silently.
    """

    shape = (ROWS, COLUMNS)

    def __init__(self, device: HidDevice) -> None:
        """Drive the controller behind `device`."""
        self._device = device
        self._sequence = 0

    def identify(self) -> Identity:
        """Firmware tag and version; the controller has no serial number to ask for."""
        tag = self._read(FIRMWARE_TYPE)[1:].split(b"\0")[0].decode("ascii", "replace")
        patch, minor, major = struct.unpack("<HBB", self._read(FIRMWARE_VERSION)[:4])
        return Identity("Texas Instruments", f"DLPC900 {COLUMNS}x{ROWS}", "", f"{tag} {major}.{minor}.{patch}".strip())

    def self_test(self) -> None:
        """Turn every mirror away and read the controller's status."""
        self.blank()
        status = self._read(HARDWARE_STATUS)[0]
        faults = [text for bit, text in HARDWARE_FAULTS.items() if status >> bit & 1]
        if not status & 1:
            faults.append("the controller has not initialised itself")
        if not self._read(SYSTEM_STATUS)[0] & 1:
            faults.append("memory test failed")
        if faults:
            raise InstrumentError(f"dmd: {'; '.join(faults)}: switch the controller off and on")

    def show(self, mirrors: NDArray[np.uint8]) -> None:
        """Stop, define one pattern, load its image, start."""
        if mirrors.shape != (ROWS, COLUMNS // 8):
            raise InstrumentError(f"dmd: a picture of {mirrors.shape} bytes: give ({ROWS}, {COLUMNS // 8}) packed bits")
        self._command(POWER, bytes((AWAKE,)))
        self._command(RUN, bytes((STOP,)))
        self._command(DISPLAY_MODE, bytes((PATTERN_ON_THE_FLY,)))
        self._command(RUN, bytes((STOP,)))  # a change of mode may have started the last sequence again
        self._command(DEFINE_PATTERN, _pattern(EXPOSURE_US))
        self._command(CONFIGURE_PATTERNS, struct.pack("<HI", 1, FOR_EVER))
        self._load(dlpc900_image.encode(mirrors))
        self._command(RUN, bytes((START,)))

    def blank(self) -> None:
        """Show a picture with every mirror off."""
        self.show(np.zeros((ROWS, COLUMNS // 8), np.uint8))

    def settings(self) -> dict[str, str | float]:
        """Mirrors and display mode."""
        return {"rows": ROWS, "columns": COLUMNS, "display_mode": self._read(DISPLAY_MODE)[0]}

    def make_safe(self) -> None:
        """Every mirror off."""
        self.blank()

    def close(self) -> None:
        """Release the USB device."""
        self._device.close()

    def _load(self, image: bytes) -> None:
        self._command(ANNOUNCE_IMAGE, struct.pack("<HI", 0, len(image)))
        for start in range(0, len(image), IMAGE_CHUNK):
            chunk = image[start : start + IMAGE_CHUNK]
            self._transact(WRITE, LOAD_IMAGE, struct.pack("<H", len(chunk)) + chunk)
        self._check(LOAD_IMAGE)

    def _command(self, command: int, data: bytes) -> None:
        self._transact(WRITE, command, data)
        self._check(command)

    def _read(self, command: int) -> bytes:
        return self._transact(READ, command, b"")

    def _check(self, command: int) -> None:
        """Raise the error the controller has kept of `command`."""
        reply = self._exchange(READ, LAST_ERROR, b"")
        code = next((reply[at] for at in ERROR_BYTES if reply[at]), 0)
        if code:
            self._raise(command, code)

    def _transact(self, flags: int, command: int, data: bytes) -> bytes:
        """Send a command and return the data of its reply."""
        reply = self._exchange(flags, command, data)
        if reply[0] & REFUSED:
            self._check(command)
            raise InstrumentError(f"dmd: the DLPC900 refused command 0x{command:04X} and gives no reason")
        return reply[4:]

    def _exchange(self, flags: int, command: int, data: bytes) -> bytes:
        self._sequence = (self._sequence + 1) % 256
        packet = struct.pack("<BBHH", flags, self._sequence, len(data) + 2, command) + data
        for start in range(0, len(packet), REPORT):
            self._device.write(packet[start : start + REPORT].ljust(REPORT, b"\0"))
        reply = self._device.read()
        if not reply:
            raise LinkError(f"dmd: no answer to command 0x{command:04X}: check the USB cable and the power supply")
        if len(reply) != REPORT or reply[1] != self._sequence:
            raise LinkError(f"dmd: the reply to command 0x{command:04X} does not belong to it: close other programs")
        return reply

    def _raise(self, command: int, code: int) -> None:
        own = self._exchange(READ, ERROR_TEXT, b"")[4:].split(b"\0")[0].decode("ascii", "replace").strip()
        meaning = ERRORS.get(code, "unknown error")
        raise InstrumentError(f"dmd: command 0x{command:04X} refused, error {code}: {own or meaning}")


def _pattern(exposure_us: int) -> bytes:
    """Entry 0 of the pattern table: bit 0 of image 0, all colours, no trigger, no dark time."""
    options = ALL_COLOURS << 4
    return struct.pack("<H", 0) + exposure_us.to_bytes(3, "little") + bytes((options, 0, 0, 0, 0, 0, 0))
