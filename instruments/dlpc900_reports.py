"""Reports to and from a DLPC900: on USB by `hidapi`, or over TCP to one that is served on the network.

On USB a report is an interrupt transfer of 64 bytes; over TCP the same 64 bytes follow one another in both directions
with nothing in between, as `sim_backends.servers.reports` serves them.
"""

import importlib
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from instruments.errors import LinkError, NotConfigured
from instruments.sections import USB
from instruments.transcripts import ByteTranscript, SessionTap, Transcript

VENDOR, PRODUCT = 0x0451, 0xC900
REPORT = 64  # bytes
SERVED = re.compile(r"(?i:TCPIP\d*)::([^:]+)::(\d{1,5})::(?i:SOCKET)")
"""The address of a device that is served on the network."""


class HidDevice(Protocol):
    """A HID device that exchanges reports of 64 bytes; after `close` it is opened anew by the next report."""

    def write(self, report: bytes) -> None:
        """Send one report."""

    def read(self) -> bytes:
        """Receive one report; nothing if none came in time."""

    def close(self) -> None:
        """Release the device."""


class HidApi:
    """The first DLPC900 on USB, through `hidapi`."""

    def __init__(self, timeout_s: float) -> None:
        """The device is opened by the first report; one is waited for `timeout_s`.

        Raises:
            NotConfigured: hidapi is not installed.
        """
        try:
            hid: Any = importlib.import_module("hid")
        except ImportError:
            raise NotConfigured('dmd: hidapi is not installed: pip install "photonic-labctl[dlpc900]"') from None
        self._hid = hid
        self._timeout_s = timeout_s
        self._device: Any = None

    def write(self, report: bytes) -> None:
        """Send one report; report number 0, which hidapi wants in front, is not part of it.

        Raises:
            LinkError: there is no such device, it may not be opened, or the cable is out; the next one opens it anew.
        """
        with self._conversation() as device:
            if device.write(b"\0" + report) < 0:
                raise OSError("it takes no report")

    def read(self) -> bytes:
        """Receive one report; nothing if none came in time.

        Raises:
            LinkError: as `write`.
        """
        with self._conversation() as device:
            return bytes(device.read(REPORT, int(self._timeout_s * 1e3)))

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


class ReportsOverTcp:
    """A DLPC900 that is served on the network; a connection is made by the first report."""

    def __init__(self, address: str, timeout_s: float, transcript: Transcript) -> None:
        """Describe the connection.

        Raises:
            NotConfigured: `address` is not that of a raw socket.
        """
        found = SERVED.fullmatch(address)
        if found is None:
            raise NotConfigured(
                f"dmd.address = {address!r}: a DLPC900 is on USB, or served on a raw socket: write {USB!r}, or an "
                "address such as TCPIP0::192.0.2.1::5025::SOCKET"
            )
        self._address = address
        self._place = found[1], int(found[2])
        self._timeout_s = timeout_s
        self._recorder = transcript if isinstance(transcript, ByteTranscript) else None
        self._tap: SessionTap | None = None
        self._socket: socket.socket | None = None

    def write(self, report: bytes) -> None:
        """Send one report.

        Raises:
            LinkError: it cannot be sent; the next report connects anew.
        """
        with self._conversation() as connection:
            connection.sendall(report)
            if self._tap is not None:
                self._tap.heard(">", (report,))

    def read(self) -> bytes:
        """Receive one report; nothing if none came in time.

        Raises:
            LinkError: as `write`.
        """
        with self._conversation() as connection:
            report = b""
            while len(report) < REPORT:
                try:
                    piece = connection.recv(REPORT - len(report))
                except TimeoutError:
                    return b""
                if not piece:
                    raise OSError("it hung up")
                report += piece
            if self._tap is not None:
                self._tap.heard("<", (report,))
            return report

    def close(self) -> None:
        """End the connection."""
        connection, self._socket = self._socket, None
        tap, self._tap = self._tap, None
        if tap is not None:
            tap.closed()
        if connection is not None:
            connection.close()

    @contextmanager
    def _conversation(self) -> Iterator[socket.socket]:
        """The open connection; what breaks inside closes it, for what was under way can be nobody's reply any more."""
        try:
            yield self._socket or self._open()
        except OSError as error:
            self.close()
            raise LinkError(
                f"dmd at {self._address} cannot be reached ({error}): check address, cable and power"
            ) from None
        except BaseException:
            self.close()
            raise

    def _open(self) -> socket.socket:
        self._socket = socket.create_connection(self._place, self._timeout_s)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self._recorder is not None:
            self._tap = self._recorder.tap("dmd", self._address)
        return self._socket


def reports(address: str, timeout_s: float, transcript: Transcript) -> HidDevice:
    """The device at `address`: on USB, or served on the network.

    Raises:
        NotConfigured: as `HidApi` and `ReportsOverTcp`.
    """
    return HidApi(timeout_s) if address == USB else ReportsOverTcp(address, timeout_s, transcript)
