"""A world with light in it, and what the tests of the world ask of it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backends.parameters import Parameters
from sim_backends.world.signals import AUX, Acquisition, Emission, Playback, Record, TriggerCondition
from sim_backends.world.world import Noise, World

Array = NDArray[np.float32]
RATE = 25e9
LIGHT = Emission(1550.0, 0.03)
MARKER = TriggerCondition(AUX, 0.5, rising=True)
FOUR = Acquisition((1, 2, 3, 4), RATE, 64, 0.0)


def pack(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    bits = np.zeros((768, 1024), np.uint8)
    bits[6:762, 134:890] = np.kron(image.reshape(28, 28), np.ones((27, 27), np.uint8))
    return np.packbits(bits, axis=1)


def picture(seed: int, fill: float = 0.45) -> NDArray[np.uint8]:
    return pack((np.random.default_rng(seed).random(784) < fill).astype(np.uint8))


def playback(seed: int = 0, samples: int = 500) -> Playback:
    volts = np.random.default_rng(seed).uniform(-0.25, 0.25, samples).astype(np.float32)
    return Playback(volts, np.arange(samples) < samples // 2, 0.0, 1.0, RATE)


def bench(
    seed: int = 1,
    parameters: Parameters | None = None,
    image: int = 0,
    patching: dict[int, int] | None = None,
    noise: Noise = "by-trigger",
) -> World:
    world = World(parameters, twin_seed=seed, noise=noise)
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


def quiet(*, detector_gain_v_per_w: float = 6e-4, **changes: Any) -> Parameters:
    """Enough light for shot noise not to matter, no other noise."""
    return Parameters(
        amplifier_gain_db=0.0,
        booster_gain_db=98.0,
        detector_gain_v_per_w=detector_gain_v_per_w,
        detector_nep_w_per_rthz=0.0,
        laser_rin_db_per_hz=-300.0,
        trigger_jitter_s=0.0,
        awg_jitter_s=0.0,
        **changes,
    )


def distance(first: Array, second: Array) -> float:
    return float(np.sqrt(np.mean((first - second) ** 2)))
