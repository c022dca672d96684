"""The DLPC900 driver against the virtual device, and against a device that misbehaves."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from instruments import dlpc900_image as encoding
from instruments.driver import Opening
from instruments.errors import InstrumentError, LinkError, NotConfigured
from instruments.ti_dlpc900 import COLUMNS, DRIVER, ROWS, HidApi, TiDlpc900, TiDlpc900Section
from sim_backends.virtual.dlpc900 import planes
from sim_backends.virtual.dlpc900.instrument import VirtualDlpc900
from sim_backends.world.world import World


class Altered(VirtualDlpc900):
    """A controller whose reports can be lost, mixed up or changed."""

    silent = False
    number_offset = 0
    status_answer: bytes | None = None

    def read(self) -> bytes:
        report = super().read()
        if self.silent or not report:
            return b""
        if self.status_answer is not None and report[0] == 0xC0 and report[2] == 1:
            report = report[:4] + self.status_answer + report[5:]
        return report[:1] + bytes(((report[1] + self.number_offset) % 256,)) + report[2:]


@pytest.fixture
def device() -> Altered:
    return Altered(World())


def some_picture() -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    mirrors = np.zeros((ROWS, COLUMNS // 8), np.uint8)
    mirrors[200:400, 100:130] = 0xFF
    mirrors[400:402, 100:130] = 0b01010011
    return mirrors


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 20, 300]))
def test_an_image_is_decoded_to_what_was_encoded(seed: int, repeats: int) -> None:
    random = np.random.default_rng(seed)
    lines = random.integers(0, 256, (4, COLUMNS // 8), dtype=np.uint8)
    mirrors = np.zeros((ROWS, COLUMNS // 8), np.uint8)
    block = np.repeat(lines, repeats, axis=0)[:ROWS]
    mirrors[: len(block)] = block
    image = encoding.encode(mirrors)
    assert len(image) % 4 == 0
    np.testing.assert_array_equal(planes.plane(planes.decode(image), 0), mirrors)


def test_show_reaches_the_mirrors(device: Altered) -> None:
    dmd = TiDlpc900(device)
    dmd.show(some_picture())
    np.testing.assert_array_equal(planes.plane(device.images[0], 0), some_picture())
    assert device.running == 2
    dmd.show(~some_picture())
    np.testing.assert_array_equal(planes.plane(device.images[0], 0), ~some_picture())
    dmd.make_safe()
    assert not device.images[0].any()
    assert dmd.settings() == {"rows": 1080, "columns": 1920, "display_mode": 3}
    dmd.close()


def test_identity_and_self_test(device: Altered) -> None:
    dmd = TiDlpc900(device)
    identity = dmd.identify()
    assert identity.model == "DLPC900 1920x1080"
    assert identity.firmware == "LCR6500 simulated 6.0.0"
    dmd.self_test()


def test_a_refusal_is_told_in_words(device: Altered) -> None:
    dmd = TiDlpc900(device)
    with pytest.raises(InstrumentError, match="0x1A1B refused, error 6: invalid command parameter"):
        dmd._command(0x1A1B, b"\7")
    with pytest.raises(InstrumentError, match="0x1A2B refused, error 5"):
        dmd._transact(0x40, 0x1A2B, b"\0\0")
    with pytest.raises(InstrumentError, match=r"give \(1080, 240\)"):
        dmd.show(np.zeros((768, 128), np.uint8))


def test_faults_of_the_hardware(device: Altered) -> None:
    dmd = TiDlpc900(device)
    dmd.blank()
    device.status_answer = b"\x80"
    with pytest.raises(InstrumentError, match="sequencer error; the controller has not initialised itself; memory"):
        dmd.self_test()


def test_a_device_that_does_not_answer(device: Altered) -> None:
    dmd = TiDlpc900(device)
    device.silent = True
    with pytest.raises(LinkError, match="no answer"):
        dmd.identify()
    device.silent, device.number_offset = False, 3
    with pytest.raises(LinkError, match="does not belong"):
        dmd.identify()


class Usb:
    """`hid.device` of hidapi, with a virtual controller on the cable."""

    present = True

    def __init__(self) -> None:
        self.controller = VirtualDlpc900(World())
        self.closed = False

    def open(self, vendor: int, product: int) -> None:
        assert (vendor, product) == (0x0451, 0xC900)
        if not self.present:
            raise OSError("open failed")

    def write(self, report: bytes) -> int:
        assert report[0] == 0
        self.controller.write(report[1:])
        return len(report)

    def read(self, size: int, _timeout_ms: int) -> list[int]:
        return list(self.controller.read())[:size]

    def close(self) -> None:
        self.closed = True


def test_hidapi(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hid", SimpleNamespace(device=Usb))
    usb = HidApi()
    dmd = TiDlpc900(usb)
    assert dmd.settings()["display_mode"] == 1
    device = usb._device
    dmd.close()
    dmd.close()
    assert device.closed
    with monkeypatch.context() as cable:
        cable.setattr(Usb, "write", lambda _device, _report: -1)
        with pytest.raises(LinkError, match=r"lost .it takes no report.: check power and USB cable"):
            dmd.identify()
    assert dmd.identify().manufacturer == "Texas Instruments", "the next command opens it anew"
    monkeypatch.setattr(Usb, "present", False)
    with pytest.raises(LinkError, match="no DLPC900 on USB"):
        HidApi()
    monkeypatch.setitem(sys.modules, "hid", None)
    with pytest.raises(NotConfigured, match="hidapi is not installed"):
        DRIVER.open(TiDlpc900Section(driver="ti-dlpc900"), opening("usb"))


def test_it_is_on_usb_only() -> None:
    with pytest.raises(ValidationError, match="Input should be 'usb'"):
        TiDlpc900Section.model_validate({"driver": "ti-dlpc900", "address": "TCPIP0::127.0.0.1::5000::SOCKET"})
    with pytest.raises(NotConfigured, match="a DLPC900 is on USB only"):
        DRIVER.open(TiDlpc900Section(driver="ti-dlpc900"), opening("TCPIP0::127.0.0.1::5000::SOCKET"))


def opening(address: str) -> Opening:
    return Opening(address, lambda *_: None, lambda _request: "", attended=True)
