"""The DLPC900 driver against the virtual device, and against a device that misbehaves."""

import sys
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from instruments import dlpc900_image as encoding
from instruments.dlpc900_commands import Commands
from instruments.dlpc900_reports import HidApi, ReportsOverTcp
from instruments.driver import Opening
from instruments.errors import InstrumentError, LinkError, NotConfigured, OutOfRange
from instruments.interfaces import BurstDmd
from instruments.ti_dlpc900 import COLUMNS, DRIVER, ROWS, TiDlpc900, TiDlpc900Section
from sim_backends.bench import SimulatedBench
from sim_backends.optics.mirrors import MIRRORS_PER_SUPERPIXEL
from sim_backends.virtual.dlpc900 import planes
from sim_backends.virtual.dlpc900.instrument import VirtualDlpc900
from sim_backends.world.signals import Projection
from tests.sim_backends.virtual.dlpc900.cable import Cable
from tests.sim_backends.virtual.watched import SMALL, Watched


class Altered(Cable):
    """A cable on which replies can be lost, mixed up or changed."""

    silent = False
    number_offset = 0
    status_answer: bytes | None = None
    closed = 0

    def read(self) -> bytes:
        report = super().read()
        if self.silent or not report:
            return b""
        if self.status_answer is not None and report[0] == 0xC0 and report[2] == 1:
            report = report[:4] + self.status_answer + report[5:]
        return report[:1] + bytes(((report[1] + self.number_offset) % 256,)) + report[2:]

    def close(self) -> None:
        self.closed += 1
        super().close()


@pytest.fixture
def world() -> Watched:
    return Watched()


@pytest.fixture
def device(world: Watched) -> Altered:
    return Altered(VirtualDlpc900(world))


@pytest.fixture
def dmd(device: Altered) -> TiDlpc900:
    return TiDlpc900(Commands(device, unheard))


def unheard(*_: str) -> None:
    """A transcript."""


def superpixels(*lit: int) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    """A picture with some of the 28 x 28 superpixels on."""
    image = np.zeros(784, bool)
    image[list(lit)] = True
    mirrors = np.zeros((ROWS, COLUMNS), bool)
    mirrors[8:-8, 428:-428] = image.reshape(28, 28).repeat(38, axis=0).repeat(38, axis=1)
    return np.packbits(mirrors, axis=1)


def lit_in(world: Watched) -> list[int]:
    """Which superpixels are on now."""
    assert world.picture is not None
    assert set(world.picture.tolist()) <= {0, MIRRORS_PER_SUPERPIXEL**2}
    return np.flatnonzero(world.picture).tolist()


def projected(world: Watched) -> Projection:
    found = world.shown[-1]
    assert isinstance(found, Projection)
    return found


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 20, 300]), st.sampled_from([1, 5, 24]))
def test_an_image_is_decoded_to_what_was_encoded(seed: int, repeats: int, pictures: int) -> None:
    random = np.random.default_rng(seed)
    lines = random.integers(0, 256, (pictures, 4, COLUMNS // 8), dtype=np.uint8)
    mirrors = np.zeros((pictures, ROWS, COLUMNS // 8), np.uint8)
    block = np.repeat(lines, repeats, axis=1)[:, :ROWS]
    mirrors[:, : block.shape[1]] = block
    image = encoding.encode(mirrors)
    assert len(image) % 4 == 0
    decoded = planes.decode(image)
    for bit, picture in enumerate(mirrors):
        np.testing.assert_array_equal(np.packbits((decoded >> bit & 1).astype(bool), axis=1), picture)
    assert not (decoded >> pictures).any()


def test_show_reaches_the_mirrors(dmd: TiDlpc900, world: Watched) -> None:
    dmd.show(superpixels(3, 400, 783))
    assert lit_in(world) == [3, 400, 783]
    assert projected(world).synch_pulse_s == 0, "a picture that is shown again and again must not pulse"
    dmd.show(superpixels(0))
    assert lit_in(world) == [0]
    dmd.make_safe()
    assert lit_in(world) == []
    assert dmd.settings() == {"rows": 1080, "columns": 1920, "display_mode": 3}
    dmd.close()


def test_pictures_in_turn_each_with_a_pulse(dmd: TiDlpc900, world: Watched) -> None:
    assert isinstance(dmd, BurstDmd)
    assert dmd.capacity() == 384
    done: list[tuple[int, int]] = []
    blocks = (np.stack([superpixels(first + n) for n in range(20)]) for first in (0, 20, 40))
    dmd.load(blocks, 60, progress=lambda *progress: done.append(progress))
    assert done == [(24, 60), (48, 60), (60, 60)]
    dmd.show(superpixels(700))
    dmd.hold()
    assert lit_in(world) == [700]
    dmd.play(22, 5, dmd.picture_period_s, pulse_s=60e-6)
    shown = projected(world)
    assert [np.flatnonzero(row).tolist() for row in shown.counts] == [[22], [23], [24], [25], [26]]
    assert (shown.picture_time_s, shown.synch_delay_s, shown.synch_pulse_s) == pytest.approx((105e-6, 0, 60e-6))
    assert shown.synch_high
    assert not shown.loop
    assert shown.repeats == 1
    dmd.play(0, 1, 200e-6)
    assert (projected(world).synch_pulse_s, dmd.pulse_s) == pytest.approx((20e-6, 20e-6))
    dmd.play(3, 2, 200e-6, rounds=7)
    assert (len(projected(world).counts), projected(world).repeats) == (2, 7)


def test_pictures_are_downloaded_anew_wherever_the_table_changed(
    dmd: TiDlpc900, world: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The guide's rule (DLPU018J, 2.4.4.4.2); of the images, only those that are played; none for the same again."""
    announced: list[int] = []
    announce = VirtualDlpc900.announce

    def noted(controller: VirtualDlpc900, index: int, size: int) -> None:
        announced.append(index)
        announce(controller, index, size)

    monkeypatch.setattr(VirtualDlpc900, "announce", noted)
    dmd.load([np.stack([superpixels(n) for n in range(60)])], 60)
    for first, count, images in ((0, 60, [2, 1, 0]), (0, 60, []), (0, 20, [0]), (40, 20, [1, 0]), (4, 20, [0])):
        announced.clear()
        dmd.play(first, count, 105e-6)
        assert [np.flatnonzero(row).tolist() for row in projected(world).counts] == [
            [n] for n in range(first, first + count)
        ]
        assert announced == images
    dmd.show(superpixels(700))
    dmd.play(4, 20, 105e-6)
    assert announced == [0, 0, 0], "also after a picture that was shown meanwhile"


def test_holding_stops_pictures_in_turn(dmd: TiDlpc900, world: Watched) -> None:
    dmd.load([np.stack([superpixels(n) for n in range(3)])], 3)
    dmd.play(0, 3, 1.0)
    dmd.hold()
    assert lit_in(world) == [0]
    world.clock.advance(2.0)
    assert lit_in(world) == [0]


def test_what_cannot_be_played(dmd: TiDlpc900) -> None:
    with pytest.raises(InstrumentError, match="no pictures are loaded"):
        dmd.play(0, 1, 105e-6)
    with pytest.raises(OutOfRange, match="pictures in the DMD's memory = 385"):
        dmd.load([], 385)
    dmd.load([np.stack([superpixels(n) for n in range(3)])], 3)
    with pytest.raises(OutOfRange, match="time between pictures = 44"):
        dmd.play(0, 3, 44e-6)
    with pytest.raises(OutOfRange, match="pictures to play = 3"):
        dmd.play(1, 3, 105e-6)
    with pytest.raises(OutOfRange, match="pulse of a picture = 110"):
        dmd.play(0, 3, 105e-6, pulse_s=110e-6)


def test_what_somebody_else_changed_is_told_and_set_anew(dmd: TiDlpc900, device: Altered, world: Watched) -> None:
    assert dmd.changes() == ()
    dmd.show(superpixels(5))
    assert dmd.changes() == ()
    other = Commands(device, unheard)
    other.write(0x1A24, b"\0")
    for command in (0x1A30, 0x0201, 0x1008, 0x1009):
        other.write(command, b"\1")
    other.write(0x1A1B, b"\0")
    other.write(0x0200, b"\1")
    for _ in range(3):
        other.read(0x1A1B)
    assert [change.setting for change in dmd.changes()] == [
        *("display mode", "idle mode", "inversion", "flip across the long axis", "flip across the short axis"),
        *("mirrors", "sequence"),
    ]
    dmd.show(superpixels(5))
    assert dmd.changes() == ()
    assert lit_in(world) == [5]


def test_a_mode_that_never_comes(dmd: TiDlpc900, device: Altered, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("instruments.ti_dlpc900.MODE_TIMEOUT_S", 0.0)
    device.status_answer = b"\1"
    with pytest.raises(InstrumentError, match="0x1A1B does not become 03 within 0 s"):
        dmd.blank()


def test_identity_and_self_test(dmd: TiDlpc900) -> None:
    identity = dmd.identify()
    assert identity.model == "DLPC900 1920x1080"
    assert identity.firmware == "LCR6500 simulated 6.0.0"
    dmd.self_test()


@pytest.mark.parametrize(("number", "named"), [(2, "a DLP9000"), (9, "a DMD of unknown type 9")])
def test_a_controller_of_another_dmd_is_refused(
    dmd: TiDlpc900, monkeypatch: pytest.MonkeyPatch, number: int, named: str
) -> None:
    monkeypatch.setattr("sim_backends.virtual.dlpc900.instrument.DLP6500", number)
    with pytest.raises(InstrumentError, match=f"drives {named}, and the driver ti-dlpc900 is for the DLP6500"):
        dmd.identify()


def test_a_refusal_is_told_in_words(dmd: TiDlpc900, device: Altered) -> None:
    commands = Commands(device, unheard)
    with pytest.raises(InstrumentError, match="0x1A1B refused, error 6: invalid command parameter"):
        commands.write(0x1A1B, b"\7")
    with pytest.raises(InstrumentError, match="0x1A2B refused, error 5"):
        commands.send(0x1A2B, b"\0\0")
    with pytest.raises(InstrumentError, match=r"give \(1080, 240\)"):
        dmd.show(np.zeros((768, 128), np.uint8))


def test_faults_of_the_hardware(dmd: TiDlpc900, device: Altered, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TiDlpc900, "blank", lambda _dmd: None)
    device.status_answer = b"\x80"
    with pytest.raises(InstrumentError, match="sequencer error; the controller has not initialised itself; memory"):
        dmd.self_test()


def test_a_device_that_does_not_answer(dmd: TiDlpc900, device: Altered) -> None:
    device.silent = True
    with pytest.raises(LinkError, match="no answer"):
        dmd.identify()
    device.silent, device.number_offset = False, 3
    with pytest.raises(LinkError, match="does not belong"):
        dmd.identify()
    assert device.closed == 2, "a reply that is late must not answer the next command"
    device.number_offset = 0
    dmd.identify()


class Usb:
    """`hid.device` of hidapi, with a virtual controller on the cable."""

    present = True

    def __init__(self) -> None:
        self.cable = Cable(VirtualDlpc900(Watched()))
        self.closed = False

    def open(self, vendor: int, product: int) -> None:
        assert (vendor, product) == (0x0451, 0xC900)
        if not self.present:
            raise OSError("open failed")

    def write(self, report: bytes) -> int:
        assert report[0] == 0
        self.cable.write(report[1:])
        return len(report)

    def read(self, size: int, _timeout_ms: int) -> list[int]:
        return list(self.cable.read())[:size]

    def close(self) -> None:
        self.closed = True


def test_hidapi(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hid", SimpleNamespace(device=Usb))
    usb = HidApi(5.0)
    dmd = TiDlpc900(Commands(usb, unheard))
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
    dmd.close()
    with pytest.raises(LinkError, match="no DLPC900 on USB"):
        dmd.identify()
    monkeypatch.setitem(sys.modules, "hid", None)
    with pytest.raises(NotConfigured, match=r'hidapi is not installed: pip install "photonic-labctl\[dlpc900\]"'):
        DRIVER.open(TiDlpc900Section(driver="ti-dlpc900"), opening("usb"))


@pytest.fixture(scope="module")
def served() -> Iterator[str]:
    """Address of a DLPC900 on the network."""
    with SimulatedBench(SMALL, dmd=VirtualDlpc900) as bench:
        yield bench.resources["dmd"]["socket"]


def test_over_the_network(served: str) -> None:
    told: list[tuple[str, str, str]] = []
    section = TiDlpc900Section(driver="ti-dlpc900", address=served)
    dmd = DRIVER.open(section, Opening(served, lambda *said: told.append(said), lambda _request: "", attended=True))
    dmd.self_test()
    assert dmd.identify().firmware == "LCR6500 simulated 6.0.0"
    assert ("dmd", ">", "0x1A24 02") in told
    assert ("dmd", ">", "0x0206 ?") in told
    dmd.close()
    assert dmd.settings()["display_mode"] == 3, "the next command connects anew"
    dmd.close()


def test_a_link_that_is_lost(served: str) -> None:
    host, port = served.split("::")[1:3]
    nowhere = ReportsOverTcp(f"TCPIP0::{host}::1::SOCKET", 1.0, unheard)
    with pytest.raises(LinkError, match="cannot be reached"):
        nowhere.write(bytes(64))
    hears_nothing = ReportsOverTcp(f"TCPIP0::{host}::{port}::SOCKET", 0.05, unheard)
    hears_nothing.write(bytes(64))
    assert hears_nothing.read() == b""
    hears_nothing.close()


def test_where_it_can_be() -> None:
    for address in ("GPIB0::3::INSTR", "tcpip::here"):
        with pytest.raises(ValidationError, match="a DLPC900 is on USB, or served on a raw socket"):
            TiDlpc900Section.model_validate({"driver": "ti-dlpc900", "address": address})
        with pytest.raises(NotConfigured, match="a DLPC900 is on USB, or served on a raw socket"):
            DRIVER.open(TiDlpc900Section(driver="ti-dlpc900"), opening(address))


def opening(address: str) -> Opening:
    return Opening(address, unheard, lambda _request: "", attended=True)
