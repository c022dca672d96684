"""The virtual DLPC900, report by report."""

import struct

import numpy as np
import pytest

from sim_backends.optics import mirrors
from sim_backends.virtual.dlpc900 import planes
from sim_backends.virtual.dlpc900.instrument import REPORT_S, VirtualDlpc900
from tests.sim_backends.virtual.watched import Watched

WRITE, READ, SILENT, REFUSED = 0x40, 0xC0, 0x00, 0x20
DEFINITION = bytes.fromhex("0000C80000100000000000 00")  # the guide's example: pattern 0, 200 us, red, one bit


@pytest.fixture
def device(world: Watched) -> VirtualDlpc900:
    return VirtualDlpc900(world)


def send(device: VirtualDlpc900, flags: int, command: int, data: bytes = b"", number: int = 7) -> bytes:
    packet = struct.pack("<BBHH", flags, number, len(data) + 2, command) + data
    for start in range(0, len(packet), 64):
        device.write(packet[start : start + 64].ljust(64, b"\0"))
    return device.read()


def refusal(device: VirtualDlpc900, command: int, data: bytes = b"") -> int:
    reply = send(device, WRITE, command, data)
    assert reply[0] == WRITE | REFUSED
    told = send(device, READ, 0x0100)
    assert told[4] == told[6] != 0
    return told[4]


def picture(compression: int, body: bytes) -> bytes:
    return struct.pack("<4sHHI8sIBBB21x", b"Spld", 1920, 1080, 48 + len(body), b"\xff" * 8, 0, 0, compression, 1) + body


def upload(device: VirtualDlpc900, image: bytes, index: int = 0) -> bytes:
    send(device, WRITE, 0x1A2A, struct.pack("<HI", index, len(image)))
    reply = b""
    for start in range(0, len(image), 504):
        chunk = image[start : start + 504]
        reply = send(device, WRITE, 0x1A2B, struct.pack("<H", len(chunk)) + chunk)
    return reply


FULL = b"".join(b"\x80\x0f\x00\x00\x01\x00\x00" for _ in range(1080)) + b"\0\1\0"  # 1920 times bit 0


def show(device: VirtualDlpc900, image: bytes) -> None:
    send(device, WRITE, 0x1A1B, b"\3")
    send(device, WRITE, 0x1A34, DEFINITION)
    send(device, WRITE, 0x1A31, bytes.fromhex("010000000000"))
    upload(device, image)
    send(device, WRITE, 0x1A24, b"\2")


def test_a_reply_carries_the_number_of_its_command(device: VirtualDlpc900) -> None:
    assert send(device, WRITE, 0x1A1B, b"\3", number=200)[:4] == bytes((WRITE, 200, 0, 0))
    reply = send(device, READ, 0x1A1B, number=201)
    assert (len(reply), reply[:5]) == (64, bytes((READ, 201, 1, 0, 3)))
    assert send(device, SILENT, 0x1A1B, b"\1") == b""
    assert send(device, READ, 0x0205)[4:8] == bytes((0, 0, 0, 6))
    assert send(device, READ, 0x0206)[5:22] == b"LCR6500 simulated"
    assert send(device, READ, 0x1A0A)[4] == 1


def test_reports_cost_time(device: VirtualDlpc900) -> None:
    before = device.world.clock.now
    send(device, READ, 0x1A0B)
    assert device.world.clock.now - before == pytest.approx(REPORT_S)


def test_all_mirrors_on_reach_as_far_as_the_smaller_device(device: VirtualDlpc900, world: Watched) -> None:
    show(device, picture(2, FULL))
    seen = world.shown[-1]
    assert isinstance(seen, np.ndarray)
    bits = np.unpackbits(seen, axis=1)
    height = 1080 * 7.56e-6 / mirrors.PITCH_M
    assert abs(bits[:, 500].sum() - height) < 1
    assert bits[384].all()  # 1920 x 7.56 um is wider than 1024 x 13.68 um
    assert not bits[:80].any()
    assert send(device, READ, 0x1A0C)[4] == 2
    send(device, WRITE, 0x1A24, b"\0")
    assert world.shown[-1] is None


def test_image_forms_agree() -> None:
    row = b"\x02\x00\x00\x01" + b"\x00\x02\x00\x00\x00\x00\x00\x01"  # two on, then off, on
    rle = row + b"".join(b"\xff\0\0\0" for _ in range(7)) + bytes((131, 0, 0, 0)) + b"\0\0"
    rle += b"\0\0".join([b"\xff\0\0\0" * 7 + bytes((135, 0, 0, 0))] * 1079) + b"\0\1"
    enhanced = row + b"\xfc\x0e\0\0\0" + b"\0\0"
    enhanced += b"\x80\x0f\0\0\0\0\0" + b"\0\1\x80\x0f" * 1078 + b"\0\1\0"
    pixels = np.zeros((1080, 1920), np.uint32)
    pixels[0, [0, 1, 3]] = 1
    raw = np.zeros((1080, 1920, 3), np.uint8)
    raw[..., 2] = pixels
    for compression, body in ((0, raw.tobytes()), (1, rle), (2, enhanced)):
        np.testing.assert_array_equal(planes.decode(picture(compression, body)), pixels)
    assert planes.plane(pixels, 0)[0, 0] == 0b11010000
    assert not planes.plane(pixels, 1).any()


@pytest.mark.parametrize(
    "image",
    [
        b"short",
        picture(3, FULL),
        picture(2, FULL).replace(b"Spld", b"Splc"),
        picture(2, b"\x81\x0f\0\0\1"),  # 1921 in a row
        picture(2, b"\x80"),
        picture(2, b"\0\1\x05"),
        picture(0, b"\0"),
        picture(2, FULL[:-3] + FULL),
    ],
)
def test_bad_images_are_refused(device: VirtualDlpc900, image: bytes) -> None:
    send(device, WRITE, 0x1A1B, b"\3")
    assert upload(device, image)[0] & REFUSED
    assert send(device, READ, 0x0100)[4] == 9


@pytest.mark.parametrize(
    ("command", "data", "code"),
    [
        (0x7777, b"", 3),
        (0x1A1B, b"\4", 6),
        (0x1A1B, b"", 6),
        (0x0200, b"\3", 6),
        (0x0201, b"\2", 6),
        (0x1A24, b"\3", 6),
        (0x1A24, b"\2", 16),
        (0x1A34, b"\xff\x01" + DEFINITION[2:], 15),
        (0x1A34, b"\0\0\x68" + DEFINITION[3:], 14),
        (0x1A34, DEFINITION[:-1] + b"\xc0", 10),
        (0x1A34, DEFINITION[:-2] + b"\x12\0", 17),
        (0x1A31, struct.pack("<HI", 0, 0), 15),
        (0x1A31, struct.pack("<HI", 1, 0), 16),
        (0x1A2A, struct.pack("<HI", 18, 48), 17),
        (0x1A2A, struct.pack("<HI", 0, 1 << 24), 8),
        (0x1A2B, b"\1\0\0", 5),
    ],
)
def test_what_the_device_refuses(device: VirtualDlpc900, command: int, data: bytes, code: int) -> None:
    send(device, WRITE, 0x1A1B, b"\3")
    assert refusal(device, command, data) == code
    assert send(device, READ, 0x0101)[4:].split(b"\0")[0]
    send(device, WRITE, 0x1A1B, b"\3")
    assert send(device, READ, 0x0100)[4] == 0


def test_chunks_must_fit_what_was_announced(device: VirtualDlpc900) -> None:
    send(device, WRITE, 0x1A1B, b"\3")
    send(device, WRITE, 0x1A2A, struct.pack("<HI", 0, 2))
    assert refusal(device, 0x1A2B, b"\2\0\0") == 6
    assert refusal(device, 0x1A2B, b"\3\0\0\0\0") == 6


def test_starting_needs_the_image(device: VirtualDlpc900) -> None:
    for mode, code in ((3, 7), (1, 11)):
        send(device, WRITE, 0x1A1B, bytes((mode,)))
        send(device, WRITE, 0x1A34, DEFINITION)
        send(device, WRITE, 0x1A31, bytes.fromhex("010000000000"))
        assert refusal(device, 0x1A24, b"\2") == code
    send(device, WRITE, 0x1A1B, b"\0")
    assert refusal(device, 0x1A34, DEFINITION) == 5


def test_standby_parks_the_mirrors_and_reset_forgets(device: VirtualDlpc900, world: Watched) -> None:
    show(device, picture(2, FULL))
    assert refusal(device, 0x1A1B, b"\0") == 5  # running
    assert refusal(device, 0x0201, b"\1") == 5
    send(device, WRITE, 0x0200, b"\1")
    assert world.shown[-1] is None
    assert send(device, READ, 0x1A0C)[4] == 1
    assert refusal(device, 0x1A24, b"\2") == 5
    send(device, WRITE, 0x0200, b"\0")
    send(device, WRITE, 0x1A24, b"\2")
    assert world.shown[-1] is not None
    send(device, WRITE, 0x0200, b"\2")
    assert world.shown[-1] is None
    send(device, WRITE, 0x0201, b"\1")
    assert send(device, READ, 0x1A1B)[4] == 1
    device.close()
