"""Bursts: the DMD's frame synch triggers the generator, whose marker triggers the oscilloscope."""

import math
import tracemalloc
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.optics.mirrors import on_counts
from sim_backends.parameters import Parameters
from sim_backends.world.signals import AUX, Acquisition, Playback, Projection, TriggerCondition
from sim_backends.world.world import Noise, World
from tests.sim_backends.world.light import LIGHT, MARKER, RATE, Array, distance, quiet

PERIOD = 500
PICTURE_S, SYNCH_S = 44e-6, 10e-6
WINDOW = Acquisition((1, 2, 3, 4), RATE, 64, 98e-9)
LATER = Acquisition((1, 2, 3, 4), RATE, 64, 98e-9 + 2 * PERIOD / RATE)
PATTERNS = np.random.default_rng(5).integers(0, 256, (20, 768, 128), np.uint8)
for number, pattern in enumerate(PATTERNS):
    pattern[number * 30 : number * 30 + 150] = 0
COUNTS = on_counts(PATTERNS)
VOLTS = np.random.default_rng(0).uniform(-0.25, 0.25, PERIOD).astype(np.float32)
dim = partial(quiet, detector_gain_v_per_w=3e-4)


def triggered(*segments: Array, runs_on: bool = False) -> Playback:
    markers = [np.arange(segment.size) < segment.size // 2 for segment in segments]
    lengths = tuple(segment.size for segment in segments)
    return Playback(np.concatenate(segments), np.concatenate(markers), 0.0, 1.0, RATE, lengths, runs_on)


def continuous(volts: Array = VOLTS) -> Playback:
    return Playback(volts, np.arange(volts.size) < volts.size // 2, 0.0, 1.0, RATE)


THREE = triggered(np.tile(VOLTS, 3))


def bench(
    playback: Playback | None = THREE, parameters: Parameters | None = None, noise: Noise = "by-trigger"
) -> World:
    world = World(parameters, twin_seed=1, noise=noise)
    world.emit(LIGHT)
    world.play(playback)
    world.patch({1: 2, 2: 3, 3: 4, 4: 5})
    world.clock.advance(1e-3)
    return world


def burst(world: World, count: int = len(PATTERNS), **options: Any) -> Projection:
    projection = Projection(COUNTS[:count], world.clock.now, PICTURE_S, SYNCH_S, **options)
    world.project(projection)
    return projection


def coming(world: World, count: int = 1, **options: Any) -> NDArray[np.float64]:
    times = world.next_triggers(MARKER, count, **options)
    assert times is not None
    return times


def still(pattern: NDArray[np.uint8], acquisition: Acquisition, **options: Any) -> Array:
    """A frame of `pattern` with the drive repeated for ever."""
    world = bench(continuous(), **options)
    world.show(pattern)
    world.clock.advance(10e-6)
    frame: Array = world.record(acquisition, coming(world)).volts[0]
    return frame


def test_a_burst_has_the_frames_of_a_continuous_drive() -> None:
    world = bench(parameters=dim())
    burst(world)
    volts = world.record(LATER, coming(world, len(PATTERNS))).volts
    assert len(volts) == len(PATTERNS)
    for frame, pattern in zip(volts, PATTERNS, strict=True):
        expected = still(pattern, LATER, parameters=dim())
        np.testing.assert_allclose(frame, expected, atol=2e-3 * expected.max())


def test_a_burst_is_a_continuous_drive_within_noise() -> None:
    unshaken = Parameters(trigger_jitter_s=0.0, awg_jitter_s=0.0)  # jitter is common to a frame
    world = bench(parameters=unshaken)
    burst(world, 1, repeats=100)
    times = coming(world, 100)
    volts = world.record(LATER, times).volts
    steady = bench(continuous(), unshaken)
    steady.show(PATTERNS[0])
    steady.clock.advance(10e-6)
    expected = steady.record(LATER, coming(steady, 100)).volts
    noise = expected.std(axis=0)
    assert volts.std(axis=0).mean() == pytest.approx(noise.mean(), rel=0.05)
    away = (volts.mean(axis=0) - expected.mean(axis=0)) / (noise * np.sqrt(2 / 100))
    assert np.sqrt(np.mean(away**2)) == pytest.approx(1.0, abs=0.15)


def test_patterns_of_a_projection_are_those_shown_one_by_one() -> None:
    world = bench(continuous(), noise="by-state")
    projection = burst(world, 3)
    times = [coming(world, after_s=projection.start_s + number * PICTURE_S + SYNCH_S)[0] for number in range(3)]
    volts = world.record(WINDOW, np.array(times)).volts
    for frame, pattern in zip(volts, PATTERNS, strict=False):
        assert np.array_equal(frame, still(pattern, WINDOW, noise="by-state"))


def test_the_first_period_of_a_segment_starts_from_idle_light() -> None:
    world = bench(parameters=dim())
    burst(world, 1)
    long = Acquisition((1,), RATE, 3000, 98e-9 - 20e-9)
    trace = world.record(long, coming(world)).volts[0, 0]
    peak = trace.max()
    assert np.ptp(trace[:490]) < 2e-3 * peak
    assert np.ptp(trace[500:2000]) > 0.2 * peak
    assert np.ptp(trace[2400:]) < 2e-3 * peak
    np.testing.assert_allclose(trace[2400:], trace[0], atol=2e-3 * peak)
    np.testing.assert_allclose(trace[1000:1500], trace[1500:2000], atol=2e-3 * peak)
    assert np.abs(trace[500:600] - trace[1000:1100]).max() > 0.02 * peak


def test_records_before_and_after_a_segment_are_idle() -> None:
    world = bench(parameters=dim())
    burst(world, 1)
    time = coming(world)
    idle = world.record(Acquisition((1,), RATE, 64, 0.0), time).volts
    after = world.record(Acquisition((1,), RATE, 64, 5e-6), time).volts
    before = world.record(Acquisition((1,), RATE, 64, 0.0), time - 1e-6).volts
    assert np.ptp(idle) < 1e-3 * idle.max()
    np.testing.assert_allclose(after, idle, rtol=1e-3)
    np.testing.assert_allclose(before, idle, rtol=1e-3)


def test_batch_size_changes_no_byte() -> None:
    world = bench()
    burst(world)
    times = coming(world, len(PATTERNS))
    together = world.record(LATER, times)
    other = bench()
    burst(other)
    parts = [other.record(LATER, part).volts for part in np.split(times, [1, 4, 12])]
    assert np.array_equal(together.volts, np.concatenate(parts))
    assert together.keys[3] != together.keys[4]


def test_pictures_computed_side_by_side_have_the_same_bytes() -> None:
    counts = np.random.default_rng(6).integers(0, 730, (400, 784), np.uint16)

    def frames(at_once: int) -> Array:
        world = bench()
        world.project(Projection(counts, world.clock.now, PICTURE_S, SYNCH_S))
        times = np.split(coming(world, len(counts)), len(counts) // at_once)
        return np.concatenate([world.record(LATER, part).volts for part in times])

    assert np.array_equal(frames(400), frames(20))  # the cores share 400; 20 are computed by one of them


def test_repeats_of_a_pattern_have_noise_of_their_own() -> None:
    world = bench(noise="by-state")
    burst(world, 2, repeats=2)
    volts = world.record(LATER, coming(world, 5)).volts
    assert len(volts) == 4
    assert not np.array_equal(volts[0], volts[2])
    np.testing.assert_allclose(volts[0], volts[2], atol=0.06)
    world.clock.advance(1e-3)
    burst(world, 2, repeats=2)  # the same again is no change
    assert not np.array_equal(world.record(LATER, coming(world)).volts[0], volts[0])
    world.play(triggered(VOLTS))
    world.play(THREE)
    world.clock.advance(1e-3)
    burst(world, 2, repeats=2)
    assert np.array_equal(world.record(LATER, coming(world)).volts[0], volts[0])


def test_triggers_come_with_the_frame_synch() -> None:
    world = bench()
    projection = burst(world)
    times = coming(world, 30)
    assert times.size == 20
    np.testing.assert_allclose(times, projection.start_s + SYNCH_S + PICTURE_S * np.arange(20), atol=1e-12)
    assert coming(world, 5, holdoff_s=100e-6) == pytest.approx(times[:15:3])
    world.clock.advance(1.0)
    assert world.next_triggers(MARKER, 1) is None
    assert coming(world, 30, after_s=projection.start_s) == pytest.approx(times)
    assert world.next_triggers(TriggerCondition(AUX, 1.5, rising=True), 1, after_s=0.0) is None
    assert world.next_triggers(TriggerCondition(1, 0.01, rising=True), 1, after_s=0.0) is None
    falling = world.next_triggers(TriggerCondition(AUX, 0.5, rising=False), 1, after_s=0.0)
    assert falling == pytest.approx(times[:1] + 30e-9)


def test_a_projection_without_pulses_triggers_nothing() -> None:
    world = bench()
    burst(world, synch_pulse_s=0.0)
    assert world.next_triggers(MARKER, 1) is None


def test_a_projection_may_end_in_the_middle_of_a_repetition() -> None:
    world = bench()
    projection = burst(world, 3, repeats=3, left_out=2)
    assert coming(world, 99).size == 7
    world.clock.advance(projection.start_s + 20 * PICTURE_S)
    assert world.pictures_shown() == 7


def test_an_endless_projection_triggers_for_ever() -> None:
    world = bench()
    projection = burst(world, 3, loop=True)
    world.clock.advance(5000.0)
    times = coming(world, 6)
    assert times[0] - world.clock.now < PICTURE_S
    shown = world.record(LATER, times).volts
    assert distance(shown[:3], shown[3:]) < 0.25 * shown.std()
    turns = np.rint((times - projection.start_s - SYNCH_S) / PICTURE_S).astype(int) % 3
    away = shown[turns.tolist().index(0)] - still(PATTERNS[0], LATER)
    assert away.std() < 0.02


def test_the_input_level_and_edge_decide() -> None:
    world = bench()
    world.awg_trigger_level(4.0, rising=True)
    projection = burst(world)
    assert world.next_triggers(MARKER, 1) is None
    world.awg_trigger_level(1.4, rising=False)
    assert coming(world)[0] == pytest.approx(projection.start_s + SYNCH_S + projection.synch_pulse_s)
    world.awg_trigger_level(1.4, rising=True)
    assert coming(world)[0] == pytest.approx(projection.start_s + SYNCH_S)


def test_records_wait_for_the_mirrors() -> None:
    """Without a delay the light comes before the mirrors have moved; a delay in between sees them on their way."""

    def second(delay: float) -> Array:
        world = bench(parameters=dim())
        world.project(Projection(COUNTS[:2], world.clock.now, PICTURE_S, delay))
        frame: Array = world.record(LATER, coming(world, 2)).volts[1]
        return frame

    old, new = (still(pattern, LATER, parameters=dim()) for pattern in PATTERNS[:2])
    np.testing.assert_allclose(second(0.0), old, atol=2e-3 * old.max())
    np.testing.assert_allclose(second(SYNCH_S), new, atol=2e-3 * old.max())
    between = second(0.85e-6)
    assert min(np.abs(between - old).max(), np.abs(between - new).max()) > 0.02 * old.max()


def test_a_record_can_see_the_picture_change() -> None:
    world = bench(continuous(np.zeros(2, np.float32)), dim())
    burst(world, 2)
    change = world.clock.now + PICTURE_S
    trace = world.record(Acquisition((1,), 1e9, 4000, 0.0), np.array([change - 1e-6])).volts[0, 0]
    assert np.ptp(trace[:1400]) < 1e-3 * trace.max()
    assert np.ptp(trace[2600:]) < 1e-3 * trace.max()
    assert abs(trace[0] - trace[-1]) > 0.02 * trace.max()


def test_further_points_see_the_picture_of_their_time() -> None:
    world = bench(continuous(), dim())
    projection = Projection(np.array([[729], [0]], np.uint16).repeat(784, axis=1), world.clock.now, PICTURE_S)
    world.project(projection)
    whole = Acquisition((1,), 1e9, 60_000, 0.0)
    seen = world.record(replace(whole, samples=500), np.array([projection.start_s]), whole=whole)
    world.show(PATTERNS[0])
    bright, dark = (seen.further(replace(whole, samples=9000, start_s=start_s)).mean() for start_s in (30e-6, 50e-6))
    assert bright > 100 * dark


@pytest.mark.parametrize(("lit_s", "dark_s"), [(math.inf, math.inf), (20e-6, 25e-6)])
def test_a_long_record_sees_every_picture(lit_s: float, dark_s: float) -> None:
    world = bench(continuous(), dim())
    pictures = np.array([[729], [0], [729], [0]], np.uint16).repeat(784, axis=1)
    projection = Projection(pictures, world.clock.now, PICTURE_S, lit_s=lit_s)
    world.project(projection)
    record = world.record(Acquisition((1,), 1e9, 160_000, 0.0), projection.start_s + np.array([0.0, 2 * PICTURE_S]))
    traces = record.volts[:, 0]
    bright = traces[0, 10_000:15_000].mean()

    def seen(trigger: int, after_s: float) -> float:
        return float(traces[trigger, round(after_s * 1e9) :][:5000].mean() / bright)

    for trigger, number, expected in [(0, 0, 1), (0, 1, 0), (0, 2, 1), (0, 3, 0), (1, 0, 1), (1, 1, 0), (1, 2, 0)]:
        assert seen(trigger, number * PICTURE_S + 10e-6) == pytest.approx(expected, abs=0.1)
        if expected and dark_s < PICTURE_S:
            assert seen(trigger, number * PICTURE_S + dark_s) == pytest.approx(0, abs=0.1)


def test_segments_play_in_turn() -> None:
    one, other = VOLTS, VOLTS[::-1].copy()
    world = bench(triggered(one, other), dim())
    world.project(Projection(COUNTS[[0, 0, 0, 0]], world.clock.now, PICTURE_S, SYNCH_S))
    volts = world.record(WINDOW, coming(world, 4)).volts
    np.testing.assert_allclose(volts[:2], volts[2:], atol=2e-3 * volts.max())
    assert np.abs(volts[0] - volts[1]).max() > 0.1 * volts.max()


def test_software_triggers_play_one_segment_each() -> None:
    world = bench(parameters=dim())
    world.show(PATTERNS[0])
    world.clock.advance(10e-6)
    assert world.next_triggers(MARKER, 1) is None
    idle = world.record(LATER, np.array([world.clock.now])).volts[0]
    assert np.ptp(idle[0]) < 1e-3 * idle.max()
    armed = world.clock.now
    world.trigger_awg()
    world.clock.advance(10e-9)
    world.trigger_awg()  # one plays: ignored
    world.clock.advance(1e-6)
    world.trigger_awg()
    times = coming(world, 5, after_s=armed)
    assert times == pytest.approx([armed, armed + 1.01e-6])
    volts = world.record(LATER, times).volts
    expected = still(PATTERNS[0], LATER, parameters=dim())
    np.testing.assert_allclose(volts[1], expected, atol=2e-3 * expected.max())
    world.play(continuous())
    world.trigger_awg()  # nothing waits for it


def test_the_last_segment_can_run_on() -> None:
    world = bench(triggered(VOLTS, runs_on=True), dim())
    world.show(PATTERNS[0])
    world.clock.advance(10e-6)
    began = world.clock.now
    world.trigger_awg()
    times = coming(world, 4)
    assert times == pytest.approx(began + 20e-9 * np.arange(4))
    volts = world.record(WINDOW, times).volts
    expected = still(PATTERNS[0], WINDOW, parameters=dim())
    np.testing.assert_allclose(volts[1:], np.stack([expected] * 3), atol=2e-3 * expected.max())
    assert np.abs(volts[0] - expected).max() > 0.02 * expected.max()  # from idle light
    world.clock.advance(1.0)
    world.trigger_awg()  # it runs already
    np.testing.assert_allclose(world.record(WINDOW, coming(world)).volts[0], expected, atol=2e-3 * expected.max())
    assert world.next_triggers(TriggerCondition(AUX, 0.5, rising=False), 2) is not None


def test_running_on_comes_after_the_segments_before() -> None:
    world = bench(triggered(VOLTS[:200], VOLTS, runs_on=True))
    burst(world, 5)
    times = coming(world, 4)
    assert times[1] - times[0] == pytest.approx(PICTURE_S)
    assert np.diff(times[1:]) == pytest.approx(20e-9)


def test_holding_stops_pictures_and_triggers() -> None:
    world = bench()
    burst(world, 20, loop=True)
    world.clock.advance(2.5 * PICTURE_S)
    assert world.pictures_shown() == 3
    world.hold()
    assert world.next_triggers(MARKER, 1) is None
    world.play(continuous())
    world.clock.advance(1e-3)
    volts = world.record(WINDOW, coming(world)).volts[0]
    assert np.array_equal(volts, still(PATTERNS[2], WINDOW))
    world.hold()


def test_slave_mode_may_be_late() -> None:
    world = bench(parameters=dim())
    burst(world, 2, triggered=True, trigger_delay_s=15e-6)
    world.trigger_awg()
    assert world.pictures_shown() == 0
    world.clock.advance(15e-6)
    assert world.pictures_shown() == 1


def test_slave_mode_follows_the_marker() -> None:
    world = bench(parameters=dim())
    world.show(PATTERNS[9])
    world.clock.advance(1e-3)
    burst(world, 3, triggered=True)
    assert world.pictures_shown() == 0
    for count in (1, 2, 3, 3):
        world.trigger_awg()
        assert world.pictures_shown() == count
        world.clock.advance(10e-6)
        world.trigger_awg()  # too early for the DMD
        assert world.pictures_shown() == count
        world.clock.advance(50e-6)
    times = coming(world, 99, after_s=0.0)
    assert times.size == 8
    seen = world.record(LATER, times[1::2]).volts
    for frame, pattern in zip(seen, PATTERNS[[0, 1, 2, 2]], strict=True):
        expected = still(pattern, LATER, parameters=dim())
        np.testing.assert_allclose(frame, expected, atol=2e-3 * expected.max())


def test_ac_coupling_takes_the_idle_level_away() -> None:
    world = bench(parameters=dim(detector_coupling="ac"))
    burst(world, 1)
    volts = world.record(Acquisition((1,), RATE, 64, 0.0), coming(world)).volts
    direct = bench(parameters=dim())
    burst(direct, 1)
    assert np.abs(volts).max() < 1e-2 * direct.record(LATER, coming(direct)).volts.max()


@pytest.mark.parametrize(
    ("counts", "every_s"),
    [(np.zeros(784, np.uint16), PICTURE_S), (np.zeros((0, 784), np.uint16), PICTURE_S), (COUNTS, 0.0)],
)
def test_a_projection_needs_pictures_and_a_time(counts: NDArray[np.uint16], every_s: float) -> None:
    with pytest.raises(ValueError, match="mirrors on"):
        World().project(Projection(counts, 0.0, every_s))


def test_segments_must_add_up() -> None:
    marker = np.zeros(4, bool)
    with pytest.raises(ValueError, match="add up"):
        Playback(np.zeros(4, np.float32), marker, 0.0, 1.0, RATE, (1, 2))
    with pytest.raises(ValueError, match="give lengths"):
        Playback(np.zeros(4, np.float32), marker, 0.0, 1.0, RATE, runs_on=True)


def test_bursts_that_are_over_take_no_memory() -> None:
    world, pictures = bench(), np.tile(COUNTS, (10, 1))

    def carry_out(bursts: int) -> int:
        for _ in range(bursts):
            world.project(Projection(pictures, world.clock.now, PICTURE_S, SYNCH_S))
            world.clock.advance(len(pictures) * PICTURE_S)
            world.record(WINDOW, coming(world, 3, after_s=world.clock.now - 4 * PICTURE_S))
            world.hold()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        first = carry_out(1)
        few = carry_out(2)
        many = carry_out(5)
    finally:
        tracemalloc.stop()
    assert many - few < few - first
