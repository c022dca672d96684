"""The calls of the ALP library that a DMD driver needs, by the vendor's library on USB or as lines on the network.

`ALP4lib` wraps the vendor's library (extra `alp`); `AlpOverVisa` sends the same calls to a DMD that is
served on the network, the simulated one among them.
"""

import ctypes
import re
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from instruments.errors import InstrumentError, LinkError, NotConfigured, excerpt
from instruments.visa import VisaLink

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
RETURN = re.compile(r"(\d{1,9})(?:,(-?\d{1,18}))?")
"""A reply on the network: the return code, and the value of an inquiry."""


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
    def ProjInquire(self, inquire_type: int) -> int: ...  # noqa: N802, D102
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

    def ProjInquire(self, inquire_type: int) -> int:  # noqa: N802
        """AlpProjInquire."""
        return self._call(f"ALP:PROJINQUIRE {inquire_type}")

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
            NotConfigured: ALP4lib or the vendor's library is not installed, or is another one.
        """
        try:
            import ALP4
        except ImportError:
            raise NotConfigured("dmd: ALP4lib is not installed: pip install 'photonic-labctl[alp]'") from None
        try:
            self._alp: Any = ALP4.ALP4(version=version, libDir=library_folder)
        except (OSError, AttributeError) as error:
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

    def ProjInquire(self, inquire_type: int) -> int:  # noqa: N802
        """AlpProjInquire."""
        value = self._call(self._alp.ProjInquire, inquire_type)
        return int(getattr(value, "value", value))

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
        except AttributeError as error:  # ctypes, of a function that is not in the library
            raise NotConfigured(
                f"dmd: the ViALUX library cannot {function.__name__} ({error}): install the one of the version in "
                "dmd.version"
            ) from None
