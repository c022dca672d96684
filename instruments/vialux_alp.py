"""ViALUX DMD controllers (ALP-4) through the calls of the vendor's library."""

import os
import re
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from instruments.alp_library import ALP_PROJ_STATE, AlpByVendorLibrary, AlpLibrary, AlpOverVisa
from instruments.driver import Driver, Opening
from instruments.errors import InstrumentError, LinkError
from instruments.interfaces import BurstDmd
from instruments.sections import USB, DmdSection, Text, Timeout
from instruments.values import Change, Identity, Progress, Range
from instruments.visa import VisaLink

LIBRARY_VARIABLE = "LABCTL_ALP_LIBRARY"
"""The environment variable with the folder of the vendor's library; a station file may repeat it and name no other."""


def _allowed(folder: str) -> str:
    allowed = os.environ.get(LIBRARY_VARIABLE)
    if not allowed or Path(folder).resolve() != Path(allowed).resolve():
        raise ValueError(
            f"code is loaded from where its operator says, not a station file: set the environment variable "
            f"{LIBRARY_VARIABLE} to this folder, if it is the vendor's"
        )
    return folder


class VialuxAlpSection(DmdSection):
    """The micromirror device. `version` and `library` name the vendor's ALP library on a real bench."""

    version: Annotated[
        Literal["4.1", "4.2", "4.3", "4.4", "5.0", "5.1"], Field(description="Version of the vendor's ALP library.")
    ] = "4.3"
    library: Annotated[
        Annotated[Text, AfterValidator(_allowed)] | None,
        Field(
            description=f"Folder of the vendor's ALP library, as {LIBRARY_VARIABLE} has it; without both the system's."
        ),
    ] = None
    serial_number: Annotated[
        int | None, Field(ge=1, lt=1 << 31, description="Serial number of the device, where there are several.")
    ] = None
    trigger_in: Annotated[
        Literal["rising", "falling"] | None,
        Field(description="Edge at the trigger input that shows the next picture of a burst; without, its own clock."),
    ] = None
    timeout: Timeout = 5.0


IDENTITY = re.compile("ViALUX ALP", re.IGNORECASE)

DRIVER = Driver(
    section=VialuxAlpSection,
    open=lambda section, opening: VialuxAlp(
        _library(section, opening), serial_number=section.serial_number, trigger_in=section.trigger_in
    ),
    identity=IDENTITY,
    sent_anew=("free_pictures",),
)

ALP_DEFAULT = 0
ALP_DEVICE_NUMBER = 2000
ALP_VERSION = 2001
ALP_AVAIL_MEMORY = 2003
ALP_TRIGGER_EDGE = 2005
TRIGGER_EDGES = {"falling": 2008, "rising": 2009}
ALP_DEV_DISPLAY_HEIGHT = 2057
ALP_DEV_DISPLAY_WIDTH = 2058
ALP_DEV_DMD_MODE = 2064
ALP_SEQ_REPEAT = 2100
ALP_FIRSTFRAME = 2101
ALP_LASTFRAME = 2102
ALP_BIN_MODE = 2104
ALP_BIN_UNINTERRUPTED = 2106
ALP_DATA_FORMAT = 2110
ALP_DATA_BINARY_TOPDOWN = 2
ALP_MIN_PICTURE_TIME = 2211
ALP_PROJ_MODE = 2300
ALP_MASTER = 2301
ALP_SLAVE = 2302
ALP_PROJ_INVERSION = 2306
ALP_PROJ_UPSIDE_DOWN = 2307
ALP_PROJ_ACTIVE = 1200
MOST_MIRRORS = 1 << 13  # along a side

SETTLING_S = 50e-6
"""How long mirrors take to rest behind the start of a picture: an assumption, to be measured on the bench.

The load of a frame takes 44 us (picture rate of the ALP-4 controllers), reset, flight and settling 13 us by a published
model of the mirrors; no source gives the two together, and nobody has measured them here.
"""
SYNCH_PULSE_US = 20
"""The frame synchronisation pulse begins with the picture and ends when the mirrors have rested for microseconds."""


class VialuxAlp(BurstDmd):
    """A DMD behind the ALP library: a binary sequence of one picture to show, and one of many pictures to play.

    Pictures are shown without dark phase: AlpSeqTiming activates the binary mode that AlpSeqControl has set, so it
    follows it, also where its own defaults are wanted (vendor's sample in C). A sequence in use cannot be loaded, so
    every `show` is halt, put, run: the order the API asks for. AlpProjHalt keeps the picture on the mirrors; AlpDevHalt
    would park them (a public wrapper for MATLAB says so).
    """

    picture_period_s = 44e-6
    """22 727 pictures a second, the most of a DLP7000; a device that needs longer says so when it is to play."""
    pulse_s = SYNCH_PULSE_US * 1e-6
    settling_s = SETTLING_S

    def __init__(
        self,
        library: AlpLibrary,
        *,
        serial_number: int | None = None,
        trigger_in: Literal["rising", "falling"] | None = None,
    ) -> None:
        """Drive the device with a serial number behind `library`, or any; it is allocated at the first use.

        trigger_in: the edge at the trigger input that shows the next picture of those that are played.
        """
        self._alp = library
        self._serial_number = serial_number
        self._trigger_in = trigger_in
        self._slave = False
        self._sequence: int | None = None
        self._pictures: int | None = None
        self._rounds = 1
        self._showing = False  # one picture for ever

    @property
    def shape(self) -> tuple[int, int]:  # type: ignore[override]
        """Rows and columns of mirrors, as the device reports them."""
        self._prepare()
        return self._shape

    def identify(self) -> Identity:
        """Serial number and version by AlpDevInquire.

        Another instrument at the address is told no call, which it would keep as an error: it is who it says.
        """
        said = self._alp.said()
        if said is not None and IDENTITY.search(f"{said.manufacturer} {said.model}") is None:
            return said
        self._prepare()
        serial, version = (str(self._alp.DevInquire(item)) for item in (ALP_DEVICE_NUMBER, ALP_VERSION))
        return Identity("ViALUX", f"ALP-4 {self._shape[1]}x{self._shape[0]}", serial, version)

    def self_test(self) -> None:
        """Turn every mirror away and ask how much memory is left: no light reaches the fibre."""
        self.blank()
        if self._alp.DevInquire(ALP_AVAIL_MEMORY) <= 0:
            raise InstrumentError("dmd: no memory left for a picture: free it in the vendor's software")

    def show(self, mirrors: NDArray[np.uint8]) -> None:
        """Halt, load the picture, run, and wait until the mirrors rest."""
        sequence = self._prepare()
        self._halt()
        if self._slave:
            self._obey_trigger(slave=False)
        self._alp.SeqPut(sequence, 0, mirrors[np.newaxis])
        self._alp.Run(sequence, loop=True)
        self._showing = True
        time.sleep(SETTLING_S)

    def blank(self) -> None:
        """Show a picture with every mirror off."""
        self._prepare()
        self.show(np.zeros((self._shape[0], self._shape[1] // 8), np.uint8))

    def capacity(self) -> int:
        """AlpDevInquire of the free memory, in binary pictures."""
        self._prepare()
        self._free_pictures()
        return self._alp.DevInquire(ALP_AVAIL_MEMORY)

    def load(self, mirrors: Iterable[NDArray[np.uint8]], count: int, *, progress: Progress | None = None) -> None:
        """A new sequence of `count` pictures, put block by block."""
        room = self.capacity()
        Range(1, room, "pictures").check("pictures in the DMD's memory", count)
        sequence = self._pictures = self._allocate(count)
        self._rounds = 1
        first = 0
        for block in mirrors:
            self._alp.SeqPut(sequence, first, block)
            first += len(block)
            if progress is not None:
                progress(first, count)

    def hold(self) -> None:
        """AlpProjHalt."""
        self._halt()

    def play(self, first: int, count: int, period_s: float, *, rounds: int = 1, pulse_s: float | None = None) -> None:
        """From the first to the last picture, one every `period_s`, with a pulse (20 us) from its start on; in rounds.

        With `trigger_in` each edge shows the next one, if it comes `period_s` after the one before or later.
        """
        if self._pictures is None:
            raise InstrumentError("dmd: no pictures are loaded: load them before playing")
        shortest = self._alp.SeqInquire(self._pictures, ALP_MIN_PICTURE_TIME)
        period_us = round(period_s * 1e6)
        Range(shortest, 10_000_000, "us").check("time between pictures", period_us)
        self._halt()
        # The first picture must never lie behind the last one, not even between two calls.
        self._alp.SeqControl(self._pictures, ALP_FIRSTFRAME, 0)
        self._alp.SeqControl(self._pictures, ALP_LASTFRAME, first + count - 1)
        self._alp.SeqControl(self._pictures, ALP_FIRSTFRAME, first)
        if rounds != self._rounds:
            self._alp.SeqControl(self._pictures, ALP_SEQ_REPEAT, rounds)
            self._rounds = rounds
        self._alp.SeqTiming(self._pictures, period_us, SYNCH_PULSE_US if pulse_s is None else round(pulse_s * 1e6))
        if self._trigger_in is not None:
            self._alp.DevControl(ALP_TRIGGER_EDGE, TRIGGER_EDGES[self._trigger_in])
            self._obey_trigger(slave=True)
        self._alp.Run(self._pictures, loop=False)

    def changes(self) -> tuple[Change, ...]:
        """What turns pictures into others, or delays them: mirrors, trigger, inversion, direction, format, a halt."""
        if self._sequence is None:
            return ()
        wanted = {
            "mode of the mirrors": (ALP_DEFAULT, self._alp.DevInquire(ALP_DEV_DMD_MODE)),
            "projection mode": (ALP_SLAVE if self._slave else ALP_MASTER, self._alp.ProjInquire(ALP_PROJ_MODE)),
            "inversion": (ALP_DEFAULT, self._alp.ProjInquire(ALP_PROJ_INVERSION)),
            "direction": (ALP_DEFAULT, self._alp.ProjInquire(ALP_PROJ_UPSIDE_DOWN)),
        }
        for sequence in (self._sequence, self._pictures):
            if sequence is not None:
                found = self._alp.SeqInquire(sequence, ALP_DATA_FORMAT)
                wanted[f"data format of sequence {sequence}"] = ALP_DATA_BINARY_TOPDOWN, found
        if self._showing:
            wanted["projection"] = ALP_PROJ_ACTIVE, self._alp.ProjInquire(ALP_PROJ_STATE)
        return tuple(Change(name, str(then), str(now)) for name, (then, now) in wanted.items() if now != then)

    def settings(self) -> dict[str, str | float]:
        """Mirrors and free picture memory."""
        self._prepare()
        return {
            "rows": self._shape[0],
            "columns": self._shape[1],
            "free_pictures": self._alp.DevInquire(ALP_AVAIL_MEMORY),
        }

    def make_safe(self) -> None:
        """Every mirror off; a device that no longer knows this driver, after a loss of power say, is allocated anew.

        Whatever turned pictures into others is set back first: a dark picture that is inverted would be all light.
        """
        try:
            sequence = self._prepare()
            self._halt()
            self._alp.SeqControl(sequence, ALP_DATA_FORMAT, ALP_DATA_BINARY_TOPDOWN)
            self._alp.DevControl(ALP_DEV_DMD_MODE, ALP_DEFAULT)
            self._obey_trigger(slave=False)
            self._alp.ProjControl(ALP_PROJ_INVERSION, ALP_DEFAULT)
            self._alp.ProjControl(ALP_PROJ_UPSIDE_DOWN, ALP_DEFAULT)
            self.blank()
        except LinkError:
            raise
        except InstrumentError:
            self._sequence = self._pictures = None
            self._alp.close()
            self.blank()

    def close(self) -> None:
        """Release the sequences and the device; the link is closed whatever the device answers."""
        sequence, self._sequence = self._sequence, None
        try:
            if sequence is not None:
                self._halt()
                self._free_pictures()
                self._alp.FreeSeq(sequence)
                self._alp.Free()
        finally:
            self._pictures = None
            self._alp.close()

    def _halt(self) -> None:
        self._showing = False
        self._alp.ProjHalt()

    def _free_pictures(self) -> None:
        pictures, self._pictures = self._pictures, None
        if pictures is not None:
            self._halt()
            self._alp.FreeSeq(pictures)

    def _obey_trigger(self, *, slave: bool) -> None:
        """Whether pictures wait for edges at the trigger input; while nothing is projected."""
        self._alp.ProjControl(ALP_PROJ_MODE, ALP_SLAVE if slave else ALP_MASTER)
        self._slave = slave

    def _prepare(self) -> int:
        if self._sequence is None:
            self._alp.Initialize(self._serial_number)
            try:
                self._shape = (self._mirrors(ALP_DEV_DISPLAY_HEIGHT), self._mirrors(ALP_DEV_DISPLAY_WIDTH))
                self._sequence = self._allocate(1)
            except InstrumentError:
                self._alp.close()
                raise
            self._slave = False  # as every device is that was just allocated
        return self._sequence

    def _allocate(self, pictures: int) -> int:
        """A sequence that takes packed bits and shows each picture until the next."""
        sequence = self._alp.SeqAlloc(pictures, 1)
        self._alp.SeqControl(sequence, ALP_DATA_FORMAT, ALP_DATA_BINARY_TOPDOWN)
        self._alp.SeqControl(sequence, ALP_BIN_MODE, ALP_BIN_UNINTERRUPTED)
        self._alp.SeqTiming(sequence, ALP_DEFAULT, ALP_DEFAULT)
        return sequence

    def _mirrors(self, side: int) -> int:
        """How many mirrors there are along a side.

        Raises:
            InstrumentError: so many as no DMD has.
        """
        mirrors = self._alp.DevInquire(side)
        if not 1 <= mirrors <= MOST_MIRRORS:
            raise InstrumentError(f"dmd: says that it has {mirrors} mirrors a side: check its address and its cable")
        return mirrors


def _library(section: VialuxAlpSection, opening: Opening) -> AlpLibrary:
    """The vendor's own on USB, or lines to a device that is served on the network."""
    if opening.address == USB:
        return AlpByVendorLibrary(section.version, os.environ.get(LIBRARY_VARIABLE))
    return AlpOverVisa(VisaLink(opening.address, name="dmd", timeout_s=section.timeout, transcript=opening.transcript))
