"""The virtual DLPC900 (LightCrafter 6500): HID reports in and out, and which way the mirrors point.

Source: instrument facts 4.3, and public drivers of the device for error codes, status and firmware version. Its 1920 x
1080 mirrors of 7.56 um are where the world has 1024 x 768 of 13.68 um: each of those takes the state of the mirror
at its centre, and those above and below the smaller device get no mirror and send no light on. Not simulated: patterns
in turn and grey scales (the first pattern of the table stays, its first bit plane), triggers, images in flash.
"""

import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics import mirrors
from sim_backends.virtual.dlpc900 import planes
from sim_backends.world.world import World

REPORT = 64  # bytes
READS, REPLIES, REFUSED = 0x80, 0x40, 0x20  # flags
PITCH_M = 7.56e-6  # of the mirrors, a recalled figure
REPORT_S = 1e-3  # a report on USB: one interrupt transfer a millisecond
SHOW_S = 105e-6  # the shortest exposure of a binary pattern, a recalled figure
MOST_PATTERNS = 511  # as public drivers have it
MOST_IMAGES = 18  # 24 patterns each; about 400 patterns, a recalled figure
LARGEST_IMAGE = 1 << 23  # bytes; more than an uncompressed image
LARGEST_CHUNK = 504
ERROR_BYTES = (4, 6)  # of the reply about the last error: public drivers look in different places
FIRMWARE_TAG, FIRMWARE = b"LCR6500 simulated", (6, 0, 0)
DLP6500 = 1
VIDEO, PRE_STORED, VIDEO_PATTERN, ON_THE_FLY = range(4)
STOP, PAUSE, START = range(3)
AWAKE, STANDBY, RESET = range(3)

INVALID_COMMAND, NOT_IN_THIS_MODE, INVALID_PARAMETER, NOT_PRESENT = 3, 5, 6, 7
OUT_OF_MEMORY, INVALID_COMPRESSION, BAD_BIT, NOT_IN_FLASH = 8, 9, 10, 11
BAD_EXPOSURE, BAD_PATTERN_NUMBER, BAD_DEFINITION, BAD_IMAGE_ADDRESS = 14, 15, 16, 17
ERROR_TEXTS = {
    0: "no error",
    INVALID_COMMAND: "invalid command number",
    NOT_IN_THIS_MODE: "command not allowed in current mode",
    INVALID_PARAMETER: "invalid command parameter",
    NOT_PRESENT: "item referred by the parameter is not present",
    OUT_OF_MEMORY: "out of resource",
    INVALID_COMPRESSION: "invalid BMP compression type",
    BAD_BIT: "pattern bit number out of range",
    NOT_IN_FLASH: "pattern BMP not present in flash",
    BAD_EXPOSURE: "pattern exposure time out of range",
    BAD_PATTERN_NUMBER: "pattern number out of range",
    BAD_DEFINITION: "invalid pattern definition",
    BAD_IMAGE_ADDRESS: "pattern image memory address out of range",
}


class Refusal(Exception):
    """The device refuses a command; the argument is its error code."""


class Pattern(NamedTuple):
    """An entry of the pattern table."""

    image: int
    bit: int


@dataclass
class Upload:
    """An image under way."""

    index: int
    size: int
    data: bytearray


class VirtualDlpc900:
    """What a client of the controller can see: `write` takes one report, `read` returns the next one, or nothing."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._replies: deque[bytes] = deque()
        self._packet = bytearray()
        self._error = 0
        self._mapping = _mapping()
        self._writes: dict[int, tuple[str, Callable[..., None]]] = {
            0x0200: ("<B", self.set_power),
            0x0201: ("<B", self.set_idle),
            0x1A1B: ("<B", self.set_mode),
            0x1A24: ("<B", self.run_patterns),
            0x1A31: ("<HI", self.configure),
            0x1A34: ("<H3sB3sBH", self.define),
            0x1A2A: ("<HI", self.announce),
        }
        self._reads: dict[int, Callable[[], bytes]] = {
            0x0101: lambda: ERROR_TEXTS[self._error].encode() + b"\0",
            0x0205: lambda: struct.pack("<HBB", *FIRMWARE[::-1]) * 4,
            0x0206: lambda: bytes((DLP6500,)) + FIRMWARE_TAG + b"\0",
            0x1A0A: lambda: b"\x01",  # initialised, no fault
            0x1A0B: lambda: b"\x01",  # memory test passed
            0x1A0C: self.status,
            0x1A1B: lambda: bytes((self.mode,)),
            0x1A24: lambda: bytes((self.running,)),
        }
        self._power_on()

    def _power_on(self) -> None:
        self.power = AWAKE
        self.mode = PRE_STORED
        self.running = STOP
        self.patterns: dict[int, Pattern] = {}
        self.configured = 0
        self.images: dict[int, NDArray[np.uint32]] = {}
        self._upload: Upload | None = None
        self.world.show(None)

    # --- reports

    def write(self, report: bytes) -> None:
        """Take one report: the first of a command, or more of its data."""
        self.world.clock.advance(REPORT_S)
        self._packet += report.ljust(REPORT, b"\0")
        flags, number, length, command = struct.unpack_from("<BBHH", self._packet)
        if len(self._packet) < 4 + length:
            return
        data = bytes(self._packet[6 : 4 + length])
        self._packet.clear()
        if command == 0x0100 and flags & READS:
            self._reply(flags, number, self._last_error())
            return
        try:
            answer = self._execute(command, data, reads=bool(flags & READS))
        except Refusal as refusal:
            self._error = int(refusal.args[0])
            flags |= REFUSED
            answer = b""
        else:
            self._error = self._error if command == 0x0101 else 0
        if flags & REPLIES:
            self._reply(flags, number, answer)

    def read(self) -> bytes:
        """The next report of 64 bytes; nothing if there is none, as after a time-out."""
        return self._replies.popleft() if self._replies else b""

    def close(self) -> None:
        """Release the device; its state stays."""

    def _reply(self, flags: int, number: int, data: bytes) -> None:
        self._replies.append((struct.pack("<BBH", flags, number, len(data)) + data).ljust(REPORT, b"\0"))

    def _last_error(self) -> bytes:
        answer = bytearray(max(ERROR_BYTES) - 3)
        for at in ERROR_BYTES:
            answer[at - 4] = self._error
        return bytes(answer)

    def _execute(self, command: int, data: bytes, *, reads: bool) -> bytes:
        if reads:
            if command not in self._reads:
                raise Refusal(INVALID_COMMAND)
            return self._reads[command]()
        if command == 0x1A2B:
            self.load(data)
            return b""
        if command not in self._writes:
            raise Refusal(INVALID_COMMAND)
        form, action = self._writes[command]
        if len(data) != struct.calcsize(form):
            raise Refusal(INVALID_PARAMETER)
        action(*struct.unpack(form, data))
        return b""

    # --- commands

    def status(self) -> bytes:
        """Main status: bit 0 mirrors parked, bit 1 sequencer running."""
        return bytes(((self.power == STANDBY) | (self.running == START) << 1,))

    def set_power(self, state: int) -> None:
        """0x0200: awake, standby (mirrors parked), reset."""
        if state > RESET:
            raise Refusal(INVALID_PARAMETER)
        if state == RESET:
            self._power_on()
        elif state != self.power:
            self.power, self.running = state, STOP
            self.world.show(None)

    def set_idle(self, state: int) -> None:
        """0x0201: idle mode flips the mirrors all the time; here it is dark."""
        if state > 1:
            raise Refusal(INVALID_PARAMETER)
        if state:
            _require(self.running == STOP)
            self.world.show(None)

    def set_mode(self, mode: int) -> None:
        """0x1A1B: video, pre-stored, video pattern, pattern on the fly; the pattern table is emptied."""
        if mode > ON_THE_FLY:
            raise Refusal(INVALID_PARAMETER)
        if mode != self.mode:
            _require(self.running == STOP)
            self.mode = mode
            self.patterns.clear()
            self.configured = 0

    def define(self, index: int, exposure: bytes, options: int, _dark: bytes, _trigger_out: int, where: int) -> None:
        """0x1A34: entry `index` of the pattern table."""
        _require(self.mode != VIDEO and self.running == STOP)
        if index >= MOST_PATTERNS:
            raise Refusal(BAD_PATTERN_NUMBER)
        if int.from_bytes(exposure, "little") < SHOW_S * 1e6:
            raise Refusal(BAD_EXPOSURE)
        depth = (options >> 1 & 0b111) + 1
        image, bit = where & 0x7FF, where >> 11
        if bit + depth > planes.PLANES:
            raise Refusal(BAD_BIT)
        if image >= MOST_IMAGES:
            raise Refusal(BAD_IMAGE_ADDRESS)
        self.patterns[index] = Pattern(image, bit)

    def configure(self, count: int, _repeat: int) -> None:
        """0x1A31: how many entries of the table are played."""
        _require(self.mode != VIDEO and self.running == STOP)
        if not 1 <= count <= MOST_PATTERNS:
            raise Refusal(BAD_PATTERN_NUMBER)
        if any(index not in self.patterns for index in range(count)):
            raise Refusal(BAD_DEFINITION)
        self.configured = count

    def announce(self, index: int, size: int) -> None:
        """0x1A2A: the image that comes, and its bytes."""
        _require(self.mode == ON_THE_FLY and self.running == STOP)
        if index >= MOST_IMAGES:
            raise Refusal(BAD_IMAGE_ADDRESS)
        if size > LARGEST_IMAGE:
            raise Refusal(OUT_OF_MEMORY)
        self._upload = Upload(index, size, bytearray())

    def load(self, data: bytes) -> None:
        """0x1A2B: bytes of the announced image, their number in front."""
        upload = self._upload
        if upload is None:
            raise Refusal(NOT_IN_THIS_MODE)
        chunk = data[2:]
        if len(data) < 2 or len(chunk) > LARGEST_CHUNK or len(chunk) != int.from_bytes(data[:2], "little"):
            raise Refusal(INVALID_PARAMETER)
        if len(upload.data) + len(chunk) > upload.size:
            raise Refusal(INVALID_PARAMETER)
        upload.data += chunk
        if len(upload.data) == upload.size:
            self._upload = None
            try:
                self.images[upload.index] = planes.decode(bytes(upload.data))
            except planes.BadImage:
                raise Refusal(INVALID_COMPRESSION) from None

    def run_patterns(self, action: int) -> None:
        """0x1A24: stop (dark), pause (the pattern stays), start."""
        if action > START:
            raise Refusal(INVALID_PARAMETER)
        if action == START:
            self._start()
        elif action == STOP and self.running != STOP:
            self.world.show(None)
        self.running = action

    def _start(self) -> None:
        _require(self.mode != VIDEO and self.power == AWAKE)
        if not self.configured:
            raise Refusal(BAD_DEFINITION)
        wanted = {self.patterns[index].image for index in range(self.configured)}
        if not wanted <= self.images.keys():
            raise Refusal(NOT_PRESENT if self.mode == ON_THE_FLY else NOT_IN_FLASH)
        first = self.patterns[0]
        self.world.show(self._mapped(planes.plane(self.images[first.image], first.bit)))
        self.world.clock.advance(SHOW_S)

    def _mapped(self, packed: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Packed (1080, 240) as the world sees it: (768, 128)."""
        rows, columns, inside = self._mapping
        return np.packbits(np.unpackbits(packed, axis=1)[rows[:, None], columns] & inside, axis=1)


def _require(allowed: bool) -> None:
    if not allowed:
        raise Refusal(NOT_IN_THIS_MODE)


def _mapping() -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
    """For every mirror of the world: row and column of the one at its centre, and whether there is one."""

    def along(theirs: int, ours: int) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        at_m = (np.arange(theirs) - (theirs - 1) / 2) * mirrors.PITCH_M
        index = np.round(at_m / PITCH_M + (ours - 1) / 2).astype(np.intp)
        return index.clip(0, ours - 1), (index >= 0) & (index < ours)

    rows, row_inside = along(mirrors.ROWS, planes.ROWS)
    columns, column_inside = along(mirrors.COLUMNS, planes.COLUMNS)
    return rows, columns, row_inside[:, None] & column_inside
