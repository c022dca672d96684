"""The virtual DMD: life cycle, memory, data formats, timing, return codes, and what the mirrors do."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.optics.mirrors import on_counts
from sim_backends.virtual import VirtualAlp
from sim_backends.virtual.alp.instrument import AlpConnection
from sim_backends.world.keyed_random import digest
from sim_backends.world.signals import Playback, Projection
from tests.sim_backends.virtual.watched import Ask, Mirrors, Watched, messages

IMAGE = np.random.default_rng(3).integers(0, 256, (768, 128), np.uint8)
OTHER = np.random.default_rng(4).integers(0, 256, (768, 128), np.uint8)


@pytest.fixture
def dmd(ask: Ask, world: Watched) -> VirtualAlp:
    """Allocated, with one sequence of three pictures that takes packed bits."""
    dmd = VirtualAlp(world)
    assert ask(dmd, "ALP:DEVALLOC") == b"0"
    assert ask(dmd, "ALP:SEQALLOC 1,3") == b"0,1"
    assert ask(dmd, "ALP:SEQCONTROL 1,2110,2") == b"0"
    return dmd


def put(ask: Ask, dmd: VirtualAlp, offset: int, pixels: Mirrors, sequence: int = 1, count: int = 1) -> bytes:
    data = np.ascontiguousarray(pixels).tobytes()
    return ask(dmd, f"ALP:SEQPUT {sequence},{offset},{count},#{len(str(len(data)))}{len(data)}".encode() + data)


def equal(shown: NDArray[np.uint16] | None, expected: Mirrors) -> bool:
    return shown is not None and np.array_equal(shown, on_counts(expected))


def test_a_picture_is_shown_at_once(ask: Ask, dmd: VirtualAlp, world: Watched) -> None:
    assert put(ask, dmd, 0, IMAGE) == b"0"
    assert ask(dmd, "ALP:PROJSTARTCONT 1") == b"0"
    assert equal(world.picture, IMAGE)
    assert ask(dmd, "ALP:PROJINQUIRE 2400\nALP:DEVINQUIRE 2002") == b"0,12000,1100"


def test_halting_keeps_the_picture_and_freeing_does_not(ask: Ask, dmd: VirtualAlp, world: Watched) -> None:
    put(ask, dmd, 0, IMAGE)
    ask(dmd, "ALP:PROJSTARTCONT 1")
    count = len(world.shown)
    assert ask(dmd, "ALP:PROJHALT") == b"0"
    assert len(world.shown) == count
    assert ask(dmd, "ALP:PROJINQUIRE 2400") == b"0,1201"
    assert put(ask, dmd, 0, OTHER) == b"0"
    assert len(world.shown) == count
    assert ask(dmd, "ALP:DEVFREE") == b"0"
    assert world.picture is None
    assert ask(dmd, "ALP:DEVINQUIRE 2002") == b"1003"
    assert ask(dmd, "ALP:DEVALLOC\nALP:PROJSTARTCONT 1\nALP:DEVINQUIRE 2003") == b"010050,43690"


def test_halting_the_device_parks_the_mirrors(ask: Ask, dmd: VirtualAlp, world: Watched) -> None:
    put(ask, dmd, 0, IMAGE)
    assert ask(dmd, "ALP:PROJSTARTCONT 1\nALP:DEVHALT") == b"00"
    assert world.picture is None
    assert ask(dmd, "ALP:PROJSTARTCONT 1") == b"0"
    assert equal(world.picture, IMAGE)
    assert ask(dmd, "ALP:PROJHALT\nALP:DEVHALT") == b"00"
    assert world.picture is None


@pytest.mark.parametrize(
    ("form", "planes", "packer"),
    [
        (0, 1, lambda bits: bits * np.uint8(128)),
        (0, 1, lambda bits: bits * np.uint8(255)),
        (0, 8, lambda bits: np.where(bits, np.uint8(200), np.uint8(127))),
        (1, 1, lambda bits: bits | np.uint8(0xF0)),
        (1, 4, lambda bits: np.where(bits, np.uint8(8), np.uint8(7))),
        (2, 1, lambda bits: np.packbits(bits, axis=1)),
        (3, 1, lambda bits: np.packbits(bits, axis=1)[::-1]),
    ],
)
def test_every_data_format_turns_the_same_mirrors(
    ask: Ask, world: Watched, form: int, planes: int, packer: Callable[[Mirrors], Mirrors]
) -> None:
    dmd = VirtualAlp(world)
    ask(dmd, f"ALP:DEVALLOC 13042\nALP:SEQALLOC {planes},1\nALP:SEQCONTROL 1,2110,{form}")
    assert put(ask, dmd, 0, packer(np.unpackbits(IMAGE, axis=1))) == b"0"
    ask(dmd, "ALP:PROJSTARTCONT 1")
    assert equal(world.picture, IMAGE)


def test_several_pictures_and_a_range(ask: Ask, dmd: VirtualAlp, world: Watched) -> None:
    assert put(ask, dmd, 1, np.stack([IMAGE, OTHER]), count=2) == b"0"
    assert ask(dmd, "ALP:SEQCONTROL 1,2102,1\nALP:SEQCONTROL 1,2101,1") == b"00"
    ask(dmd, "ALP:PROJSTARTCONT 1")
    assert equal(world.picture, IMAGE)
    ask(dmd, "ALP:DEVHALT\nALP:SEQCONTROL 1,2102,2\nALP:SEQCONTROL 1,2101,2\nALP:PROJSTARTCONT 1")
    assert equal(world.picture, OTHER)
    ask(dmd, "ALP:DEVHALT\nALP:SEQCONTROL 1,2101,0\nALP:PROJSTARTCONT 1")
    assert equal(world.picture, np.zeros_like(IMAGE))
    ask(dmd, "ALP:DEVHALT")
    assert put(ask, dmd, 1, np.stack([OTHER, IMAGE]), count=0) == b"0"


def test_finite_runs_end_in_virtual_time(ask: Ask, dmd: VirtualAlp, world: Watched) -> None:
    put(ask, dmd, 0, np.stack([IMAGE, IMAGE, OTHER]), count=3)
    assert ask(dmd, "ALP:SEQTIMING 1,0,1000,0,0,0\nALP:SEQCONTROL 1,2100,10") == b"00"
    began = world.clock.now
    assert ask(dmd, "ALP:PROJSTART 1\nALP:PROJINQUIRE 2400\nALP:PROJWAIT\nALP:PROJINQUIRE 2400") == b"00,120000,1201"
    assert world.clock.now - began == pytest.approx(30e-3)
    assert equal(world.picture, OTHER)
    ask(dmd, "ALP:PROJSTART 1")
    world.clock.advance(1.0)
    assert ask(dmd, "ALP:SEQFREE 1\nALP:PROJWAIT") == b"00"
    assert equal(world.picture, OTHER)


def test_inversion_and_upside_down(ask: Ask, dmd: VirtualAlp, world: Watched) -> None:
    put(ask, dmd, 0, IMAGE)
    assert ask(dmd, "ALP:PROJCONTROL 2306,1\nALP:PROJSTARTCONT 1") == b"00"
    assert equal(world.picture, ~IMAGE)
    assert ask(dmd, "ALP:PROJCONTROL 2306,0") == b"1002"
    ask(dmd, "ALP:PROJHALT\nALP:PROJCONTROL 2306,0\nALP:PROJCONTROL 2307,1\nALP:PROJSTARTCONT 1")
    assert equal(world.picture, IMAGE[::-1])
    assert ask(dmd, "ALP:PROJINQUIRE 2307\nALP:PROJINQUIRE 2300") == b"0,10,2301"


def test_parked_mirrors(ask: Ask, dmd: VirtualAlp, world: Watched) -> None:
    put(ask, dmd, 0, IMAGE)
    ask(dmd, "ALP:PROJSTARTCONT 1")
    assert ask(dmd, "ALP:DEVCONTROL 2064,1") == b"1002"
    assert ask(dmd, "ALP:DEVHALT\nALP:DEVCONTROL 2064,1") == b"00"
    assert world.picture is None
    assert ask(dmd, "ALP:PROJSTARTCONT 1\nALP:DEVCONTROL 2064,0\nALP:PROJSTARTCONT 1") == b"100200"
    assert equal(world.picture, IMAGE)


def test_facts_of_the_device(ask: Ask, dmd: VirtualAlp) -> None:
    assert ask(dmd, "*IDN?") == b"ViALUX,ALP-4.3 (simulated),13042,43"
    for kind, value in {2000: 13042, 2001: 43, 2002: 1102, 2003: 43687, 2021: 4, 2057: 768, 2058: 1024}.items():
        assert ask(dmd, f"ALP:DEVINQUIRE {kind}") == f"0,{value}".encode()
    assert ask(dmd, "ALP:DEVCONTROL 2005,2009\nALP:DEVINQUIRE 2005") == b"00,2009"
    assert ask(dmd, "ALP:DEVCONTROL 2005,0\nALP:DEVINQUIRE 2005") == b"00,2008"
    for kind, value in {2200: 1, 2201: 3, 2211: 52, 2103: 1, 2104: 2105, 2100: 1, 2101: 0, 2102: 2}.items():
        assert ask(dmd, f"ALP:SEQINQUIRE 1,{kind}") == f"0,{value}".encode()


@pytest.mark.parametrize(
    ("uninterrupted", "timing", "picture", "illuminate"),
    [
        (False, "0,0", 33334, 33290),
        (False, "0,1000", 1000, 956),
        (False, "956,0", 1000, 956),
        (False, "0,52", 52, 8),
        (False, "8,0", 52, 8),
        (True, "0,44", 44, 44),
        (True, "100,0", 100, 100),
        (True, "50,100", 100, 50),
    ],
)
def test_timing(ask: Ask, dmd: VirtualAlp, uninterrupted: bool, timing: str, picture: int, illuminate: int) -> None:
    ask(dmd, f"ALP:SEQCONTROL 1,2104,{2106 if uninterrupted else 2105}")
    assert ask(dmd, f"ALP:SEQTIMING 1,{timing},0,0,0") == b"0"
    assert ask(dmd, "ALP:SEQINQUIRE 1,2203\nALP:SEQINQUIRE 1,2204") == f"0,{picture}0,{illuminate}".encode()


@pytest.mark.parametrize("timing", ["0,51,0,0,0", "957,1000,0,0,0", "0,10000001,0,0,0", "7,44,0,0,0", "200,100,0,0,0",
                                    "0,1000,2000,0,0", "0,1000,0,2000,0", "0,1000,0,0,200000",
                                    "0,200000,140000,0,0"])  # fmt: skip
def test_timing_limits(ask: Ask, dmd: VirtualAlp, timing: str) -> None:
    before = ask(dmd, "ALP:SEQINQUIRE 1,2203")
    assert ask(dmd, f"ALP:SEQTIMING 1,{timing}") == b"1005"
    assert ask(dmd, "ALP:SEQINQUIRE 1,2203") == before


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("ALP:DEVALLOC", 1004),
        ("ALP:DEVINQUIRE 9999", 1005),
        ("ALP:DEVINQUIRE", 1005),
        ("ALP:DEVINQUIRE x", 1005),
        ("ALP:DEVCONTROL 2005,7", 1005),
        ("ALP:DEVCONTROL 9999,0", 1005),
        ("ALP:SEQALLOC 9,1", 1005),
        ("ALP:SEQALLOC 1,0", 1005),
        ("ALP:SEQALLOC 1,43688", 1007),
        ("ALP:SEQALLOC 8,5461", 1007),
        ("ALP:SEQFREE 2", 1005),
        ("ALP:SEQPUT 1,0,1,#14abcd", 1006),
        ("ALP:SEQPUT 1,3,1,#14abcd", 1005),
        ("ALP:SEQPUT 1,-1,1,#14abcd", 1005),
        ("ALP:SEQPUT 1,0,4,#14abcd", 1005),
        ("ALP:SEQPUT 2,0,1,#14abcd", 1005),
        ("ALP:SEQPUT 1,0,1,7", 1006),
        ("ALP:SEQPUT 1,0,1,#2x", 1006),
        ("ALP:SEQCONTROL 1,2102,3", 1005),
        ("ALP:SEQCONTROL 1,2101,-1", 1005),
        ("ALP:SEQCONTROL 1,2110,9", 1005),
        ("ALP:SEQCONTROL 1,2100,0", 1005),
        ("ALP:SEQCONTROL 1,9999,0", 1005),
        ("ALP:SEQINQUIRE 1,9999", 1005),
        ("ALP:SEQINQUIRE 5,2203", 1005),
        ("ALP:PROJCONTROL 2300,1", 1005),
        ("ALP:PROJINQUIRE 1", 1005),
        ("ALP:PROJSTART 9", 1005),
        ("ALP:NOTHING 1", 1005),
    ],
)
def test_refusals(ask: Ask, dmd: VirtualAlp, line: str, code: int) -> None:
    assert ask(dmd, line) == str(code).encode()
    assert ask(dmd, "*OPC?") == b"1"


def test_a_shown_sequence_is_in_use(ask: Ask, dmd: VirtualAlp) -> None:
    ask(dmd, "ALP:PROJSTARTCONT 1")
    assert put(ask, dmd, 0, IMAGE) == b"1008"
    for line in ("ALP:SEQFREE 1", "ALP:SEQCONTROL 1,2100,2", "ALP:SEQTIMING 1,0,0,0,0,0"):
        assert ask(dmd, line) == b"1008"
    assert ask(dmd, "ALP:DEVFREE") == b"1002"
    assert ask(dmd, "ALP:PROJWAIT") == b"1005"
    assert ask(dmd, "ALP:SEQALLOC 1,1") == b"0,2"
    assert put(ask, dmd, 0, IMAGE, sequence=2) == b"1006"
    ask(dmd, "ALP:SEQCONTROL 2,2110,2")
    assert put(ask, dmd, 0, IMAGE, sequence=2) == b"0"
    assert ask(dmd, "ALP:PROJSTARTCONT 2\nALP:SEQFREE 1") == b"00"


def test_packed_bits_have_one_plane(ask: Ask, dmd: VirtualAlp) -> None:
    ask(dmd, "ALP:SEQALLOC 8,1\nALP:SEQCONTROL 2,2110,2")
    assert put(ask, dmd, 0, IMAGE, sequence=2) == b"1005"


def test_without_a_device(ask: Ask, world: Watched) -> None:
    dmd = VirtualAlp(world)
    for line in ("DEVHALT", "DEVFREE", "SEQALLOC 1,1", "PROJSTART 1", "PROJWAIT", "PROJCONTROL 2300,2301"):
        assert ask(dmd, f"ALP:{line}") == b"1003"
    assert ask(dmd, "ALP:DEVALLOC 77") == b"1001"
    assert ask(dmd, "ALP:DEVALLOC 0") == b"0"


def test_memory_is_given_back(ask: Ask, dmd: VirtualAlp) -> None:
    assert ask(dmd, "ALP:SEQALLOC 1,43687") == b"0,2"
    assert ask(dmd, "ALP:SEQALLOC 1,1") == b"1007"
    assert ask(dmd, "ALP:SEQFREE 2\nALP:SEQALLOC 8,5460\nALP:DEVINQUIRE 2003") == b"00,30,7"
    ask(dmd, "*RST")
    assert ask(dmd, "ALP:DEVINQUIRE 2003\nALP:DEVALLOC\nALP:DEVINQUIRE 2003") == b"100300,43690"


def test_unknown_common_commands_are_not_answered(ask: Ask, dmd: VirtualAlp) -> None:
    assert ask(dmd, "*FOO?;*ESR?") == b"32"


def test_time_costs(ask: Ask, dmd: VirtualAlp, world: Watched) -> None:
    began = world.clock.now
    put(ask, dmd, 0, np.stack([IMAGE, OTHER]), count=2)
    assert world.clock.now - began == pytest.approx(10e-3)
    began = world.clock.now
    ask(dmd, "ALP:PROJSTARTCONT 1")
    assert world.clock.now - began == pytest.approx(44e-6)


DARK = np.zeros_like(IMAGE)


def shows(world: Watched, expected: Mirrors) -> bool:
    """Whether these mirrors are what the light finds now."""
    return world._pictures.standing(world.clock.now)[0] == digest(on_counts(expected[np.newaxis])[0].tobytes())


@pytest.mark.parametrize("halted", ["", "\nALP:PROJHALT"])
@pytest.mark.parametrize(
    ("lines", "dark"),
    [
        ("", True),
        ("ALP:SEQCONTROL 1,2104,2106", True),
        ("ALP:SEQTIMING 1,0,1000,0,0,0\nALP:SEQCONTROL 1,2104,2106", True),
        ("ALP:SEQCONTROL 1,2104,2106\nALP:SEQTIMING 1,0,1000,0,0,0", False),
        ("ALP:SEQCONTROL 1,2104,2106\nALP:SEQTIMING 1,0,1000,0,0,0\nALP:SEQCONTROL 1,2104,2105", False),
    ],
    ids=["as allocated", "not timed", "timed before", "timed", "timed and set back"],
)
def test_timing_activates_the_binary_mode(
    ask: Ask, dmd: VirtualAlp, world: Watched, lines: str, dark: bool, halted: str
) -> None:
    put(ask, dmd, 0, IMAGE)
    ask(dmd, f"{lines}\nALP:SEQCONTROL 1,2102,0")
    picture_us = int(ask(dmd, "ALP:SEQINQUIRE 1,2203").split(b",")[1])
    assert ask(dmd, "ALP:SEQINQUIRE 1,2211") == (b"0,52" if dark else b"0,44")
    began = world.clock.now
    assert ask(dmd, "ALP:PROJSTARTCONT 1") == b"0"
    for place, off in ((0.1, False), (0.9, False), (0.9999, dark), (1.1, False), (1.9999, dark), (7.9999, dark)):
        world.clock.advance(began + place * 1e-6 * picture_us - world.clock.now)
        assert shows(world, DARK if off else IMAGE)
        assert world.pictures_shown() == (int(place) + 1 if dark else 1)
    ask(dmd, halted)
    assert shows(world, DARK if dark else IMAGE)


def test_a_film_with_dark_phases(ask: Ask, dmd: VirtualAlp, world: Watched) -> None:
    put(ask, dmd, 0, np.stack([IMAGE, OTHER, IMAGE]), count=3)
    ask(dmd, "ALP:SEQTIMING 1,0,1000,0,0,0")
    began = world.clock.now
    ask(dmd, "ALP:PROJSTART 1")
    for number, picture in enumerate((IMAGE, OTHER, IMAGE, DARK)):
        for place, expected in ((0.5, picture), (0.97, DARK)):
            world.clock.advance(began + (number + place) * 1e-3 - world.clock.now)
            assert shows(world, expected)


def test_a_device_has_one_holder(ask: Ask, world: Watched) -> None:
    dmd = VirtualAlp(world)
    with dmd.connection() as one:
        assert said(one, "ALP:DEVALLOC\nALP:SEQALLOC 1,1\nALP:PROJSTARTCONT 1") == b"00,10"
        with dmd.connection() as other:
            assert said(other, "ALP:DEVALLOC") == b"1004"
            for line in ("DEVHALT", "PROJHALT", "DEVFREE", "SEQALLOC 1,1", "SEQFREE 1", "DEVINQUIRE 2000"):
                assert said(other, f"ALP:{line}") == b"1003"
            assert said(other, "*RST") == b""
            assert said(other, "*IDN?").startswith(b"ViALUX")
        assert said(one, "ALP:PROJINQUIRE 2400") == b"0,1200"
    with dmd.connection() as other:
        assert world.picture is None, "what nobody holds floats"
        assert said(other, "ALP:DEVALLOC\nALP:DEVINQUIRE 2003\nALP:DEVFREE") == b"00,436900"
        with dmd.connection() as third:
            assert said(third, "ALP:DEVALLOC") == b"0"
        assert said(other, "ALP:DEVALLOC\n*RST\nALP:DEVALLOC") == b"00"


def said(connection: AlpConnection, text: str) -> bytes:
    reply = b""
    for message in messages(text):
        try:
            next(connection.run(message))
        except StopIteration as end:
            reply += b"".join(end.value)
    return reply


FRAMES = np.random.default_rng(6).integers(0, 256, (5, 768, 128), np.uint8)


@pytest.fixture
def film(ask: Ask, dmd: VirtualAlp) -> VirtualAlp:
    """Sequence 2: five pictures, one every millisecond."""
    assert ask(dmd, "ALP:SEQALLOC 1,5\nALP:SEQCONTROL 2,2110,2\nALP:SEQTIMING 2,0,1000,10,100,0") == b"0,200"
    assert put(ask, dmd, 0, FRAMES, sequence=2, count=5) == b"0"
    return dmd


def test_a_finite_sequence_plays_its_range(ask: Ask, film: VirtualAlp, world: Watched) -> None:
    ask(film, "ALP:SEQCONTROL 2,2102,3\nALP:SEQCONTROL 2,2101,1\nALP:SEQCONTROL 2,2100,2")
    began = world.clock.now
    assert ask(film, "ALP:PROJSTART 2") == b"0"
    for number in (1, 2, 3, 1, 2, 3):
        assert equal(world.picture, FRAMES[number])
        assert ask(film, "ALP:PROJINQUIRE 2400") == b"0,1200"
        world.clock.advance(1e-3)
    assert equal(world.picture, FRAMES[3])
    assert ask(film, "ALP:PROJINQUIRE 2400\nALP:PROJWAIT") == b"0,12010"
    assert ask(film, "ALP:PROJSTART 2\nALP:PROJWAIT") == b"00"
    assert world.clock.now - began == pytest.approx(12e-3 + 44e-6, abs=1e-5)
    projection = world.shown[-1]
    assert isinstance(projection, Projection)
    assert (projection.synch_delay_s, projection.synch_pulse_s) == pytest.approx((10e-6, 100e-6))
    assert projection.synch_high


def test_an_endless_sequence_halts_at_the_picture_of_then(ask: Ask, film: VirtualAlp, world: Watched) -> None:
    ask(film, "ALP:DEVCONTROL 2004,2007\nALP:PROJSTARTCONT 2")
    world.clock.advance(7.5e-3)
    assert equal(world.picture, FRAMES[2])
    assert ask(film, "ALP:PROJWAIT\nALP:PROJHALT\nALP:PROJINQUIRE 2400") == b"100500,1201"
    world.clock.advance(1e-3)
    assert world.pictures_shown() == 1
    projection = world.shown[-1]
    assert isinstance(projection, Projection)
    assert projection.loop
    assert not projection.synch_high
    assert ask(film, "ALP:SEQFREE 2") == b"0"


def test_slave_mode_waits_for_edges(ask: Ask, film: VirtualAlp, world: Watched) -> None:
    world.play(Playback(np.zeros(9, np.float32), np.arange(9) < 4, 0.0, 1.0, 25e9, (9,)))
    assert ask(film, "ALP:PROJCONTROL 2300,2302\nALP:PROJINQUIRE 2300\nALP:PROJSTART 2") == b"00,23020"
    world.clock.advance(1.0)
    assert world.picture is None
    assert ask(film, "ALP:PROJINQUIRE 2400\nALP:PROJWAIT") == b"0,12001005"
    for picture in FRAMES:
        world.trigger_awg()
        assert equal(world.picture, picture)
        world.clock.advance(1e-3)
    assert ask(film, "ALP:PROJINQUIRE 2400\nALP:PROJWAIT") == b"0,12010"


def test_a_picture_loaded_over_another_takes_its_place(ask: Ask, film: VirtualAlp, world: Watched) -> None:
    ask(film, "ALP:PROJSTART 2")
    whole = world.shown[-1]
    assert isinstance(whole, Projection)
    assert np.array_equal(whole.counts, on_counts(FRAMES))
    ask(film, "ALP:PROJWAIT")
    put(ask, film, 1, IMAGE, sequence=2)
    ask(film, "ALP:PROJSTART 2")
    mixed = world.shown[-1]
    assert isinstance(mixed, Projection)
    assert np.array_equal(mixed.counts, on_counts(np.stack([FRAMES[0], IMAGE, *FRAMES[2:]])))
