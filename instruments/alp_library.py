"""The calls of the ALP library that a DMD driver needs, by the vendor's library on USB or as lines on the network.

`ALP4lib` wraps the vendor's library (extra `alp`); `AlpOverVisa` sends the same calls to a DMD that is
served on the network, the simulated one among them.
"""

import contextlib
import ctypes
import logging
import re
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from instruments.errors import InstrumentError, InstrumentInUse, LinkError, NotConfigured, excerpt
from instruments.values import Identity
from instruments.visa import VisaLink

RETURN_CODES = {
    1001: "the device is not there or not ready: check its power, its cable and dmd.serial_number",
    1002: "the device is not idle",
    1003: "the device is not allocated, or not any more",
    1004: "in use: another program has the device allocated: wait for it, or end it",
    1005: "a parameter is not valid",
    1006: "the user data cannot be read",
    1007: "the memory is full",
    1008: "the sequence is in use",
    1009: "halted during a transfer",
    1010: "initialisation failed: switch the device off and on",
    1011: "communication failed: check the USB cable",
    1012: "the device was removed: check the USB cable",
    1013: "the FPGA is not configured",
    1014: "the driver version does not fit the device",
    1018: "the DMD did not wake up",
    1019: "the driver is too old for the device: install a newer one, then switch the device off and on",
    1020: "the memory was not initialised",
    1021: "the device is not configured for this call with these parameters",
    1999: "unknown error of the vendor's library",
}
"""What the return codes of the ALP library mean (ALP-4 API description; 1021 and 1999: alp.h of ALP-5)."""

OK = 0
NOT_ALLOCATED, ALLOCATED = 1003, 1004
LOST = (1001, 1011, 1012)
"""Return codes of a device that cannot be reached."""
ALP_PROJ_STATE, ALP_PROJ_IDLE = 2400, 1201
HALTING_S = 5.0
"""Longer than a projection takes to end: 10 to 50 ms, by a public program in C that waits for it as long."""
RETURN = re.compile(r"(\d{1,9})(?:,(-?\d{1,18}))?")
"""A reply on the network: the return code, and the value of an inquiry."""

_logger = logging.getLogger(__name__)


class AlpLibrary(Protocol):
    """The calls of the ALP API that the driver needs, named as ALP4lib names them."""

    def Initialize(self, serial_number: int | None) -> None: ...  # noqa: N802, D102
    def DevInquire(self, inquire_type: int) -> int: ...  # noqa: N802, D102
    def DevControl(self, control_type: int, value: int) -> None: ...  # noqa: N802, D102
    def SeqAlloc(self, pictures: int, bit_depth: int) -> int: ...  # noqa: N802, D102
    def SeqControl(self, sequence: int, control_type: int, value: int) -> None: ...  # noqa: N802, D102
    def SeqInquire(self, sequence: int, inquire_type: int) -> int: ...  # noqa: N802, D102
    def SeqPut(self, sequence: int, offset: int, frames: NDArray[np.uint8]) -> None: ...  # noqa: N802, D102
    def SeqTiming(self, sequence: int, picture_time_us: int, pulse_us: int) -> None: ...  # noqa: N802, D102
    def Run(self, sequence: int, *, loop: bool) -> None: ...  # noqa: N802, D102
    def ProjHalt(self) -> None: ...  # noqa: N802, D102
    def ProjInquire(self, inquire_type: int) -> int: ...  # noqa: N802, D102
    def ProjControl(self, control_type: int, value: int) -> None: ...  # noqa: N802, D102
    def FreeSeq(self, sequence: int) -> None: ...  # noqa: N802, D102
    def Free(self) -> None: ...  # noqa: N802, D102

    def said(self) -> Identity | None:
        """Who says to be there, asked without a call; None where nothing but a device can be."""

    def close(self) -> None:
        """Release the device if it is still allocated, and the connection."""


def failure(call: str, code: int) -> InstrumentError:
    """The error that a return code is, in one line; a `LinkError` where the device cannot be reached."""
    kind = LinkError if code in LOST else InstrumentInUse if code == ALLOCATED else InstrumentError
    return kind(f"dmd: {call} returned {code}: {RETURN_CODES.get(code, 'a return code that nobody has described')}")


class AlpOverVisa:
    """The ALP calls as text lines: `ALP:SEQPUT id,offset,n,<block>` and so on; each reply is the return code."""

    def __init__(self, link: VisaLink) -> None:
        """Send the calls over `link`."""
        self._link = link

    def Initialize(self, serial_number: int | None) -> None:  # noqa: N802
        """AlpDevAlloc of the device with this serial number, or of any; what a client leaves behind is free again."""
        self._call("ALP:DEVALLOC" if serial_number is None else f"ALP:DEVALLOC {serial_number}")

    def DevInquire(self, inquire_type: int) -> int:  # noqa: N802
        """AlpDevInquire."""
        return self._call(f"ALP:DEVINQUIRE {inquire_type}")

    def DevControl(self, control_type: int, value: int) -> None:  # noqa: N802
        """AlpDevControl."""
        self._call(f"ALP:DEVCONTROL {control_type},{value}")

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

    def ProjHalt(self) -> None:  # noqa: N802
        """AlpProjHalt."""
        self._call("ALP:PROJHALT")

    def ProjInquire(self, inquire_type: int) -> int:  # noqa: N802
        """AlpProjInquire."""
        return self._call(f"ALP:PROJINQUIRE {inquire_type}")

    def ProjControl(self, control_type: int, value: int) -> None:  # noqa: N802
        """AlpProjControl."""
        self._call(f"ALP:PROJCONTROL {control_type},{value}")

    def FreeSeq(self, sequence: int) -> None:  # noqa: N802
        """AlpSeqFree."""
        self._call(f"ALP:SEQFREE {sequence}")

    def Free(self) -> None:  # noqa: N802
        """AlpDevFree."""
        self._call("ALP:DEVFREE")

    def said(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

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
        if code != OK:
            raise failure(call, code)
        return value


class _Returned(Exception):
    """A function of the vendor's library returned this code, which is not 0."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class AlpByVendorLibrary:
    """The ALP calls through ALP4lib and the vendor's shared library.

    Facts of ALP4lib 1.1.0, from its source, that this class goes around: an `ALP4` that was freed has no library any
    more; `FreeSeq` takes the very object that `SeqAlloc` returned; it prints on the standard output; a return code that
    it does not know is a KeyError, and none is an error of `FreeSeq`; it has no AlpProjHalt; its `ProjInquire` hands
    the library an argument too many (AlpProjInquire of alp.h takes device, type and pointer).
    """

    def __init__(self, version: str, library_folder: str | None) -> None:
        """Load the vendor's library.

        Raises:
            NotConfigured: ALP4lib or the vendor's library is not installed, or is another one.
        """
        self._version, self._folder = version, library_folder
        self._alp = self._loaded()
        self._allocated = False
        self._sequences: dict[int, Any] = {}  # by identifier, the objects that ALP4lib knows them by

    def Initialize(self, serial_number: int | None) -> None:  # noqa: N802
        """AlpDevAlloc of the device with this serial number, or of the first one."""
        self._alp, self._allocated = self._loaded(), True
        try:
            self._call("Initialize", serial_number)
        except InstrumentError:
            self.close()
            raise

    def DevInquire(self, inquire_type: int) -> int:  # noqa: N802
        """AlpDevInquire."""
        return int(self._call("DevInquire", inquire_type))

    def DevControl(self, control_type: int, value: int) -> None:  # noqa: N802
        """AlpDevControl."""
        self._call("DevControl", control_type, value)

    def SeqAlloc(self, pictures: int, bit_depth: int) -> int:  # noqa: N802
        """AlpSeqAlloc; returns the sequence's identifier."""
        sequence = self._call("SeqAlloc", nbImg=pictures, bitDepth=bit_depth)
        self._sequences[sequence.value] = sequence
        return int(sequence.value)

    def SeqControl(self, sequence: int, control_type: int, value: int) -> None:  # noqa: N802
        """AlpSeqControl."""
        self._call_for(sequence, "SeqControl", control_type, value)

    def SeqInquire(self, sequence: int, inquire_type: int) -> int:  # noqa: N802
        """AlpSeqInquire."""
        return int(self._call_for(sequence, "SeqInquire", inquire_type))

    def SeqPut(self, sequence: int, offset: int, frames: NDArray[np.uint8]) -> None:  # noqa: N802
        """AlpSeqPut of `frames`, shape (n, rows, bytes a row), taken from memory as they are."""
        data = np.ascontiguousarray(frames).ctypes.data_as(ctypes.POINTER(ctypes.c_ubyte))
        self._call_for(sequence, "SeqPut", data, PicOffset=offset, PicLoad=len(frames), dataFormat="C")

    def SeqTiming(self, sequence: int, picture_time_us: int, pulse_us: int) -> None:  # noqa: N802
        """AlpSeqTiming with the library's own illumination time and delays."""
        self._call_for(sequence, "SetTiming", pictureTime=picture_time_us, synchPulseWidth=pulse_us)

    def Run(self, sequence: int, *, loop: bool) -> None:  # noqa: N802
        """AlpProjStartCont, or AlpProjStart for once."""
        self._call_for(sequence, "Run", loop=loop)

    def ProjHalt(self) -> None:  # noqa: N802
        """AlpProjHalt, which returns before the projection has ended; this returns when its sequence is free."""
        self._call_c("AlpProjHalt")
        deadline = time.monotonic() + HALTING_S
        while self.ProjInquire(ALP_PROJ_STATE) != ALP_PROJ_IDLE:
            if time.monotonic() > deadline:
                raise InstrumentError(
                    f"dmd: still projects {HALTING_S:g} s after it was halted: switch the device off and on"
                )
            time.sleep(1e-3)

    def ProjInquire(self, inquire_type: int) -> int:  # noqa: N802
        """AlpProjInquire."""
        found = ctypes.c_long(0)
        self._call_c("AlpProjInquire", inquire_type, ctypes.byref(found))
        return found.value

    def ProjControl(self, control_type: int, value: int) -> None:  # noqa: N802
        """AlpProjControl."""
        self._call("ProjControl", control_type, value)

    def FreeSeq(self, sequence: int) -> None:  # noqa: N802
        """AlpSeqFree."""
        self._call_for(sequence, "FreeSeq")
        del self._sequences[sequence]

    def Free(self) -> None:  # noqa: N802
        """AlpDevFree."""
        self._call("Free")
        self._forget()

    def said(self) -> None:
        """The library finds its own devices alone."""

    def close(self) -> None:
        """AlpDevHalt and AlpDevFree of a device that is still allocated, whatever the library answers."""
        if self._allocated and self._alp.ALP_ID.value:
            for step in (self._alp.Halt, self._alp.Free):
                with contextlib.suppress(_Returned, AttributeError):
                    step()
        self._forget()

    def _forget(self) -> None:
        self._allocated = False
        self._sequences.clear()

    def _loaded(self) -> Any:
        try:
            import ALP4
        except ImportError:
            raise NotConfigured('dmd: ALP4lib is not installed: pip install "photonic-labctl[alp]"') from None
        ALP4.print = _logger.info  # the standard output is for what a command has to say, JSON perhaps
        try:
            alp = ALP4.ALP4(version=self._version, libDir=self._folder)
        except (OSError, AttributeError, ValueError) as error:
            raise NotConfigured(
                f"dmd: the ViALUX library for ALP {self._version} cannot be loaded: {' '.join(str(error).split())}"
            ) from None
        alp._checkError = _check  # noqa: SLF001 - the only place where ALP4lib has the return code itself
        return alp

    def _call(self, method: str, *arguments: object, **named: object) -> Any:
        """What a method of ALP4lib returns."""
        return self._in_words(method, lambda: getattr(self._alp, method)(*arguments, **named))

    def _call_for(self, sequence: int, method: str, *arguments: object, **named: object) -> Any:
        """What a method of ALP4lib returns for a sequence."""
        return self._in_words(
            method, lambda: getattr(self._alp, method)(*arguments, SequenceId=self._sequences[sequence], **named)
        )

    def _call_c(self, function: str, *arguments: object) -> None:
        """A function of the vendor's library for the device, past ALP4lib."""
        self._in_words(
            function,
            lambda: _check(getattr(self._alp._ALPLib, function)(self._alp.ALP_ID, *arguments)),  # noqa: SLF001
        )

    def _in_words(self, name: str, call: Callable[[], Any]) -> Any:
        """What `call` returns. A device that cannot be reached any more is freed: it can be allocated anew only then.

        Raises:
            LinkError: the device cannot be reached.
            InstrumentError: another return code, in words.
            NotConfigured: the library lacks a function.
        """
        if not self._allocated:
            raise failure(name, NOT_ALLOCATED)
        try:
            return call()
        except _Returned as returned:
            if returned.code in LOST:
                self.close()
            raise failure(name, returned.code) from None
        except AttributeError as error:  # ctypes, of a function that is not in the library
            raise NotConfigured(
                f"dmd: the ViALUX library cannot {name} ({error}): install the one of the version in dmd.version"
            ) from None


def _check(code: int, _told: str = "", warning: bool = False) -> None:
    """In place of `ALP4._checkError`: whatever is not OK is raised, that of `FreeSeq` too, which is a warning there."""
    if code != OK:
        raise _Returned(code)
