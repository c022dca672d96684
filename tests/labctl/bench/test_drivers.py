"""The DMD drivers a station file can name."""

import sys
from pathlib import Path

import pytest

from instruments.errors import NotConfigured
from labctl.bench.drivers import Opening, ti_dlpc900
from labctl.bench.station import DmdSection
from labctl.errors import StationError

SECTION = DmdSection(driver="ti-dlpc900", address="usb")


def opening(address: str) -> Opening:
    return Opening(address, lambda *_: None, lambda _request: "", attended=True, simulated_laser=Path("laser.toml"))


def test_a_dlpc900_is_on_usb_only() -> None:
    with pytest.raises(StationError, match="ti-dlpc900' is on USB only"):
        ti_dlpc900(SECTION, opening("TCPIP0::127.0.0.1::5000::SOCKET"))


def test_a_dlpc900_needs_hidapi(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hid", None)
    with pytest.raises(NotConfigured, match="dlpc900"):
        ti_dlpc900(SECTION, opening("usb"))
