"""ViALUX DMD controllers (ALP-4) through the calls of the vendor's library.

The driver talks to `AlpLibrary`, a narrow part of the ALP API. Two things stand behind it: `ALP4lib` with the vendor's
library on a bench (extra `alp`), and `AlpOverVisa`, which sends the same calls as lines to a DMD served on the network,
the simulated one among them.
"""

import contextlib
import ctypes
import re
import time
from collections.abc import Callable, Iterable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from instruments.errors import InstrumentError, LinkError, NotConfigured, excerpt
from instruments.interfaces import BurstDmd
from instruments.values import Identity, Progress, Range
from instruments.visa import VisaLink

ALP_DEFAULT = 0
ALP_DEVICE_NUMBER = 2000
ALP_VERSION = 2001
ALP_AVAIL_MEMORY = 2003
ALP_DEV_DISPLAY_HEIGHT = 2057
ALP_DEV_DISPLAY_WIDTH = 2058
ALP_FIRSTFRAME = 2101
ALP_LASTFRAME = 2102
ALP_BIN_MODE = 2104
ALP_BIN_UNINTERRUPTED = 2106
ALP_DATA_FORMAT = 2110
ALP_DATA_BINARY_TOPDOWN = 2
ALP_MIN_PICTURE_TIME = 2211

RETURN_CODES = {
    1001: "the device is not online",
    1002: "the device is not idle",
    1003: "the device identifier is not valid",
    1004: "the device is already allocated",
    1005: "a parameter is not valid",
    1006: "the user data cannot be read",
    1007: "the memory is full",
    1008: "the sequence is in use",
    1009: "halted during a transfer",
    1010: "initialisation failed",
    1011: "communication failed: check the USB cable",
    1012: "the device was removed",
    1013: "the FPGA is not configured",
    1014: "the driver version does not fit the device",
    1018: "the DMD did not wake up",
    1019: "the driver is too old for the device",
    1020: "the memory was not initialised",
}
"""What the return codes of the ALP library mean (ALP-4 API description)."""

LOST = (1001, 1011, 1012)
"""Return codes of a device that cannot be reached."""
ALREADY_ALLOCATED = "1004"
MOST_MIRRORS = 1 << 13  # along a side
RETURN = re.compile(r"(\d{1,9})(?:,(-?\d{1,18}))?")
"""A reply on the network: the return code, and the value of an inquiry."""

SETTLING_S = 50e-6
"""Longer than a mirror needs: reset, flight and settling end within 13 us, the load of a frame within 44 us."""


SYNCH_PULSE_US = 20
"""The frame synchronisation pulse begins with the picture and ends when the mirrors have rested for microseconds."""


class AlpLibrary(Protocol):
    """The calls of the ALP API that the driver needs, named as ALP4lib names them."""

    def Initialize(self) -> None: ...  # noqa: N802, D102
    def DevInquire(self, inquire_type: int) -> int: ...  # noqa: N802, D102
    def SeqAlloc(self, pictures: int, bit_depth: int) -> int: ...  # noqa: N802, D102
    def SeqControl(self, sequence: int, control_type: int, value: int) -> None: ...  # noqa: N802, D102
    def SeqInquire(self, sequence: int, inquire_type: int) -> int: ...  # noqa: N802, D102
    def SeqPut(self, sequence: int, offset: int, frames: NDArray[np.uint8]) -> None: ...  # noqa: N802, D102
    def SeqTiming(self, sequence: int, picture_time_us: int, pulse_us: int) -> None: ...  # noqa: N802, D102
    def Run(self, sequence: int, *, loop: bool) -> None: ...  # noqa: N802, D102
    def Halt(self) -> None: ...  # noqa: N802, D102
    def FreeSeq(self, sequence: int) -> None: ...  # noqa: N802, D102
    def Free(self) -> None: ...  # noqa: N802, D102

    def close(self) -> None:
        """Release the connection, if there is one besides the allocated device."""


class AlpOverVisa:
    """The ALP calls as text lines: `ALP:SEQPUT id,offset,n,<block>` and so on; each reply is the return code."""

    def __init__(self, link: VisaLink) -> None:
        """Send the calls over `link`."""
        self._link = link

    def Initialize(self) -> None:  # noqa: N802
        """AlpDevAlloc; a device that a client has left behind allocated is freed first."""
        reply = self._link.query("ALP:DEVALLOC")
        if reply == ALREADY_ALLOCATED:
            self._call("ALP:DEVHALT")
            self._call("ALP:DEVFREE")
            reply = self._link.query("ALP:DEVALLOC")
        self._result("ALP:DEVALLOC", reply)

    def DevInquire(self, inquire_type: int) -> int:  # noqa: N802
        """AlpDevInquire."""
        return self._call(f"ALP:DEVINQUIRE {inquire_type}")

    def SeqAlloc(self, pictures: int, bit_depth: int) -> int:  # noqa: N802
        """AlpSeqAlloc; returns the sequence's identifier."""
        return self._call(f"ALP:SEQALLOC {bit_depth},{pictures}")

    def SeqControl(self, sequence: int, control_type: int, value: int) -> None:  # noqa: N802
        """AlpSeqControl."""
        self._call(f"ALP:SEQCONTROL {sequence},{control_type},{value}")

    def SeqInquire(self, sequence: int, inquire_type: int) -> int:  # noqa: N802
        """AlpSeqInquire."""
        return self._call(f"ALP:SEQINQUIRE {sequence},{inquire_type}")

    def SeqPut(self, sequence: int, offset: int, frames: NDArray[np.uint8]) -> None:  # noqa: N802
        """AlpSeqPut of `frames`, shape (n, rows, bytes a row)."""
        header = f"ALP:SEQPUT {sequence},{offset},{len(frames)},"
        self._result("ALP:SEQPUT", self._link.query_block(header, frames))

    def SeqTiming(self, sequence: int, picture_time_us: int, pulse_us: int) -> None:  # noqa: N802
        """AlpSeqTiming with the library's own illumination time and delays."""
        self._call(f"ALP:SEQTIMING {sequence},0,{picture_time_us},0,{pulse_us},0")

    def Run(self, sequence: int, *, loop: bool) -> None:  # noqa: N802
        """AlpProjStartCont, or AlpProjStart for once."""
        self._call(f"ALP:PROJSTART{'CONT' if loop else ''} {sequence}")

    def Halt(self) -> None:  # noqa: N802
        """AlpDevHalt."""
        self._call("ALP:DEVHALT")

    def FreeSeq(self, sequence: int) -> None:  # noqa: N802
        """AlpSeqFree."""
        self._call(f"ALP:SEQFREE {sequence}")

    def Free(self) -> None:  # noqa: N802
        """AlpDevFree."""
        self._call("ALP:DEVFREE")

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _call(self, line: str) -> int:
        return self._result(line, self._link.query(line))

    def _result(self, line: str, reply: str) -> int:
        call = line.split()[0]
        found = RETURN.fullmatch(reply)
        if found is None:
            raise InstrumentError(
                f"dmd: {call} was answered {excerpt(reply)}, not with a return code: check its address"
            )
        code, value = int(found[1]), int(found[2] or 0)
        if code != 0:
            failure = LinkError if code in LOST else InstrumentError
            raise failure(f"dmd: {call} returned {code}: {RETURN_CODES.get(code, 'unknown return code')}")
        return value


class AlpByVendorLibrary:
    """The ALP calls through ALP4lib and the vendor's shared library."""

    def __init__(self, version: str, library_folder: str | None) -> None:
        """Load the vendor's library.

        Raises:
            NotConfigured: ALP4lib or the vendor's library is not installed.
        """
        try:
            import ALP4
        except ImportError:
            raise NotConfigured("dmd: ALP4lib is not installed: pip install 'photonic-labctl[alp]'") from None
        try:
            self._alp: Any = ALP4.ALP4(version=version, libDir=library_folder)
        except OSError as error:
            raise NotConfigured(f"dmd: the ViALUX library for ALP {version} cannot be loaded: {error}") from None
        self._failure: type[Exception] = ALP4.ALPError

    def Initialize(self) -> None:  # noqa: N802
        """AlpDevAlloc of the first device."""
        self._call(self._alp.Initialize)

    def DevInquire(self, inquire_type: int) -> int:  # noqa: N802
        """AlpDevInquire."""
        value = self._call(self._alp.DevInquire, inquire_type)
        return int(getattr(value, "value", value))

    def SeqAlloc(self, pictures: int, bit_depth: int) -> int:  # noqa: N802
        """AlpSeqAlloc; returns the sequence's identifier."""
        return int(self._call(self._alp.SeqAlloc, nbImg=pictures, bitDepth=bit_depth).value)

    def SeqControl(self, sequence: int, control_type: int, value: int) -> None:  # noqa: N802
        """AlpSeqControl."""
        self._call(self._alp.SeqControl, control_type, value, SequenceId=ctypes.c_ulong(sequence))

    def SeqInquire(self, sequence: int, inquire_type: int) -> int:  # noqa: N802
        """AlpSeqInquire."""
        value = self._call(self._alp.SeqInquire, inquire_type, SequenceId=ctypes.c_ulong(sequence))
        return int(getattr(value, "value", value))

    def SeqPut(self, sequence: int, offset: int, frames: NDArray[np.uint8]) -> None:  # noqa: N802
        """AlpSeqPut of `frames`, shape (n, rows, bytes a row), taken from memory as they are."""
        data = np.ascontiguousarray(frames).ctypes.data_as(ctypes.POINTER(ctypes.c_ubyte))
        self._call(
            self._alp.SeqPut,
            data,
            SequenceId=ctypes.c_ulong(sequence),
            PicOffset=offset,
            PicLoad=len(frames),
            dataFormat="C",
        )

    def SeqTiming(self, sequence: int, picture_time_us: int, pulse_us: int) -> None:  # noqa: N802
        """AlpSeqTiming with the library's own illumination time and delays."""
        self._call(
            self._alp.SetTiming,
            SequenceId=ctypes.c_ulong(sequence),
            pictureTime=picture_time_us,
            synchPulseWidth=pulse_us,
        )

    def Run(self, sequence: int, *, loop: bool) -> None:  # noqa: N802
        """AlpProjStartCont, or AlpProjStart for once."""
        self._call(self._alp.Run, SequenceId=ctypes.c_ulong(sequence), loop=loop)

    def Halt(self) -> None:  # noqa: N802
        """AlpDevHalt."""
        self._call(self._alp.Halt)

    def FreeSeq(self, sequence: int) -> None:  # noqa: N802
        """AlpSeqFree."""
        self._call(self._alp.FreeSeq, ctypes.c_ulong(sequence))

    def Free(self) -> None:  # noqa: N802
        """AlpDevFree."""
        self._call(self._alp.Free)

    def close(self) -> None:
        """Nothing: the library's only connection is the allocated device."""

    def _call(self, function: Callable[..., Any], *arguments: object, **named: object) -> Any:
        try:
            return function(*arguments, **named)
        except self._failure as error:
            raise InstrumentError(f"dmd: {function.__name__} failed: {error}") from None


class VialuxAlp(BurstDmd):
    """A DMD behind the ALP library: a binary sequence of one picture to show, and one of many pictures to play.

    Pictures are shown without dark phase. A sequence in use cannot be loaded, so every `show` is halt, put, run: the
    order the API asks for.
    """

    def __init__(self, library: AlpLibrary) -> None:
        """Drive the device behind `library`; it is allocated at the first use."""
        self._alp = library
        self._sequence: int | None = None
        self._pictures: int | None = None

    @property
    def shape(self) -> tuple[int, int]:  # type: ignore[override]
        """Rows and columns of mirrors, as the device reports them."""
        self._prepare()
        return self._shape

    def identify(self) -> Identity:
        """Serial number and version by AlpDevInquire."""
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
        self._alp.Halt()
        self._alp.SeqPut(sequence, 0, mirrors[np.newaxis])
        self._alp.Run(sequence, loop=True)
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
        sequence = self._pictures = self._alp.SeqAlloc(count, 1)
        self._alp.SeqControl(sequence, ALP_DATA_FORMAT, ALP_DATA_BINARY_TOPDOWN)
        self._alp.SeqControl(sequence, ALP_BIN_MODE, ALP_BIN_UNINTERRUPTED)
        first = 0
        for block in mirrors:
            self._alp.SeqPut(sequence, first, block)
            first += len(block)
            if progress is not None:
                progress(first, count)

    def hold(self) -> None:
        """AlpDevHalt."""
        self._alp.Halt()

    def play(self, first: int, count: int, period_s: float, *, pulse_s: float | None = None) -> None:
        """Once from the first to the last picture, one every `period_s`, with a pulse (20 us) from its start on."""
        if self._pictures is None:
            raise InstrumentError("dmd: no pictures are loaded: load them before playing")
        shortest = self._alp.SeqInquire(self._pictures, ALP_MIN_PICTURE_TIME)
        period_us = round(period_s * 1e6)
        Range(shortest, 10_000_000, "us").check("time between pictures", period_us)
        self._alp.Halt()
        # The first picture must never lie behind the last one, not even between two calls.
        self._alp.SeqControl(self._pictures, ALP_FIRSTFRAME, 0)
        self._alp.SeqControl(self._pictures, ALP_LASTFRAME, first + count - 1)
        self._alp.SeqControl(self._pictures, ALP_FIRSTFRAME, first)
        self._alp.SeqTiming(self._pictures, period_us, SYNCH_PULSE_US if pulse_s is None else round(pulse_s * 1e6))
        self._alp.Run(self._pictures, loop=False)

    def settings(self) -> dict[str, str | float]:
        """Mirrors and free picture memory."""
        self._prepare()
        return {
            "rows": self._shape[0],
            "columns": self._shape[1],
            "free_pictures": self._alp.DevInquire(ALP_AVAIL_MEMORY),
        }

    def make_safe(self) -> None:
        """Every mirror off; a device that no longer knows this driver, after a loss of power say, is allocated anew."""
        try:
            self.blank()
        except LinkError:
            raise
        except InstrumentError:
            self._sequence = self._pictures = None
            with contextlib.suppress(InstrumentError):
                self._alp.Free()
            self.blank()

    def close(self) -> None:
        """Release the sequences and the device; the link is closed whatever the device answers."""
        sequence, self._sequence = self._sequence, None
        try:
            if sequence is not None:
                self._alp.Halt()
                self._free_pictures()
                self._alp.FreeSeq(sequence)
                self._alp.Free()
        finally:
            self._pictures = None
            self._alp.close()

    def _free_pictures(self) -> None:
        pictures, self._pictures = self._pictures, None
        if pictures is not None:
            self._alp.Halt()
            self._alp.FreeSeq(pictures)

    def _prepare(self) -> int:
        if self._sequence is None:
            self._alp.Initialize()
            self._shape = (self._mirrors(ALP_DEV_DISPLAY_HEIGHT), self._mirrors(ALP_DEV_DISPLAY_WIDTH))
            self._sequence = self._alp.SeqAlloc(1, 1)
            self._alp.SeqControl(self._sequence, ALP_DATA_FORMAT, ALP_DATA_BINARY_TOPDOWN)
            self._alp.SeqControl(self._sequence, ALP_BIN_MODE, ALP_BIN_UNINTERRUPTED)
        return self._sequence

    def _mirrors(self, side: int) -> int:
        """How many mirrors there are along a side.

        Raises:
            InstrumentError: so many as no DMD has.
        """
        mirrors = self._alp.DevInquire(side)
        if not 1 <= mirrors <= MOST_MIRRORS:
            raise InstrumentError(f"dmd: says that it has {mirrors} mirrors a side: check its address and its cable")
        return mirrors
