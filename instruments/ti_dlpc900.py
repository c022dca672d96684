"""TI DLPC900 DMD controllers (LightCrafter 6500), on USB or served on the network.

Source: TI DLPC900 programmer's guide (DLPU018J; sections beside the commands), its data sheet (DLPS037H), TI's own API
source for idle mode and flips, instrument facts 4.3.
"""

import struct
import time
from collections.abc import Iterable, Iterator
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from instruments import dlpc900_image
from instruments.dlpc900_commands import Commands
from instruments.dlpc900_reports import SERVED, reports
from instruments.driver import Driver
from instruments.errors import InstrumentError
from instruments.interfaces import BurstDmd
from instruments.sections import SIMULATED, USB, Address, DmdSection, Timeout
from instruments.values import Change, Identity, Progress, Range


def _reachable(address: str) -> str:
    if address not in (USB, SIMULATED) and SERVED.fullmatch(address) is None:
        raise ValueError(
            f"a DLPC900 is on USB, or served on a raw socket: write {USB!r}, or an address such as "
            "TCPIP0::192.0.2.1::5025::SOCKET"
        )
    return address


class TiDlpc900Section(DmdSection):
    """The micromirror device, on USB or served on the network."""

    address: Annotated[
        Address,
        AfterValidator(_reachable),
        Field(description='"usb", "simulated", or the raw socket at which its reports are served.'),
    ] = USB
    timeout: Timeout = 5.0


DRIVER = Driver(
    section=TiDlpc900Section,
    open=lambda section, opening: TiDlpc900(
        Commands(reports(opening.address, section.timeout, opening.transcript), opening.transcript)
    ),
    sent_anew=("display_mode",),
)

POWER, FIRMWARE_VERSION, FIRMWARE_TYPE = 0x0200, 0x0205, 0x0206  # 2.3.1.1, 2.1.4, 2.1.5
HARDWARE_STATUS, SYSTEM_STATUS, MAIN_STATUS = 0x1A0A, 0x1A0B, 0x1A0C  # 2.1.1, 2.1.2, 2.1.3
IDLE, FLIP_LONG_AXIS, FLIP_SHORT_AXIS = 0x0201, 0x1008, 0x1009
DISPLAY_MODE, RUN = 0x1A1B, 0x1A24  # 2.4.1, 2.4.4.3.1
TRIGGER_OUT_2, INVERT = 0x1A1E, 0x1A30
ANNOUNCE_IMAGE, LOAD_IMAGE = 0x1A2A, 0x1A2B  # 2.4.4.4.1, 2.4.4.4.2: images count for the table they came after
CONFIGURE_PATTERNS, DEFINE_PATTERN = 0x1A31, 0x1A34  # 2.4.4.3.3, 2.4.4.3.5

AWAKE = b"\0"
PATTERN_ON_THE_FLY = b"\3"
NOT_INVERTED = NOT_IDLE = NOT_FLIPPED = b"\0"
STOP, PAUSE, START = b"\0", b"\1", b"\2"
FOR_EVER = 0
ALL_COLOURS = 0b111
NO_PULSE = 1
PARKED, RUNNING = 1, 2
"""Bits of the main status."""

IMAGE_CHUNK = 504
"""Bytes of image data in one command."""
BURST_IMAGES = 16
"""Images with pictures to play: the memory holds 400 binary patterns (DLPS037H)."""

SHORTEST_US = 105
"""The shortest exposure of a binary pattern on all blocks of a DLP6500 (DLPU018J, DMD block load)."""
LONGEST_US = 2**24 - 1
EXPOSURE_US = 100_000
"""How long a picture is shown before it is shown again. Any time will do: the picture is static."""
PULSE_US = 20
"""The pulse of TRIG_OUT_2, without delays of its edges."""
LONGEST_DELAY_US = 20_000

MODE_POLL_S = 0.01
MODE_TIMEOUT_S = 10.0
"""A change to video pattern mode takes 0.3 s (DLPU018J, 2.4.1); other times are not documented."""
ROWS, COLUMNS = 1080, 1920  # of a DLP6500
DLP6500 = 1
DMDS = {DLP6500: "DLP6500", 2: "DLP9000", 3: "DLP670S", 4: "DLP500YX", 5: "DLP5500"}
"""What the controller says it drives (2.1.5)."""

HARDWARE_FAULTS = {
    1: "controller and DMD do not fit",
    2: "DMD reset controller error",
    3: "forced swap error",
    6: "sequence aborted",
    7: "sequencer error",
}
"""Bits of the hardware status that report a fault; bit 0 is set once the controller has initialised itself."""


class _Pattern(NamedTuple):
    """An entry of the pattern table: a plane of an image, and how it is shown."""

    image: int
    bit: int
    exposure_us: int
    pulse: bool

    def packed(self, index: int) -> bytes:
        """As `DEFINE_PATTERN` wants it: one bit, all colours, no trigger in, no dark time."""
        exposure = self.exposure_us.to_bytes(3, "little")
        where = self.image | self.bit << 11
        return struct.pack("<H3sB3xBH", index, exposure, ALL_COLOURS << 4, 0 if self.pulse else NO_PULSE, where)


class TiDlpc900(BurstDmd):
    """A DLPC900 in pattern-on-the-fly mode: one binary picture for ever, or pictures in turn with TRIG_OUT_2 pulses."""

    shape = (ROWS, COLUMNS)
    picture_period_s = SHORTEST_US * 1e-6
    pulse_s = PULSE_US * 1e-6
    settling_s = picture_period_s

    def __init__(self, commands: Commands) -> None:
        """Drive the controller that takes `commands`."""
        self._commands = commands
        self._images: list[bytes] = []  # of the pictures to play
        self._loaded = 0  # pictures in them
        self._downloaded: range | None = None  # the pictures that the controller has, under its present table
        self._showing = False  # one picture for ever
        self._wanted: dict[str, tuple[int, bytes]] = {}

    def identify(self) -> Identity:
        """Firmware tag and version; the controller has no serial number to ask for.

        Raises:
            InstrumentError: its DMD is not a DLP6500.
        """
        dmd, *text = self._commands.read(FIRMWARE_TYPE)
        if dmd != DLP6500:
            raise InstrumentError(
                f"dmd: the DLPC900 drives a {DMDS.get(dmd, f'DMD of unknown type {dmd}')}, and the driver ti-dlpc900 "
                f"is for the {DMDS[DLP6500]}, {COLUMNS} x {ROWS} mirrors, only: use another driver"
            )
        tag = bytes(text).split(b"\0")[0].decode("ascii", "replace")
        patch, minor, major = struct.unpack("<HBB", self._commands.read(FIRMWARE_VERSION)[:4])
        return Identity("Texas Instruments", f"DLPC900 {COLUMNS}x{ROWS}", "", f"{tag} {major}.{minor}.{patch}".strip())

    def self_test(self) -> None:
        """Turn every mirror away and read the controller's status."""
        self.blank()
        status = self._commands.read(HARDWARE_STATUS)[0]
        faults = [text for bit, text in HARDWARE_FAULTS.items() if status >> bit & 1]
        if not status & 1:
            faults.append("the controller has not initialised itself")
        if not self._commands.read(SYSTEM_STATUS)[0] & 1:
            faults.append("memory test failed")
        if faults:
            raise InstrumentError(f"dmd: {'; '.join(faults)}: switch the controller off and on")

    def show(self, mirrors: NDArray[np.uint8]) -> None:
        """Stop, define one pattern without pulse, load its image, start."""
        if mirrors.shape != (ROWS, COLUMNS // 8):
            raise InstrumentError(f"dmd: a picture of {mirrors.shape} bytes: give ({ROWS}, {COLUMNS // 8}) packed bits")
        self._prepare(PULSE_US)
        self._downloaded = None
        self._define([_Pattern(0, 0, EXPOSURE_US, pulse=False)], FOR_EVER)
        self._download([dlpc900_image.encode(mirrors[np.newaxis])])
        self._commands.write(RUN, START)
        self._showing = True

    def blank(self) -> None:
        """Show a picture with every mirror off."""
        self.show(np.zeros((ROWS, COLUMNS // 8), np.uint8))

    def capacity(self) -> int:
        """Twenty-four pictures an image."""
        return BURST_IMAGES * dlpc900_image.PLANES

    def load(self, mirrors: Iterable[NDArray[np.uint8]], count: int, *, progress: Progress | None = None) -> None:
        """Images of 24 pictures, made now and kept here: the controller forgets images when its table changes."""
        Range(1, self.capacity(), "pictures").check("pictures in the DMD's memory", count)
        self._loaded, self._images, self._downloaded = 0, [], None
        for pictures in _by_images(mirrors):
            self._images.append(dlpc900_image.encode(pictures))
            if progress is not None:
                progress(min(count, len(self._images) * dlpc900_image.PLANES), count)
        self._loaded = count

    def hold(self) -> None:
        """Pause the sequence, if one runs."""
        self._showing = False
        if self._commands.read(MAIN_STATUS)[0] & RUNNING:
            self._commands.write(RUN, PAUSE)

    def play(self, first: int, count: int, period_s: float, *, rounds: int = 1, pulse_s: float | None = None) -> None:
        """Define the pictures as patterns of one period each, download and start them; without a `pulse_s` it is 20 us.

        Images must be downloaded again whenever the number of entries, or the place of one, changes (2.4.4.4.2): for
        the pictures that were played last they are not.
        """
        if not self._loaded:
            raise InstrumentError("dmd: no pictures are loaded: load them before playing")
        Range(1, self._loaded - first, "pictures").check("pictures to play", count)
        period_us = round(period_s * 1e6)
        Range(SHORTEST_US, LONGEST_US, "us").check("time between pictures", period_us)
        pulse_us = PULSE_US if pulse_s is None else round(pulse_s * 1e6)
        Range(1, min(period_us, PULSE_US + LONGEST_DELAY_US), "us").check("pulse of a picture", pulse_us)
        self._prepare(pulse_us)
        pictures = range(first, first + count)
        used = range(first // dlpc900_image.PLANES, pictures[-1] // dlpc900_image.PLANES + 1)
        places = [divmod(picture - used[0] * dlpc900_image.PLANES, dlpc900_image.PLANES) for picture in pictures]
        self._define([_Pattern(image, bit, period_us, pulse=True) for image, bit in places], rounds * count)
        if self._downloaded != pictures:
            self._downloaded = None
            self._download([self._images[image] for image in used])
            self._downloaded = pictures
        self._commands.write(RUN, START)

    def changes(self) -> tuple[Change, ...]:
        """What turns pictures into others or keeps pulses away.

        Idle, mode, inversion, flips, pulse, mirrors parked, no sequence.
        """
        found = [
            Change(name, then.hex(" "), now.hex(" "))
            for name, (command, then) in self._wanted.items()
            if (now := self._commands.read(command)[: len(then)]) != then
        ]
        status = self._commands.read(MAIN_STATUS)[0] if self._wanted else 0
        if status & PARKED:
            found.append(Change("mirrors", "in use", "parked"))
        if self._showing and not status & RUNNING:
            found.append(Change("sequence", "running", "stopped"))
        return tuple(found)

    def settings(self) -> dict[str, str | float]:
        """Mirrors and display mode."""
        return {"rows": ROWS, "columns": COLUMNS, "display_mode": self._commands.read(DISPLAY_MODE)[0]}

    def make_safe(self) -> None:
        """Every mirror off."""
        self.blank()

    def close(self) -> None:
        """Release the device."""
        self._commands.close()

    def _prepare(self, pulse_us: int) -> None:
        """Awake, stopped, not idle, in the mode whose images come over the link, with pulses of so long."""
        self._showing = False
        self._commands.write(POWER, AWAKE)
        self._commands.write(RUN, STOP)
        self._commands.write(IDLE, NOT_IDLE)
        self._wanted = {
            "display mode": (DISPLAY_MODE, PATTERN_ON_THE_FLY),
            "idle mode": (IDLE, NOT_IDLE),
            "inversion": (INVERT, NOT_INVERTED),
            "flip across the long axis": (FLIP_LONG_AXIS, NOT_FLIPPED),
            "flip across the short axis": (FLIP_SHORT_AXIS, NOT_FLIPPED),
            "trigger output 2": (TRIGGER_OUT_2, struct.pack("<Bhh", 0, 0, pulse_us - PULSE_US)),
        }
        for command, data in self._wanted.values():
            if self._commands.read(command)[: len(data)] != data:
                self._downloaded = None  # a change of mode empties the table
                self._commands.write(command, data)
                self._await(command, data)
                self._commands.write(RUN, STOP)  # a change of mode may have started the last sequence again

    def _await(self, command: int, data: bytes) -> None:
        """Return when the controller reads back what it was set to: a change of mode takes its time.

        Raises:
            InstrumentError: it does not within `MODE_TIMEOUT_S`.
        """
        ends = time.monotonic() + MODE_TIMEOUT_S
        while self._commands.read(command)[: len(data)] != data:
            if time.monotonic() > ends:
                raise InstrumentError(
                    f"dmd: 0x{command:04X} does not become {data.hex(' ')} within {MODE_TIMEOUT_S:g} s: switch the "
                    f"controller off and on"
                )
            time.sleep(MODE_POLL_S)

    def _define(self, patterns: list[_Pattern], to_display: int) -> None:
        for index, pattern in enumerate(patterns):
            self._commands.send(DEFINE_PATTERN, pattern.packed(index))
        self._commands.check(DEFINE_PATTERN)
        self._commands.write(CONFIGURE_PATTERNS, struct.pack("<HI", len(patterns), to_display))

    def _download(self, images: list[bytes]) -> None:
        """To the places 0, 1, ..., the last one first."""
        for index, image in reversed(list(enumerate(images))):
            self._commands.write(ANNOUNCE_IMAGE, struct.pack("<HI", index, len(image)))
            for start in range(0, len(image), IMAGE_CHUNK):
                chunk = image[start : start + IMAGE_CHUNK]
                self._commands.send(LOAD_IMAGE, struct.pack("<H", len(chunk)) + chunk)
            self._commands.check(LOAD_IMAGE)


def _by_images(blocks: Iterable[NDArray[np.uint8]]) -> Iterator[NDArray[np.uint8]]:
    """The pictures of blocks, 24 at a time; the last ones may be fewer."""
    rest = np.empty((0, ROWS, COLUMNS // 8), np.uint8)
    for block in blocks:
        rest = np.concatenate([rest, block])
        while len(rest) >= dlpc900_image.PLANES:
            yield rest[: dlpc900_image.PLANES]
            rest = rest[dlpc900_image.PLANES :]
    if len(rest):
        yield rest
