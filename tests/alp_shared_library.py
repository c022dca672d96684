"""The ViALUX shared library as ctypes hands it to ALP4lib, with a served DMD behind it.

ALP4lib calls C: its arguments pass through the very call that a vendor's library gets, by a closure of libffi for each
function of `alp.h` (the prototypes: public copies of that header). What the vendor's library keeps by itself is kept
here: handles of devices, one process to a device, the size of what it reads of a picture, and what becomes of a device
whose cable is pulled. Everything else is the simulated DMD's, over its socket.
"""

import ctypes
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from typing import Any
from unittest.mock import patch

OK, NOT_ONLINE, NOT_AVAILABLE, NOT_READY, COMMUNICATION, REMOVED = 0, 1001, 1003, 1004, 1011, 1012
IN_USE, ACTIVE = 1008, 1200
DEVICE_HEIGHT, DEVICE_WIDTH, DATA_FORMAT, BINARY, PROJECTION_STATE = 2057, 2058, 2110, (2, 3), 2400

LONG, ALP_ID, POINTER = ctypes.c_int32, ctypes.c_uint32, ctypes.c_void_p
NUMBERS = {
    "AlpDevControl": 2,
    "AlpDevHalt": 0,
    "AlpSeqFree": 1,
    "AlpSeqControl": 3,
    "AlpSeqTiming": 6,
    "AlpProjControl": 2,
    "AlpProjStart": 1,
    "AlpProjStartCont": 1,
    "AlpProjHalt": 0,
    "AlpProjWait": 0,
}
"""Functions that take a device and so many numbers."""
INQUIRIES = {"AlpDevInquire": 1, "AlpSeqAlloc": 2, "AlpSeqInquire": 2, "AlpProjInquire": 1}
"""Those that take a device, so many numbers, and a pointer to where the answer goes."""


class Device:
    """An allocated device: its connection, and what the library knows of its sequences.

    Attributes:
        pictures: of every sequence. packed: the sequences whose pictures are bits.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        self._ended = ExitStack()
        self._socket = self._ended.enter_context(closing(socket.create_connection((host, port), timeout=timeout_s)))
        self._replies = self._ended.enter_context(self._socket.makefile("rb"))
        self.pictures: dict[int, int] = {}
        self.packed: set[int] = set()

    def call(self, line: str, block: bytes | None = None) -> tuple[int, int]:
        """Return code and value; a device that is lost once is lost until it is freed."""
        message = line.encode()
        if block is not None:
            message += f",#{len(str(len(block)))}{len(block)}".encode() + block
        try:
            self._socket.sendall(message + b"\n")
            reply = self._replies.readline()
        except TimeoutError:
            self.close()
            return COMMUNICATION, 0
        except (OSError, ValueError):  # the latter of a connection that is closed
            reply = b""
        if not reply.endswith(b"\n"):
            self.close()
            return REMOVED, 0
        code, _, value = reply.decode().partition(",")
        return int(code), int(value or 0)

    def close(self) -> None:
        """End the connection."""
        self._ended.close()


class SharedLibrary:
    """What `ctypes.CDLL` returns for the vendor's library.

    Attributes:
        called: the names of the functions that were called, in order.
        returns: what functions return, by name, without doing anything.
        slow_to_halt: so many times the projection is still active when its state is asked for after AlpProjHalt, and
            its sequence in use until then (AlpProjHalt returns before the device has come to rest: public programs in C
            ask for the state until it is idle).
    """

    def __init__(self, address: str, *, timeout_s: float = 5.0) -> None:
        """Of the DMD that is served at a VISA address `TCPIP0::host::port::SOCKET`."""
        _, self._host, port, _ = address.split("::")
        self._port, self._timeout_s = int(port), timeout_s
        self._devices: dict[int, Device] = {}
        self._identifiers = 0
        self._closures: list[object] = []
        self.called: list[str] = []
        self.returns: dict[str, int] = {}
        self.slow_to_halt = self._halting = 0
        self._export("AlpDevAlloc", self._allocate, LONG, LONG, POINTER)
        self._export("AlpDevFree", self._free, ALP_ID)
        self._export("AlpSeqPut", self._put, ALP_ID, ALP_ID, LONG, LONG, POINTER)
        for name, count in NUMBERS.items():
            self._export(name, self._numbers(name), ALP_ID, *[LONG] * count)
        for name, count in INQUIRIES.items():
            self._export(name, self._inquiry(name), ALP_ID, *[LONG] * count, POINTER)

    def unplug(self) -> None:
        """Pull the cable: handles stay, their devices are gone. Those that are allocated from now on are there."""
        for device in self._devices.values():
            device.close()

    def _allocate(self, number: int, _flag: int, device_id: int) -> int:
        if self._devices:
            return NOT_READY
        try:
            device = Device(self._host, self._port, self._timeout_s)
        except OSError:
            return NOT_ONLINE
        code, _ = device.call(f"ALP:DEVALLOC {number}")
        if code != OK:
            device.close()
            return code
        self._identifiers += 1
        self._devices[self._identifiers] = device
        _store(device_id, self._identifiers)
        return OK

    def _free(self, device_id: int) -> int:
        if device_id not in self._devices:
            return NOT_AVAILABLE
        code, _ = self._devices[device_id].call("ALP:DEVFREE")
        if code in (OK, COMMUNICATION, REMOVED):
            self._devices.pop(device_id).close()
        return code

    def _put(self, device_id: int, sequence: int, offset: int, count: int, pictures: int) -> int:
        device = self._devices.get(device_id)
        if device is None:
            return NOT_AVAILABLE
        if self._halting:
            return IN_USE
        mirrors = 1
        for side in (DEVICE_HEIGHT, DEVICE_WIDTH):
            code, length = device.call(f"ALP:DEVINQUIRE {side}")
            if code != OK:
                return code
            mirrors *= length
        size = (count or device.pictures.get(sequence, 0) - offset) * mirrors // (8 if sequence in device.packed else 1)
        code, _ = device.call(f"ALP:SEQPUT {sequence},{offset},{count}", ctypes.string_at(pictures, size))
        return code

    def _numbers(self, name: str) -> Callable[..., int]:
        def function(device_id: int, *numbers: int) -> int:
            device = self._devices.get(device_id)
            if device is None:
                return NOT_AVAILABLE
            code, _ = device.call(_line(name, numbers))
            if name == "AlpProjHalt":
                self._halting = self.slow_to_halt
            if code == OK and name == "AlpSeqControl" and numbers[1] == DATA_FORMAT:
                (device.packed.add if numbers[2] in BINARY else device.packed.discard)(numbers[0])
            return code

        return function

    def _inquiry(self, name: str) -> Callable[..., int]:
        def function(device_id: int, *arguments: int) -> int:
            *numbers, pointer = arguments
            device = self._devices.get(device_id)
            if device is None:
                return NOT_AVAILABLE
            if self._halting and numbers == [PROJECTION_STATE]:
                self._halting -= 1
                _store(pointer, ACTIVE)
                return OK
            code, value = device.call(_line(name, numbers))
            if code == OK:
                _store(pointer, value)
                if name == "AlpSeqAlloc":
                    device.pictures[value] = numbers[1]
            return code

        return function

    def _export(self, name: str, function: Callable[..., int], *types: Any) -> None:
        """Have a function of C do what `function` does; as in a library that is loaded, its arguments are not typed."""

        def noted(*arguments: int) -> int:
            self.called.append(name)
            return self.returns[name] if name in self.returns else function(*arguments)

        closure = ctypes.CFUNCTYPE(LONG, *types)(noted)
        self._closures.append(closure)
        setattr(self, name, ctypes.CFUNCTYPE(ctypes.c_int)(ctypes.cast(closure, POINTER).value or 0))


@contextmanager
def in_place_of_the_vendors(address: str, *, timeout_s: float = 5.0) -> Iterator[SharedLibrary]:
    """Inside the block, whoever loads the vendor's library gets this one, of the DMD that is served at an address."""
    library, load = SharedLibrary(address, timeout_s=timeout_s), ctypes.CDLL

    def loaded(name: str | None, *arguments: Any, **named: Any) -> Any:
        return library if "alp" in str(name) else load(name, *arguments, **named)

    with patch("ctypes.CDLL", loaded):
        yield library
    library.unplug()


def _line(name: str, numbers: Any) -> str:
    return f"ALP:{name[3:].upper()} {','.join(map(str, numbers))}".strip()


def _store(pointer: int, value: int) -> None:
    ctypes.cast(pointer, ctypes.POINTER(LONG)).contents.value = value
