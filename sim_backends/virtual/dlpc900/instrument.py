"""The virtual DLPC900 (LightCrafter 6500): packets of HID reports in and out, and what its mirrors show when.

Source: `commands`, and instrument facts 4.3. The optics in front of it are made for it: the light fills a square as
high as its 1080 rows of mirrors, 28 superpixels of 38 mirrors a side, so that it sees of a picture what any other DMD
of the world sees. TRIG_OUT_2, a pulse at the start of each pattern, is wired to the generator's trigger input A; the
generator's marker 1 to TRIG_IN_1. Not simulated: grey scales (the first bit plane counts), the dark time's darkness,
patterns of a sequence that differ in length, trigger input or trigger output (refused), TRIG_OUT_1 and TRIG_IN_2 beyond
their settings, the edge of TRIG_IN_1, video, images in flash.
"""

import struct
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics import mirrors
from sim_backends.scpi.messages import Chunk, Message
from sim_backends.virtual.dlpc900 import commands, planes
from sim_backends.virtual.dlpc900.commands import (
    AWAKE,
    ON_THE_FLY,
    PAUSE,
    PRE_STORED,
    RESET,
    STANDBY,
    START,
    STOP,
    VIDEO,
    Refusal,
)
from sim_backends.virtual.instrument import Connected, Execution
from sim_backends.world.signals import Projection
from sim_backends.world.world import World

REPORT = 64  # bytes
READS, WANTS_REPLY, REFUSED = 0x80, 0x40, 0x20  # flags
REPORT_S = 1e-3  # a report on USB: one interrupt transfer a millisecond
MODE_S = 3e-3  # a change of mode, a guess: long enough to catch who does not wait for it
LOAD_S = 105e-6  # all blocks of mirrors: the shortest exposure, and from start to the first pattern (DLPU018J, 2.4.4.1)
MOST_PATTERNS = 400  # of the table (DLPU018J, 2.4.4.3.3), and of the memory (DLPC900 data sheet DLPS037H)
MOST_IMAGES = 18  # (DLPU018J, 2.4.4.4.1)
LARGEST_IMAGE = 1 << 23  # bytes; more than an uncompressed image
LARGEST_CHUNK = 504
PULSE_US = 20  # of TRIG_OUT_2 without delays
ERROR_BYTES = (4, 6)  # of the reply about the last error: public drivers look in different places
FIRMWARE_TAG, FIRMWARE = b"LCR6500 simulated", (6, 0, 0)
DLP6500 = 1


class Pattern(NamedTuple):
    """An entry of the pattern table; exposure and dark time in us."""

    exposure: int
    dark: int
    waits: bool
    pulses: bool
    image: int
    bit: int

    @property
    def manner(self) -> tuple[int, bool, bool]:
        """What must be the same throughout a sequence."""
        return self.exposure + self.dark, self.waits, self.pulses


@dataclass
class Upload:
    """An image under way."""

    index: int
    size: int
    data: bytearray = field(default_factory=bytearray)


class VirtualDlpc900:
    """What a client of the controller can see."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._error = 0
        self._power_on()

    def _power_on(self) -> None:
        self.power = AWAKE
        self.mode = PRE_STORED
        self._coming: tuple[int, float] | None = None  # a mode, and when it is there
        self.running = STOP
        self._ends_s = np.inf  # of a sequence that was started
        self._begins_with = 0  # of the sequence's patterns, counted through all repetitions
        self.settings = {number: setting.values for number, setting in commands.SETTINGS.items()}
        self.patterns: dict[int, Pattern] = {}
        self.configured = 0
        self.to_display = 0
        self.images: dict[int, NDArray[np.uint16]] = {}  # for the present table alone
        self._places: list[tuple[int, int]] = []
        self._upload: Upload | None = None
        self.world.show(None)

    # --- packets

    def run(self, message: Message) -> Execution:
        """Execute a message of the transport: each unit's argument is a packet."""
        replies: list[Chunk] = [self.transact(bytes(unit.arguments[0])) for unit in message.units]  # type: ignore[arg-type]
        yield from ()
        return [reply for reply in replies if reply]

    def connection(self) -> AbstractContextManager[Connected]:
        """As every client has it."""
        return nullcontext(self)

    def listens(self, begun: bytes) -> bool:
        """There are no blocks."""
        return True

    def clear(self) -> None:
        """USB has no device clear."""

    def status_byte(self) -> int:
        """There is none."""
        return 0

    def transact(self, packet: bytes) -> bytes:
        """Execute one packet of whole reports; returns the reply, a report, or nothing if none was asked for."""
        self.world.clock.advance(REPORT_S * (len(packet) // REPORT))
        if self._coming is not None and self.world.clock.now >= self._coming[1]:
            self.mode, self._coming = self._coming[0], None
        flags, number, length, command = struct.unpack_from("<BBHH", packet)
        reads = bool(flags & READS)
        try:
            answer = self._read(command) if reads else self._write(command, packet[6 : 4 + length])
        except Refusal as refusal:
            self._error = int(refusal.args[0])
            flags |= REFUSED
            answer = b""
        else:
            if not (reads and command in (commands.LAST_ERROR, commands.ERROR_TEXT)):
                self._error = 0
        if not flags & WANTS_REPLY:
            return b""
        return (struct.pack("<BBH", flags, number, len(answer)) + answer).ljust(REPORT, b"\0")

    def _read(self, command: int) -> bytes:
        if command in self.settings:
            return struct.pack(commands.SETTINGS[command].layout, *self.settings[command])
        if command not in commands.READINGS:
            raise Refusal(commands.INVALID_COMMAND)
        answer: bytes = getattr(self, commands.READINGS[command].method)()
        return answer

    def _write(self, command: int, data: bytes) -> bytes:
        if command in self.settings:
            self._set(command, data)
        elif command not in commands.ACTIONS:
            raise Refusal(commands.INVALID_COMMAND)
        elif command == commands.LOAD_IMAGE:
            self.load(data)
        else:
            action = commands.ACTIONS[command]
            getattr(self, action.method)(*_unpacked(action.layout, data))
        return b""

    def _set(self, command: int, data: bytes) -> None:
        setting = commands.SETTINGS[command]
        values = _unpacked(setting.layout, data)
        if any(not low <= value <= high for value, (low, high) in zip(values, setting.limits, strict=True)):
            raise Refusal(commands.INVALID_PARAMETER)
        self._require(self.running == STOP)  # "before executing this command, stop the current pattern sequence"
        self.settings[command] = values
        if command == commands.IDLE:
            self.world.show(None)  # idle mode flips the mirrors all the time; here it is dark

    # --- what is read

    def last_error(self) -> bytes:
        """0x0100: of the command before."""
        answer = bytearray(max(ERROR_BYTES) - 3)
        for at in ERROR_BYTES:
            answer[at - 4] = self._error
        return bytes(answer)

    def error_text(self) -> bytes:
        """0x0101."""
        return commands.ERROR_TEXTS[self._error].encode() + b"\0"

    def firmware_version(self) -> bytes:
        """0x0205: application, API, software configuration, sequence configuration."""
        return struct.pack("<HBB", *FIRMWARE[::-1]) * 4

    def firmware_tag(self) -> bytes:
        """0x0206: which DMD, and the firmware's tag."""
        return bytes((DLP6500,)) + FIRMWARE_TAG + b"\0"

    def hardware_status(self) -> bytes:
        """0x1A0A: initialised, no fault."""
        return b"\x01"

    def system_status(self) -> bytes:
        """0x1A0B: memory test passed."""
        return b"\x01"

    def main_status(self) -> bytes:
        """0x1A0C: bit 0 mirrors parked, bit 1 sequencer running."""
        return bytes(((self.power == STANDBY) | self.active << 1,))

    def display_mode(self) -> bytes:
        """0x1A1B: the mode before, until a change has taken place."""
        return bytes((self.mode,))

    def configuration(self) -> bytes:
        """0x1A31."""
        return struct.pack("<HI", self.configured, self.to_display)

    @property
    def active(self) -> bool:
        """Whether the sequencer runs: a finite sequence ends by itself, and its last pattern stays."""
        if self.running != START or self.world.clock.now >= self._ends_s:
            return False
        waits = self.patterns[0].waits and self.to_display > 0
        return not waits or self._begins_with + self.world.pictures_shown() < self.to_display

    # --- what is done

    def set_power(self, state: int) -> None:
        """0x0200: awake, standby (mirrors parked), reset."""
        if state > RESET:
            raise Refusal(commands.INVALID_PARAMETER)
        if state == RESET:
            self._power_on()
        elif state != self.power:
            self.power, self.running = state, STOP
            self.world.show(None)

    def set_mode(self, mode: int) -> None:
        """0x1A1B: video, pre-stored, video pattern, pattern on the fly; takes a while and empties the pattern table."""
        if mode > ON_THE_FLY:
            raise Refusal(commands.INVALID_PARAMETER)
        if mode != self.mode:
            self._require(self.running == STOP)
            self._coming = mode, self.world.clock.now + MODE_S
            self.patterns.clear()
            self._places, self.images = [], {}
            self.configured = self.to_display = 0

    def define(self, index: int, exposure: bytes, options: int, dark: bytes, triggers: int, where: int) -> None:
        """0x1A34: entry `index` of the pattern table."""
        self._require(self.mode != VIDEO and self.running == STOP)
        if index >= MOST_PATTERNS:
            raise Refusal(commands.BAD_PATTERN_NUMBER)
        exposure_us = int.from_bytes(exposure, "little")
        if exposure_us < LOAD_S * 1e6:
            raise Refusal(commands.BAD_EXPOSURE)
        depth = (options >> 1 & 0b111) + 1
        image, bit = where & 0x7FF, where >> 11
        if bit + depth > planes.PLANES:
            raise Refusal(commands.BAD_BIT)
        if image >= MOST_IMAGES:
            raise Refusal(commands.BAD_IMAGE_ADDRESS)
        dark_us = int.from_bytes(dark, "little")
        self.patterns[index] = Pattern(exposure_us, dark_us, bool(options & 0x80), not triggers & 1, image, bit)

    def configure(self, count: int, to_display: int) -> None:
        """0x1A31: how many entries the table has, and how many patterns are displayed; 0: for ever."""
        self._require(self.mode != VIDEO and self.running == STOP)
        if not 1 <= count <= MOST_PATTERNS:
            raise Refusal(commands.BAD_PATTERN_NUMBER)
        if any(index not in self.patterns for index in range(count)):
            raise Refusal(commands.BAD_DEFINITION)
        self.configured, self.to_display = count, to_display
        places = [(self.patterns[index].image, self.patterns[index].bit) for index in range(count)]
        if places != self._places:
            self._places = places
            self.images.clear()  # "re-download the images ... whenever changes are made" (DLPU018J, 2.4.4.4.2)

    def announce(self, index: int, size: int) -> None:
        """0x1A2A: the image that comes, and its bytes."""
        self._require(self.mode == ON_THE_FLY and self.running == STOP)
        if index >= MOST_IMAGES:
            raise Refusal(commands.BAD_IMAGE_ADDRESS)
        if size > LARGEST_IMAGE:
            raise Refusal(commands.OUT_OF_MEMORY)
        self._upload = Upload(index, size)

    def load(self, data: bytes) -> None:
        """0x1A2B: bytes of the announced image, their number in front."""
        upload = self._upload
        if upload is None:
            raise Refusal(commands.NOT_IN_THIS_MODE)
        chunk = data[2:]
        if len(data) < 2 or len(chunk) > LARGEST_CHUNK or len(chunk) != int.from_bytes(data[:2], "little"):
            raise Refusal(commands.INVALID_PARAMETER)
        if len(upload.data) + len(chunk) > upload.size:
            raise Refusal(commands.INVALID_PARAMETER)
        upload.data += chunk
        if len(upload.data) == upload.size:
            self._upload = None
            try:
                self.images[upload.index] = planes.on_counts(planes.decode(bytes(upload.data)))
            except planes.BadImage:
                raise Refusal(commands.INVALID_COMPRESSION) from None

    def run_patterns(self, action: int) -> None:
        """0x1A24: stop (dark), pause (the pattern stays), start: from the beginning, or from where it was paused."""
        if action > START:
            raise Refusal(commands.INVALID_PARAMETER)
        if action == START:
            self._start()
        elif action == PAUSE:
            if not self.active:
                return
            self._begins_with += max(0, self.world.pictures_shown() - 1)
            self.world.hold()
        else:
            self._begins_with = 0
            if self.running != STOP:
                self.world.show(None)
        self.running = action

    def _start(self) -> None:
        self._require(self.mode != VIDEO and self.power == AWAKE and not self.settings[commands.IDLE][0])
        if not self.configured:
            raise Refusal(commands.BAD_DEFINITION)
        patterns = [self.patterns[index] for index in range(self.configured)]
        if len({pattern.manner for pattern in patterns}) > 1:
            raise Refusal(commands.BAD_DEFINITION)
        if not {pattern.image for pattern in patterns} <= self.images.keys():
            raise Refusal(commands.NOT_PRESENT if self.mode == ON_THE_FLY else commands.NOT_IN_FLASH)
        if self.running != PAUSE:
            self._begins_with = 0
        counts = np.stack([self.images[pattern.image][pattern.bit] for pattern in patterns])
        if self.settings[commands.INVERT][0]:
            counts = mirrors.inverted(counts)
        if self.settings[commands.FLIP_LONG_AXIS][0]:
            counts = mirrors.upside_down(counts)
        if self.settings[commands.FLIP_SHORT_AXIS][0]:
            counts = mirrors.left_for_right(counts)
        self.world.project(self._projection(np.roll(counts, -self._begins_with, axis=0), patterns[0]))
        self.world.clock.advance(LOAD_S)

    def _projection(self, counts: NDArray[np.uint16], pattern: Pattern) -> Projection:
        """The sequence from now on, all patterns in the manner of one; notes when it ends by itself."""
        low, rising_us, falling_us = self.settings[commands.TRIGGER_OUT_2]
        pulse_us = max(0, PULSE_US + falling_us - rising_us) if pattern.pulses else 0
        period_s = 1e-6 * (pattern.exposure + pattern.dark)
        start_s = self.world.clock.now + (0.0 if pattern.waits else LOAD_S)
        left = self.to_display - self._begins_with
        repeats = -(-left // len(counts)) if self.to_display else 1
        self._ends_s = start_s + left * period_s if self.to_display and not pattern.waits else np.inf
        return Projection(
            counts,
            start_s,
            period_s,
            synch_delay_s=1e-6 * rising_us,
            loop=not self.to_display,
            triggered=pattern.waits,
            synch_pulse_s=1e-6 * pulse_us,
            synch_high=not low,
            repeats=repeats,
            left_out=repeats * len(counts) - left if self.to_display else 0,
            trigger_delay_s=1e-6 * self.settings[commands.TRIGGER_IN_1][0],
        )

    def _require(self, allowed: bool) -> None:
        """Refuse what the mode or the state does not allow, a mode that is still to come included."""
        if not allowed or self._coming is not None:
            raise Refusal(commands.NOT_IN_THIS_MODE)


def _unpacked(layout: str, data: bytes) -> tuple[int, ...]:
    if len(data) != struct.calcsize(layout):
        raise Refusal(commands.INVALID_PARAMETER)
    return struct.unpack(layout, data)
