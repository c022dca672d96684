from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.parameters import Parameters
from sim_backends.world import AUX, Acquisition, Emission, Playback, Record, TriggerCondition, World

Array = NDArray[np.float32]
RATE = 25e9
LIGHT = Emission(1550.0, 0.03)
MARKER = TriggerCondition(AUX, 0.5, rising=True)
FOUR = Acquisition((1, 2, 3, 4), RATE, 64, 0.0)


def pack(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    bits = np.zeros((768, 1024), np.uint8)
    bits[6:762, 134:890] = np.kron(image.reshape(28, 28), np.ones((27, 27), np.uint8))
    return np.packbits(bits, axis=1)


def picture(seed: int, fill: float = 0.2) -> NDArray[np.uint8]:
    return pack((np.random.default_rng(seed).random(784) < fill).astype(np.uint8))


def playback(seed: int = 0, samples: int = 500) -> Playback:
    volts = np.random.default_rng(seed).uniform(-0.25, 0.25, samples).astype(np.float32)
    return Playback(volts, np.arange(samples) < samples // 2, 0.0, 1.0, RATE)


def bench(
    seed: int = 1, parameters: Parameters | None = None, image: int = 0, patching: dict[int, int] | None = None
) -> World:
    world = World(parameters, twin_seed=seed)
    world.emit(LIGHT)
    world.play(playback())
    world.patch(patching or {1: 2, 2: 3, 3: 4, 4: 5})
    world.show(picture(image))
    world.clock.advance(10e-6)
    return world


def coming(
    world: World, condition: TriggerCondition = MARKER, count: int = 1, holdoff_s: float = 0.0
) -> NDArray[np.float64]:
    times = world.next_triggers(condition, count, holdoff_s)
    assert times is not None
    return times


def shoot(world: World, count: int = 1, acquisition: Acquisition = FOUR, **options: Any) -> Record:
    return world.record(acquisition, coming(world, count=count), **options)


def quiet(**changes: Any) -> Parameters:
    """Enough light for shot noise not to matter, no other noise."""
    return Parameters(
        amplifier_gain_db=0.0,
        booster_gain_db=98.0,
        detector_gain_v_per_w=6e-4,
        detector_nep_w_per_rthz=0.0,
        laser_rin_db_per_hz=-300.0,
        trigger_jitter_s=0.0,
        **changes,
    )


def distance(first: Array, second: Array) -> float:
    return float(np.sqrt(np.mean((first - second) ** 2)))


@pytest.fixture(scope="module")
def spread() -> tuple[float, Array]:
    """Rms noise of repeated records of one image, and their mean."""
    volts = shoot(bench(), 200).volts
    return float(volts.std(axis=0).mean()), volts.mean(axis=0)


def test_shapes_and_level() -> None:
    record = shoot(bench(), 3)
    assert record.volts.shape == (3, 4, 64)
    assert record.volts.dtype == np.float32
    assert record.trigger_offset_s.tolist() == [0.0, 0.0, 0.0]
    assert 0.005 < record.volts.mean() < 0.3


def test_same_seed_same_bytes_other_seed_others() -> None:
    assert np.array_equal(shoot(bench(1)).volts, shoot(bench(1)).volts)
    assert distance(shoot(bench(1)).volts, shoot(bench(2)).volts) > 0.005


def test_repeats_differ_by_noise_only(spread: tuple[float, Array]) -> None:
    noise, mean = spread
    world = bench()
    first, second = shoot(world).volts[0], shoot(world).volts[0]
    assert not np.array_equal(first, second)
    assert distance(first, second) < 2 * noise
    assert distance(first, mean) < 1.5 * noise


@pytest.mark.parametrize(
    "change",
    [
        lambda world: world.show(picture(1)),
        lambda world: world.play(playback(1)),
        lambda world: world.emit(Emission(1550.1, 0.03)),
        lambda world: world.patch({1: 6, 2: 7, 3: 8, 4: 9}),
        lambda world: world.emit(Emission(1550.0, 0.02)),
    ],
    ids=["image", "drive", "wavelength", "ports", "power"],
)
def test_every_instrument_changes_the_record(change: Callable[[World], None], spread: tuple[float, Array]) -> None:
    noise, mean = spread
    world = bench()
    change(world)
    world.clock.advance(10e-6)
    assert distance(shoot(world, 200).volts.mean(axis=0), mean) > noise


def test_batch_size_changes_no_byte() -> None:
    together = shoot(bench(), 9)
    world = bench()
    alone = [shoot(world) for _ in range(9)]
    assert np.array_equal(together.volts, np.concatenate([record.volts for record in alone]))
    for number, record in enumerate(alone):
        assert together.frame_noise(number).random() == record.noise.random()


def test_count_restarts_when_the_state_changes() -> None:
    world = bench()
    first, second = shoot(world).volts, shoot(world).volts
    world.show(picture(0))  # the same again: no change
    third = shoot(world).volts
    assert not np.array_equal(third, first)
    assert not np.array_equal(third, second)
    world.show(picture(1))
    world.clock.advance(10e-6)
    shoot(world)
    world.show(picture(0))
    world.clock.advance(10e-6)
    assert np.array_equal(shoot(world).volts, first)


def test_setting_to_equal_values_is_no_change() -> None:
    world = bench()
    shoot(world)
    plain = bench()
    shoot(plain)
    world.emit(Emission(1550.0, 0.03))
    world.play(playback())
    world.patch({4: 5, 3: 4, 2: 3, 1: 2})
    assert np.array_equal(shoot(world).volts, shoot(plain).volts)


def test_vertical_setting_draws_other_noise(spread: tuple[float, Array]) -> None:
    noise, _ = spread
    one, other = shoot(bench(), setting=b"10 mV").volts, shoot(bench(), setting=b"20 mV").volts
    assert not np.array_equal(one, other)
    assert distance(one, other) < 2 * noise


@pytest.mark.parametrize(
    "dark",
    [
        lambda world: world.emit(None),
        lambda world: world.emit(Emission(1550.0, 0.0)),
        lambda world: world.show(None),
        lambda world: world.emit(LIGHT, lit_from_s=1.0),
    ],
    ids=["laser off", "no power", "mirrors floating", "still tuning"],
)
def test_dark(dark: Callable[[World], None]) -> None:
    world = bench()
    dark(world)
    world.clock.advance(10e-6)
    volts = shoot(world, 400).volts
    trace = volts.mean(axis=0)
    assert trace.std(axis=1).max() < 3 * volts.std() / 20  # nothing but noise around the amplifier's own light
    assert 1e-3 < volts.std() < 3e-3
    assert volts.mean() < 2e-3


def test_light_returns_when_tuning_is_over() -> None:
    world = bench()
    world.emit(LIGHT, lit_from_s=0.5)
    world.clock.advance(1.0)
    assert shoot(world).volts.std() > 5e-3


def test_idle_modulator_gives_a_static_trace_and_no_marker() -> None:
    world = bench(parameters=quiet())
    world.play(None)
    assert world.next_triggers(MARKER, 1) is None
    volts = world.record(FOUR, np.array([1.0])).volts
    assert volts.std(axis=2).max() < 2e-3 * volts.max()
    assert volts.max() > 1e-3


def test_unconnected_channels_are_dark_and_bypass_unplugs_the_chip() -> None:
    world = bench(patching={1: 3})
    volts = shoot(world).volts[0]
    assert volts[0].std() > 5e-3
    assert volts[1:].std() < 3e-3
    world.patch({1: 3, 2: 0})
    volts = shoot(world).volts[0]
    assert volts[0].std() < 3e-3
    assert volts[1].std() > 5e-3


def test_the_input_port_gives_no_light() -> None:
    assert shoot(bench(patching={1: 10})).volts[0, 0].std() < 3e-3


def test_averaging_reduces_noise_with_the_root() -> None:
    volts = shoot(bench(), 256).volts
    sixteens = volts.reshape(16, 16, 4, 64).mean(axis=1)
    assert sixteens.std(axis=0, ddof=1).mean() == pytest.approx(volts.std(axis=0, ddof=1).mean() / 4, rel=0.1)


def test_brightness_grows_with_signal_noise() -> None:
    unboosted = Parameters(booster_gain_db=0.0, amplifier_gain_db=38.0)
    volts = shoot(bench(parameters=unboosted), 400).volts
    bright = volts.mean(axis=0) > np.quantile(volts.mean(axis=0), 0.8)
    assert volts.std(axis=0)[bright].mean() > 1.5 * volts.std(axis=0)[~bright].mean()


def test_mirrors_leave_and_arrive_when_they_should() -> None:
    world = bench(parameters=quiet())
    before = shoot(world).volts
    world.show(picture(5))
    shown = world.clock.now
    world.clock.advance(10e-6)
    after = shoot(world).volts

    def share(delay: float) -> tuple[float, float]:
        volts = world.record(FOUR, np.array([np.ceil((shown + delay) / 20e-9) * 20e-9])).volts
        return distance(volts, before) / distance(before, after), distance(volts, after) / distance(before, after)

    assert share(0.4e-6)[0] < 0.02
    assert min(share(1.0e-6)) > 0.1
    assert share(1.6e-6)[1] < 0.02


def test_showing_during_transit_starts_from_where_the_mirrors_are() -> None:
    world = bench(parameters=quiet())
    world.show(None)
    world.clock.advance(1.0e-6)
    world.show(picture(0))
    half = world.record(FOUR, np.array([np.ceil((world.clock.now + 0.1e-6) / 20e-9) * 20e-9])).volts
    world.clock.advance(10e-6)
    full = shoot(world).volts
    np.testing.assert_allclose(half, full / 4, atol=0.05 * full.max())  # half the field, a quarter of the power


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


def test_trigger_phase_survives_a_long_virtual_time() -> None:
    early, late = bench(parameters=quiet()), bench(parameters=quiet())
    late.clock.advance(5000.0)
    assert np.array_equal(shoot(early).volts, shoot(late).volts)


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
    late = bench(parameters=quiet(path_delay_s=98e-9 + 400e-12))
    one, other = shoot(here).volts[0], shoot(late).volts[0]
    np.testing.assert_allclose(other[:, 10:], one[:, :54], atol=1e-3 * one.max())


def test_long_records_repeat_with_the_drive() -> None:
    world = bench(parameters=quiet())
    volts = shoot(world, acquisition=Acquisition((1,), RATE, 1700, 0.0)).volts[0, 0]
    np.testing.assert_allclose(volts[500:1700], volts[:1200], atol=2e-3 * volts.max())
    short = shoot(world, acquisition=Acquisition((1,), RATE, 400, 0.0)).volts[0, 0]
    np.testing.assert_allclose(volts[:400], short, atol=2e-3 * volts.max())


def test_long_records_of_an_odd_drive_rate() -> None:
    world = bench(parameters=quiet())
    odd = playback()
    world.play(Playback(odd.volts, odd.marker, 0.0, 1.0, 23.7e9))
    volts = shoot(world, acquisition=Acquisition((1,), RATE, 1100, 0.0)).volts[0, 0]
    short = shoot(world, acquisition=Acquisition((1,), RATE, 300, 0.0)).volts[0, 0]
    np.testing.assert_allclose(volts[:300], short, atol=0.03 * volts.max())


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
        assert distance(volts, wanted) < 0.06 * fine.std()  # the 10 ps grid's own error


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


def test_wander_is_a_function_of_virtual_time() -> None:
    moving = quiet(laser_wander_hz=1e9, chip_wander_hz=1e9, wander_step_s=1.0)

    def at(seconds: float) -> Array:
        world = bench(parameters=moving)
        world.clock.advance(seconds)
        return shoot(world).volts

    assert np.array_equal(at(3.2), at(3.2))
    assert distance(at(3.2), at(3.7)) < 1e-3
    assert distance(at(3.2), at(7.2)) > 3e-3


def test_detectors_cannot_exceed_their_limit() -> None:
    assert shoot(bench(parameters=Parameters(detector_gain_v_per_w=1e5))).volts.max() == pytest.approx(1.0)


def test_direct_path_sees_no_mirrors() -> None:
    world = bench(parameters=Parameters(light_path="direct"))
    before = shoot(world).volts
    world.show(None)
    world.clock.advance(10e-6)
    assert before.std() > 5e-3
    assert distance(shoot(world).volts, before) < 0.1 * before.std()


def test_a_record_needs_nothing_connected() -> None:
    world = World(twin_seed=3)
    assert world.next_triggers(MARKER, 1) is None
    volts = world.record(FOUR, np.array([0.0])).volts
    assert 1e-3 < volts.std() < 2.5e-3


@pytest.mark.parametrize("wrong", [{5: 2}, {0: 2}, {1: 15}, {1: -1}])
def test_impossible_patching_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match=r"channels are 1\.\.4"):
        World().patch(wrong)


def test_time_spent_in_optics_is_counted() -> None:
    world = bench()
    before = world.physics_seconds
    shoot(world)
    assert world.physics_seconds > before
