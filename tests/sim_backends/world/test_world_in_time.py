"""The world in time: triggers, where records begin, how long they are, jitter."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.parameters import SPEED_OF_LIGHT
from sim_backends.world.signals import AUX, Acquisition, Playback, TriggerCondition
from sim_backends.world.world import LONGEST_S, ClockEnded, VirtualClock, upcoming
from tests.sim_backends.world.light import MARKER, RATE, Array, bench, coming, distance, playback, quiet, shoot


def test_triggers_come_with_the_marker_and_not_before_now() -> None:
    world = bench()
    world.clock.advance(3.3e-9)
    times = coming(world, MARKER, 3)
    assert times[0] >= world.clock.now
    np.testing.assert_allclose(np.diff(times), 20e-9, atol=1e-15)
    falling = coming(world, TriggerCondition(AUX, 0.5, rising=False))
    assert (falling[0] - times[0]) % 20e-9 == pytest.approx(10e-9, abs=1e-13)
    assert world.next_triggers(TriggerCondition(AUX, 1.5, rising=True), 1) is None
    assert np.diff(coming(world, MARKER, 2, 1e-3))[0] == pytest.approx(1e-3, abs=20e-9)


@pytest.mark.parametrize("later_s", [5000.0, 260_000.0])
def test_trigger_phase_survives_a_long_virtual_time(later_s: float) -> None:
    early, late = bench(parameters=quiet()), bench(parameters=quiet())
    late.clock.advance(later_s)
    assert np.array_equal(shoot(early, 8).volts, shoot(late, 8).volts)


def test_light_itself_can_trigger() -> None:
    world = bench(parameters=quiet())
    period = Acquisition((2,), RATE, 500, 0.0)
    trace = shoot(world, acquisition=period).volts[0, 0]
    level = float((trace.min() + trace.max()) / 2)
    times = world.next_triggers(TriggerCondition(2, level, rising=True), 5)
    assert times is not None
    before, at = world.record(Acquisition((2,), 250e9, 2, -4e-12), times).volts[:, 0].T
    assert np.all(before < at)
    np.testing.assert_allclose(at, level, rtol=0.1)
    assert world.next_triggers(TriggerCondition(2, 5.0, rising=True), 1) is None


def test_start_time_moves_the_window() -> None:
    world = bench(parameters=quiet())
    here = shoot(world, acquisition=Acquisition((1,), RATE, 40, 0.0)).volts[0, 0]
    later = shoot(world, acquisition=Acquisition((1,), RATE, 20, 10 * 40e-12)).volts[0, 0]
    np.testing.assert_allclose(later, here[10:30], atol=1e-3 * here.max())


def test_light_is_late_by_the_path_delay() -> None:
    here = bench(parameters=quiet())
    late = bench(parameters=quiet(path_delay_s=here.parameters.path_delay_s + 400e-12))
    one, other = shoot(here).volts[0], shoot(late).volts[0]
    np.testing.assert_allclose(other[:, 10:], one[:, :54], atol=1e-3 * one.max())


def test_light_takes_its_time_through_a_longer_fibre() -> None:
    """40 m, and late by 97.6 ns more: the onset of a drive that waited for its trigger shows it."""

    def onset_s(**changes: Any) -> float:
        world = bench(parameters=quiet(**changes))
        world.play(replace(playback(), lengths=(500,)))
        world.trigger_awg()
        times = coming(world)
        world.clock.advance(1e-3)
        volts = world.record(Acquisition((1,), RATE, 6000, 0.0), times).volts[0, 0]
        return float(np.flatnonzero(np.abs(volts - volts[0]) > 0.02 * volts.max())[0]) / RATE

    assert onset_s() == pytest.approx(98e-9, abs=0.4e-9)
    assert onset_s(fibre_length_m=40.0) == pytest.approx(98e-9 + 20 * 1.4626 / SPEED_OF_LIGHT, abs=0.4e-9)
    for length_m in (20.0, 40.0):
        assert onset_s(light_path="direct", fibre_length_m=length_m) == pytest.approx(1.67e-9, abs=0.4e-9)


@pytest.mark.parametrize("lengths", [None, (500,)], ids=["free-running", "triggered"])
@pytest.mark.parametrize(("skew_s", "marker_delay_s"), [(0.0, 0.45e-9), (0.33e-9, 0.0), (-0.33e-9, 0.1e-9)])
def test_skew_delays_the_light_and_marker_delay_the_trigger(
    lengths: tuple[int, ...] | None, skew_s: float, marker_delay_s: float
) -> None:
    world = bench(parameters=quiet())
    plain = replace(playback(), lengths=lengths)

    def seen(played: Playback, start_s: float) -> Array:
        world.play(played)
        world.trigger_awg()
        times = coming(world)
        world.clock.advance(1e-3)
        volts: Array = world.record(Acquisition((1,), RATE, 64, 98e-9 + start_s), times).volts[0, 0]
        return volts

    expected = seen(plain, 2e-9 + marker_delay_s - skew_s)
    found = seen(replace(plain, skew_s=skew_s, marker_delay_s=marker_delay_s), 2e-9)
    assert expected.std() > 0.1 * expected.max()
    np.testing.assert_allclose(found, expected, atol=1e-3 * expected.max())


def test_long_records_repeat_with_the_drive() -> None:
    world = bench(parameters=quiet())
    volts = shoot(world, acquisition=Acquisition((1,), RATE, 1700, 0.0)).volts[0, 0]
    np.testing.assert_allclose(volts[500:1700], volts[:1200], atol=2e-3 * volts.max())
    short = shoot(world, acquisition=Acquisition((1,), RATE, 400, 0.0)).volts[0, 0]
    np.testing.assert_allclose(volts[:400], short, atol=2e-3 * volts.max())


@pytest.mark.parametrize("drive_hz", [23.7e9, 22e9, 12e9])
def test_long_records_of_an_odd_drive_rate(drive_hz: float) -> None:
    world = bench(parameters=quiet())
    world.play(replace(playback(), sample_rate=drive_hz))
    volts = shoot(world, acquisition=Acquisition((1,), RATE, 1100, 0.0)).volts[0, 0]
    short = shoot(world, acquisition=Acquisition((1,), RATE, 300, 0.0)).volts[0, 0]
    np.testing.assert_allclose(volts[:300], short, atol=2e-3 * volts.max())


def test_finer_sampling_contains_the_coarse_samples() -> None:
    world = bench(parameters=quiet())
    coarse = shoot(world, acquisition=Acquisition((1,), RATE, 30, 0.0)).volts[0, 0]
    fine = shoot(world, acquisition=Acquisition((1,), 2 * RATE, 60, 0.0)).volts[0, 0]
    np.testing.assert_allclose(fine[::2], coarse, atol=5e-3 * coarse.max())


def test_free_running_clocks_slip_and_report_it() -> None:
    tied, free = bench(parameters=quiet()), bench(parameters=quiet(shared_reference=False))
    fine = shoot(tied, acquisition=Acquisition((1,), 400e9, 1600, -200e-12)).volts[0, 0]
    record = shoot(free, 20, Acquisition((1,), RATE, 64, 0.0))
    assert np.abs(record.trigger_offset_s).max() <= 20e-12
    assert record.trigger_offset_s.std() > 5e-12
    for volts, offset in zip(record.volts[:, 0], record.trigger_offset_s, strict=True):
        wanted = np.interp(np.arange(64) * 40e-12 + offset, np.arange(1600) * 2.5e-12 - 200e-12, fine)
        assert distance(volts, wanted) < 0.07 * fine.std()  # the 10 ps grid's own error


def test_jitter_is_as_large_as_stated() -> None:
    steady = bench(parameters=quiet())
    shaking = bench(parameters=quiet().model_copy(update={"trigger_jitter_s": 1.2e-12}))
    fine = shoot(steady, acquisition=Acquisition((1,), RATE, 64, 0.0)).volts[0, 0]
    ahead = shoot(steady, acquisition=Acquisition((1,), RATE, 64, 2e-12)).volts[0, 0]
    slope = (ahead - fine) / 2e-12
    volts = shoot(shaking, 300, Acquisition((1,), RATE, 64, 0.0)).volts[:, 0]
    shifts = (volts - fine) @ slope / (slope @ slope)
    assert shifts.std() == pytest.approx(1.2e-12, rel=0.2)


def test_ac_coupling_takes_the_mean_away() -> None:
    whole = Acquisition((1, 2), 4 * RATE, 2000, 0.0)
    volts = shoot(bench(parameters=quiet(detector_coupling="ac")), acquisition=whole).volts[0]
    direct = shoot(bench(parameters=quiet()), acquisition=whole).volts[0]
    assert np.abs(volts.mean(axis=1)).max() < 0.02 * direct.mean()
    np.testing.assert_allclose(volts.std(axis=1), direct.std(axis=1), rtol=0.01)


def test_clock_goes_forward_only() -> None:
    clock = VirtualClock()
    clock.advance(1.5)
    assert clock.now == 1.5
    with pytest.raises(ValueError, match="at least 0"):
        clock.advance(-1.0)
    with pytest.raises(ValueError, match="at least 0"):
        clock.advance(float("nan"))


def test_clock_ends_where_it_would_no_longer_tell_picoseconds() -> None:
    clock = VirtualClock()
    clock.advance(LONGEST_S)
    with pytest.raises(ClockEnded, match="start the simulated bench anew"):
        clock.advance(1e-9)
    assert clock.now == LONGEST_S


@given(
    st.lists(st.integers(0, 99), min_size=1, max_size=4, unique=True),
    st.floats(0, 1e-3),
    st.integers(1, 8),
    st.floats(0, 3e-7),
)
def test_upcoming_events_are_the_next_ones(places: list[int], after: float, count: int, holdoff: float) -> None:
    phases = np.sort(np.array(places)) * 1e-9
    times = upcoming(phases, 100e-9, after=after, count=count, holdoff=holdoff)
    assert times.size == count
    assert times[0] >= after - 1e-12
    assert times[0] <= after + 100e-9 + 1e-12
    gaps = np.diff(times)
    assert np.all(gaps >= max(holdoff, 1e-9) - 1e-12)
    assert np.all(gaps <= holdoff + 100e-9 + 1e-12)
    away = np.abs((times[:, None] - phases + 50e-9) % 100e-9 - 50e-9).min(axis=1)
    assert away == pytest.approx(0, abs=1e-12)
