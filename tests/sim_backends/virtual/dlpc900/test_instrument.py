"""The virtual DLPC900, report by report."""

import struct

import numpy as np
import pytest

from sim_backends.optics import mirrors
from sim_backends.virtual.dlpc900 import planes
from sim_backends.virtual.dlpc900.instrument import MODE_S, REPORT_S, VirtualDlpc900
from sim_backends.world.signals import Projection
from tests.sim_backends.virtual.dlpc900.cable import Cable
from tests.sim_backends.virtual.watched import Watched

WRITE, READ, SILENT, REFUSED = 0x40, 0xC0, 0x00, 0x20
MODE, RUN, LUT, ENTRY, STATUS = 0x1A1B, 0x1A24, 0x1A31, 0x1A34, 0x1A0C
STOP, PAUSE, START = b"\0", b"\1", b"\2"
DEFINITION = bytes.fromhex("0000C80000100000000000 00")  # the guide's example: pattern 0, 200 us, red, one bit


@pytest.fixture
def device(world: Watched) -> Cable:
    return Cable(VirtualDlpc900(world))


def send(device: Cable, flags: int, command: int, data: bytes = b"", number: int = 7) -> bytes:
    packet = struct.pack("<BBHH", flags, number, len(data) + 2, command) + data
    for start in range(0, len(packet), 64):
        device.write(packet[start : start + 64].ljust(64, b"\0"))
    return device.read()


def refusal(device: Cable, command: int, data: bytes = b"") -> int:
    reply = send(device, WRITE, command, data)
    assert reply[0] == WRITE | REFUSED
    told = send(device, READ, 0x0100)
    assert told[4] == told[6] != 0
    return told[4]


def picture(compression: int, body: bytes) -> bytes:
    return struct.pack("<4sHHI8sIBBB21x", b"Spld", 1920, 1080, 48 + len(body), b"\xff" * 8, 0, 0, compression, 1) + body


def upload(device: Cable, image: bytes, index: int = 0) -> bytes:
    send(device, WRITE, 0x1A2A, struct.pack("<HI", index, len(image)))
    reply = b""
    for start in range(0, len(image), 504):
        chunk = image[start : start + 504]
        reply = send(device, WRITE, 0x1A2B, struct.pack("<H", len(chunk)) + chunk)
    return reply


FULL = b"".join(b"\x80\x0f\x00\x00\x01\x00\x00" for _ in range(1080)) + b"\0\1\0"  # 1920 times bit 0


def on_the_fly(device: Cable, mode: int = 3) -> None:
    send(device, WRITE, MODE, bytes((mode,)))
    while send(device, READ, MODE)[4] != mode:
        pass


def show(device: Cable, image: bytes) -> None:
    on_the_fly(device)
    send(device, WRITE, 0x1A34, DEFINITION)
    send(device, WRITE, 0x1A31, bytes.fromhex("010000000000"))
    upload(device, image)
    send(device, WRITE, 0x1A24, b"\2")


def test_a_reply_carries_the_number_of_its_command(device: Cable) -> None:
    assert send(device, WRITE, 0x1A1B, b"\3", number=200)[:4] == bytes((WRITE, 200, 0, 0))
    reply = send(device, READ, MODE, number=201)
    assert (len(reply), reply[:5]) == (64, bytes((READ, 201, 1, 0, 1)))
    assert send(device, SILENT, RUN, STOP) == b""
    assert send(device, READ, 0x0205)[4:8] == bytes((0, 0, 0, 6))
    assert send(device, READ, 0x0206)[5:22] == b"LCR6500 simulated"
    assert send(device, READ, 0x1A0A)[4] == 1


def test_reports_cost_time(device: Cable, world: Watched) -> None:
    before = world.clock.now
    send(device, READ, 0x1A0B)
    assert world.clock.now - before == pytest.approx(REPORT_S)


def test_a_mode_takes_its_time_and_nothing_is_done_before(device: Cable, world: Watched) -> None:
    began = world.clock.now
    send(device, WRITE, MODE, b"\3")
    assert send(device, READ, MODE)[4] == 1
    assert refusal(device, ENTRY, DEFINITION) == 5
    while send(device, READ, MODE)[4] == 1:
        pass
    assert world.clock.now - began >= MODE_S
    assert send(device, WRITE, ENTRY, DEFINITION)[0] == WRITE


def test_the_light_fills_it(device: Cable, world: Watched) -> None:
    show(device, picture(2, FULL))
    assert world.picture is not None
    assert (world.picture == mirrors.MIRRORS_PER_SUPERPIXEL**2).all()
    assert send(device, READ, STATUS)[4] == 2
    send(device, WRITE, RUN, STOP)
    assert world.picture is None


def test_superpixels_have_as_many_mirrors_on_as_those_of_any_dmd() -> None:
    pixels = np.zeros((1080, 1920), np.uint32)
    pixels[8 : 8 + 38, 428 : 428 + 19] = 1 << 5  # half of the first one
    pixels[8 + 38 : 8 + 2 * 38, 428 + 38 : 428 + 2 * 38] = 1 << 23 | 1 << 5
    counts = planes.on_counts(pixels)
    assert counts.shape == (24, 784)
    assert {place: counts[5][place] for place in np.flatnonzero(counts[5])} == {0: 364, 29: 729}
    assert np.flatnonzero(counts.any(axis=1)).tolist() == [5, 23]
    assert np.flatnonzero(counts[23]).tolist() == [29]


ALL_BITS = b"".join(b"\x80\x0f\xff\xff\xff\0\0" for _ in range(1080)) + b"\0\1\0"


def entry(index: int, *, exposure_us: int = 200, options: int = 0x10, silent: int = 0, bit: int = 0) -> bytes:
    exposure = exposure_us.to_bytes(3, "little")
    return struct.pack("<H3sB3xBH", index, exposure, options, silent, bit << 11)


def sequence(device: Cable, count: int, to_display: int, image: bytes = ALL_BITS, **manner: int) -> None:
    """So many patterns, the bits of one image in turn, started."""
    on_the_fly(device)
    for index in range(count):
        assert send(device, WRITE, ENTRY, entry(index, bit=index, **manner))[0] == WRITE
    assert send(device, WRITE, LUT, struct.pack("<HI", count, to_display))[0] == WRITE
    upload(device, picture(2, image))
    assert send(device, WRITE, RUN, START)[0] == WRITE


def projected(world: Watched) -> Projection:
    found = world.shown[-1]
    assert isinstance(found, Projection)
    return found


def test_a_sequence_ends_when_so_many_patterns_were_displayed(device: Cable, world: Watched) -> None:
    sequence(device, 3, 7, exposure_us=5000)
    began = projected(world).start_s
    assert send(device, READ, LUT)[4:10] == struct.pack("<HI", 3, 7)
    while send(device, READ, STATUS)[4] & 2:
        pass
    assert world.clock.now - began == pytest.approx(7 * 5e-3, abs=REPORT_S)
    assert world.pictures_shown() == 7
    assert world.picture is not None
    assert refusal(device, ENTRY, entry(0)) == 5, "stop it first"
    send(device, WRITE, RUN, STOP)
    assert send(device, WRITE, ENTRY, entry(0))[0] == WRITE


def test_images_count_for_the_table_that_they_came_after(device: Cable, world: Watched) -> None:
    sequence(device, 2, 2)
    send(device, WRITE, RUN, STOP)
    send(device, WRITE, ENTRY, entry(0, bit=0, exposure_us=300))
    send(device, WRITE, ENTRY, entry(1, bit=1, exposure_us=300))
    send(device, WRITE, LUT, struct.pack("<HI", 2, 7))
    assert send(device, WRITE, RUN, START)[0] == WRITE, "other exposures, shown more often: the same places"
    send(device, WRITE, RUN, STOP)
    send(device, WRITE, LUT, struct.pack("<HI", 1, 1))
    assert refusal(device, RUN, START) == 7, "another number of entries"
    upload(device, picture(2, ALL_BITS))
    send(device, WRITE, RUN, START)
    assert projected(world).counts.all()
    send(device, WRITE, RUN, STOP)
    send(device, WRITE, ENTRY, entry(0, bit=5, exposure_us=300))
    send(device, WRITE, LUT, struct.pack("<HI", 1, 1))
    assert refusal(device, RUN, START) == 7, "another bit"


def test_a_paused_sequence_goes_on_with_its_pattern(device: Cable, world: Watched) -> None:
    half = b"".join(b"\x80\x0f\0\0\x05\0\0" for _ in range(1080)) + b"\0\1\0"  # bits 0 and 2
    sequence(device, 3, 30, half, exposure_us=5000)
    while world.pictures_shown() < 5:
        send(device, READ, STATUS)
    send(device, WRITE, RUN, PAUSE)
    assert not send(device, READ, STATUS)[4] & 2
    send(device, WRITE, RUN, START)
    shown = projected(world)
    assert [bool(row.any()) for row in shown.counts] == [False, True, True], "the fifth, the sixth, the seventh"
    assert len(shown.counts) * shown.repeats - shown.left_out == 26


@pytest.mark.parametrize(
    ("setting", "delay_us", "pulse_us", "high"),
    [((0, 0, 0), 0, 20, True), ((1, -5, 75), -5, 100, False), ((0, 40, 0), 40, 0, True)],
)
def test_the_pulse_of_trigger_output_2(
    device: Cable, world: Watched, setting: tuple[int, int, int], delay_us: float, pulse_us: float, *, high: bool
) -> None:
    assert send(device, WRITE, 0x1A1E, struct.pack("<Bhh", *setting))[0] == WRITE
    assert send(device, READ, 0x1A1E)[4:9] == struct.pack("<Bhh", *setting)
    sequence(device, 2, 2)
    shown = projected(world)
    assert (shown.synch_delay_s, shown.synch_pulse_s) == pytest.approx((1e-6 * delay_us, 1e-6 * pulse_us))
    assert shown.synch_high is high
    assert refusal(device, 0x1A1E, struct.pack("<Bhh", 0, 0, 0)) == 5, "while it runs"
    send(device, WRITE, RUN, STOP)
    sequence(device, 2, 2, silent=1)
    assert projected(world).synch_pulse_s == 0


def test_trigger_input_1_brings_the_next_pattern(device: Cable, world: Watched) -> None:
    assert send(device, WRITE, 0x1A35, struct.pack("<HB", 150, 0))[0] == WRITE
    sequence(device, 2, 2, options=0x90)
    shown = projected(world)
    assert shown.triggered
    assert shown.trigger_delay_s == pytest.approx(150e-6)
    assert send(device, READ, STATUS)[4] == 2


def test_inverted_data(device: Cable, world: Watched) -> None:
    send(device, WRITE, 0x1A30, b"\1")
    sequence(device, 1, 0)
    assert not projected(world).counts.any()


@pytest.mark.parametrize(("command", "place"), [(0x1008, 27 * 28), (0x1009, 27)])
def test_a_flip_turns_pictures_round(device: Cable, world: Watched, command: int, place: int) -> None:
    corner = bytearray(picture(0, bytes(3 * 1920 * 1080)))
    for row in range(8, 8 + 38):
        for column in range(428, 428 + 38):
            corner[48 + 3 * (1920 * row + column) + 2] = 1
    assert send(device, WRITE, command, b"\1")[0] == WRITE
    assert send(device, READ, command)[4] == 1
    show(device, bytes(corner))
    assert np.flatnonzero(projected(world).counts).tolist() == [place]


def test_an_idle_controller_shows_nothing_until_it_is_told_otherwise(device: Cable, world: Watched) -> None:
    sequence(device, 1, 0)
    send(device, WRITE, RUN, STOP)
    send(device, WRITE, 0x0201, b"\1")
    assert send(device, READ, 0x0201)[4] == 1
    assert refusal(device, RUN, START) == 5
    send(device, WRITE, 0x0201, b"\0")
    assert send(device, WRITE, RUN, START)[0] == WRITE


@pytest.mark.parametrize("other", [{"exposure_us": 300}, {"options": 0x90}, {"silent": 1}])
def test_what_is_not_simulated_is_refused(device: Cable, other: dict[str, int]) -> None:
    on_the_fly(device)
    upload(device, picture(2, ALL_BITS))
    send(device, WRITE, ENTRY, entry(0))
    send(device, WRITE, ENTRY, entry(1, **other))
    send(device, WRITE, LUT, struct.pack("<HI", 2, 0))
    assert refusal(device, RUN, START) == 16


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
def test_bad_images_are_refused(device: Cable, image: bytes) -> None:
    on_the_fly(device)
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
        (0x1A1E, struct.pack("<Bhh", 0, -21, 0), 6),
        (0x1A1E, struct.pack("<Bhh", 2, 0, 0), 6),
        (0x1A35, struct.pack("<HB", 104, 0), 6),
        (0x1A36, b"", 6),
        (0x1A34, struct.pack("<H", 400) + DEFINITION[2:], 15),
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
def test_what_the_device_refuses(device: Cable, command: int, data: bytes, code: int) -> None:
    on_the_fly(device)
    assert refusal(device, command, data) == code
    assert send(device, READ, 0x0101)[4:].split(b"\0")[0]
    send(device, WRITE, 0x1A1B, b"\3")
    assert send(device, READ, 0x0100)[4] == 0


def test_chunks_must_fit_what_was_announced(device: Cable) -> None:
    on_the_fly(device)
    send(device, WRITE, 0x1A2A, struct.pack("<HI", 0, 2))
    assert refusal(device, 0x1A2B, b"\2\0\0") == 6
    assert refusal(device, 0x1A2B, b"\3\0\0\0\0") == 6


def test_starting_needs_the_image(device: Cable) -> None:
    for mode, code in ((3, 7), (1, 11)):
        on_the_fly(device, mode)
        send(device, WRITE, 0x1A34, DEFINITION)
        send(device, WRITE, 0x1A31, bytes.fromhex("010000000000"))
        assert refusal(device, 0x1A24, b"\2") == code
    on_the_fly(device, 0)
    assert refusal(device, 0x1A34, DEFINITION) == 5


def test_standby_parks_the_mirrors_and_reset_forgets(device: Cable, world: Watched) -> None:
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
