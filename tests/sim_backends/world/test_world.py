"""The world: what changes a record, what names its noise, and what light does to the detectors."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sim_backends.parameters import Parameters
from sim_backends.world.signals import Acquisition, Emission
from sim_backends.world.world import World
from tests.sim_backends.world.light import (
    FOUR,
    LIGHT,
    MARKER,
    RATE,
    Array,
    bench,
    distance,
    picture,
    playback,
    quiet,
    shoot,
)


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
    assert together.keys == tuple(key for record in alone for key in record.keys)


def shots_in_turn(world: World, count: int) -> Array:
    """Records of one picture, another one shown between them."""
    volts = []
    for number in range(2 * count):
        world.show(picture(number % 2))
        world.clock.advance(10e-6)
        volts.append(shoot(world).volts[0])
    return np.array(volts[::2])


def test_shots_of_one_picture_scatter_as_triggers_in_a_row_do(spread: tuple[float, Array]) -> None:
    noise, mean = spread
    volts = shots_in_turn(bench(), 256)
    assert volts.std(axis=0).mean() == pytest.approx(noise, rel=0.05)
    assert distance(volts.mean(axis=0), mean) < 2 * noise / np.sqrt(200)
    sixteens = volts.reshape(16, 16, 4, 64).mean(axis=1)
    assert sixteens.std(axis=0, ddof=1).mean() == pytest.approx(volts.std(axis=0, ddof=1).mean() / 4, rel=0.1)


def test_the_same_settings_from_the_start_give_the_same_bytes() -> None:
    assert np.array_equal(shots_in_turn(bench(), 3), shots_in_turn(bench(), 3))


def test_noise_by_state_begins_anew_when_the_state_changes() -> None:
    world = bench(noise="by-state")
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
        lambda world: world.emit(LIGHT, lit_from_s=1.0),
    ],
    ids=["laser off", "no power", "still tuning"],
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


def test_floating_mirrors_send_what_their_contrast_leaves(spread: tuple[float, Array]) -> None:
    _, lit = spread
    world = bench()
    world.show(None)
    world.clock.advance(10e-6)
    left = shoot(world, 400).volts.mean(axis=0)
    assert 0 < left.std(axis=1).max() < 0.05 * lit.std(axis=1).max()


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
    volts = shoot(bench(), 2048).volts
    sixteens = volts.reshape(128, 16, 4, 64).mean(axis=1)
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


@pytest.mark.parametrize("fill", [0.02, 0.98])
def test_the_amplifier_has_not_followed_mirrors_that_only_just_move(fill: float) -> None:
    world = bench(parameters=Parameters(amplifier_saturation_w=1e-3))
    whole = Acquisition((1, 2, 3, 4), RATE, 50_000, 0.0)
    still = round(world.parameters.mirror_leaves_s * RATE) - 1000
    settled = shoot(world, acquisition=whole).volts[..., :still].mean()
    world.show(picture(5, fill))
    moving = shoot(world, acquisition=whole).volts[..., :still].mean()
    assert moving == pytest.approx(settled, rel=0.01)


def test_wander_is_a_function_of_virtual_time() -> None:
    moving = quiet(laser_wander_hz=1e9, chip_wander_hz=1e9, wander_time_s=10.0)

    def at(seconds: float) -> Array:
        world = bench(parameters=moving)
        world.clock.advance(seconds)
        return shoot(world).volts

    assert np.array_equal(at(3.22), at(3.22))
    assert np.array_equal(at(3.22), at(3.24))  # within one step
    assert 0 < distance(at(3.22), at(3.28)) < 0.5 * distance(at(3.22), at(33.0))


def test_detectors_cannot_exceed_their_limit() -> None:
    assert 0.9 < shoot(bench(parameters=Parameters(detector_gain_v_per_w=1e5))).volts.max() < 1.0 + 1e-6


def test_direct_path_sees_no_mirrors() -> None:
    world = bench(parameters=Parameters(light_path="direct", trigger_jitter_s=0.0, awg_jitter_s=0.0))
    before = shoot(world).volts
    world.show(None)
    world.clock.advance(10e-6)
    assert before.std() > 5e-3
    assert distance(shoot(world).volts, before) < 0.1 * before.std()


def test_mirrors_beside_a_direct_path_are_no_part_of_the_state() -> None:
    direct = Parameters(light_path="direct")
    first, second = (shoot(bench(parameters=direct, image=image, noise="by-state")).volts for image in (0, 1))
    assert np.array_equal(first, second)


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
