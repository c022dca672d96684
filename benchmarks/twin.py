"""How fast the twin is by itself: bursts against the DMD's rate, on all cores by the clock, and single shots on one.

    python -m benchmarks twin

Four channels, one thread of BLAS, pictures a quarter on. Neither instruments nor sockets take part. A burst is bounded
by the product of its pictures with the masks of its samples, which the twin itself never makes; both are compared in
processor time.
"""

import math
import sys
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.rows import Goal, Row, Timing, interleaved
from protocols.base import Images, Shot, ShotKind
from protocols.patterns import Patterns
from sim_backends.optics.mirrors import COLUMNS, MIRRORS_PER_SUPERPIXEL, ROWS, SIDE, on_counts
from sim_backends.optics.receiver import digitiser_noise_codes
from sim_backends.parameters import Parameters
from sim_backends.world.receivers import Codes, Device, FrontEnd
from sim_backends.world.signals import AUX, Acquisition, Emission, Playback, Projection, Record, TriggerCondition
from sim_backends.world.world import CHANNELS, World

RATE, PERIOD, PICTURE_S = 25e9, 2500, 44e-6
PICTURES, SHOTS = 2000, 20
CARD_PICTURES = 8000
UPLOADED = 250
FRONT_END = FrontEnd(0.05, 0.0, -3.0)


def pictures(count: int) -> NDArray[np.uint16]:
    """Mirrors on in every superpixel, (count, 784)."""
    on = np.random.default_rng(1).random((count, SIDE**2)) < 0.25
    return (on * MIRRORS_PER_SUPERPIXEL**2).astype(np.uint16)


def lit_world(*, triggered: bool, device: Device = "cpu") -> World:
    """A twin with light, four ports, and a drive of 100 ns: by frame synch pulses, or for ever."""
    volts = np.random.default_rng(2).uniform(-0.25, 0.25, PERIOD).astype(np.float32)
    periods = 3 if triggered else 1
    marker = np.arange(periods * PERIOD) < PERIOD // 2
    world = World(Parameters(), device=device)
    world.emit(Emission(1550.0, 0.03))
    world.patch({channel: channel + 1 for channel in CHANNELS})
    lengths = (periods * PERIOD,) if triggered else None
    world.play(Playback(np.tile(volts, periods), marker, 0.0, 1.0, RATE, lengths))
    return world


def recorded(world: World, shown: NDArray[np.uint16], samples: int, *, triggers: int, start_s: float) -> Record:
    """Project pictures and record so many triggers."""
    world.project(Projection(shown, world.clock.now, PICTURE_S, synch_delay_s=2e-6))
    if triggers != len(shown):
        world.clock.advance(PICTURE_S)
    times = world.next_triggers(TriggerCondition(AUX, 0.5, rising=True), triggers, 2e-6)
    if times is None:
        raise RuntimeError("the twin gave no trigger")
    record = world.record(Acquisition(CHANNELS, RATE, samples, start_s), times)
    world.clock.advance(len(shown) * PICTURE_S + 1e-3)
    return record


def digitised(world: World, record: Record) -> Codes:
    """Codes, as the oscilloscope makes them."""
    seen = list(record.volts.swapaxes(0, 1))
    return world.receivers.digitised(
        record.keys, seen, [FRONT_END] * len(seen), digitiser_noise_codes(world.parameters.enob), 8
    )


def points_of(samples: int) -> int:
    """How many intensities a record of so many samples is made of, without what its filters reach beyond it."""
    return samples * math.ceil(1 / (RATE * Parameters().record_step_s))


def masks_product(samples: int) -> Callable[[], object]:
    """As many pictures times masks of as many samples: points every `record_step_s`, real and imaginary parts."""
    shown = pictures(PICTURES).astype(np.float32)
    masks = np.random.default_rng(3).random((SIDE**2, 2 * len(CHANNELS) * points_of(samples)), np.float32)
    out = np.empty((PICTURES, masks.shape[1]), np.float32)
    return partial(np.matmul, shown, masks, out=out)


def burst_rows(samples: int) -> list[Row]:
    """One length of a burst's frames: all of it, then by step."""
    world, shown = lit_world(triggered=True), pictures(PICTURES)
    play = partial(recorded, world, shown, samples, triggers=PICTURES, start_s=2 * PERIOD / RATE)
    project = partial(world.project, Projection(shown, 0.0, PICTURE_S))
    record = play()
    light, showing, codes, bound = interleaved(play, project, partial(digitised, world, record), masks_product(samples))

    def each(seconds: float) -> float:
        return 1e6 * seconds / PICTURES

    def less(one: Timing, other: Timing) -> Timing:
        return Timing(one.wall_s - other.wall_s, one.processor_s - other.processor_s)

    wall, processor = each(light.wall_s + codes.wall_s), each(light.processor_s + codes.processor_s)
    bounded, what = each(bound.processor_s), f"burst of {samples} samples"
    steps = ("World.project", showing), ("World.record", less(light, showing)), ("digitising", codes)
    return [
        Row(f"{what}: a picture", wall, "us", processor, "the DMD's rate", 1e6 * PICTURE_S, Goal(most=1.0)),
        Row(f"{what}: product of pictures and masks", bounded, "us", bounded, "the twin", processor, Goal(least=0.5)),
        *(Row(f"{what}: {step}", each(of.wall_s), "us", each(of.processor_s)) for step, of in steps),
    ]


def mirrors_rows() -> list[Row]:
    """Mirrors of uploaded pictures counted: where pixels are superpixels, and of any others, beside reading them."""
    numbers = np.arange(UPLOADED)
    images = Images(pictures(UPLOADED).reshape(-1, SIDE, SIDE) > 0, numbers, numbers)
    shots = [Shot(number, ShotKind.IMAGE, number, 0, number) for number in range(UPLOADED)]
    superpixels = Patterns(images, (ROWS, COLUMNS)).block(shots)
    others = np.random.default_rng(4).integers(0, 256, superpixels.shape, np.uint8)
    counted, any_counted, read = (
        1e6 * one.wall_s / UPLOADED
        for one in interleaved(
            partial(on_counts, superpixels), partial(on_counts, others), superpixels.view(np.uint64).max
        )
    )
    return [
        Row("mirrors of a picture of superpixels counted", counted, "us", None, "its bytes read once", read),
        Row("mirrors of any picture counted", any_counted, "us", None, "its bytes read once", read),
    ]


def shot_rows(triggers: int, samples: int) -> list[Row]:
    """One software-timed shot of so many triggers."""
    world, shown = lit_world(triggered=False), pictures(SHOTS)

    def shoot() -> None:
        for shot in range(SHOTS):
            digitised(world, recorded(world, shown[shot : shot + 1], samples, triggers=triggers, start_s=0.0))

    (whole,) = interleaved(shoot)
    return [Row(f"shot of {samples} samples, {triggers} triggers", 1e6 * whole.processor_s / SHOTS, "us")]


def card_rows(samples: int) -> list[Row]:
    """A burst on a graphics card, beside the processor and beside the card's memory; none where there is no card."""
    card, core = lit_world(triggered=True, device="cuda"), lit_world(triggered=True)
    if card.fallback:
        return []
    import torch

    light = torch.empty(CARD_PICTURES * len(CHANNELS) * points_of(samples), dtype=torch.complex64, device="cuda")

    def burst(world: World, shown: NDArray[np.uint16]) -> Codes:
        record = recorded(world, shown, samples, triggers=len(shown), start_s=2 * PERIOD / RATE)
        return digitised(world, record)

    def copied() -> None:
        light.clone()
        torch.cuda.synchronize()

    shown = pictures(CARD_PICTURES)
    show = partial(card.project, Projection(shown, 0.0, PICTURE_S))
    on_card, showing, on_core, bound = interleaved(
        partial(burst, card, shown), show, partial(burst, core, shown[:PICTURES]), copied
    )
    each, on_cores = 1e6 * on_card.wall_s / CARD_PICTURES, 1e6 * on_core.wall_s / PICTURES
    what = f"burst of {samples} samples on a graphics card"
    return [
        Row(f"{what}: a picture", each, "us", None, "all cores", on_cores),
        Row(
            f"{what}: its light, written and read once",
            1e6 * bound.wall_s / CARD_PICTURES,
            "us",
            None,
            "the card",
            each,
        ),
        Row(f"{what}: World.project", 1e6 * showing.wall_s / CARD_PICTURES, "us"),
    ]


def rows() -> list[Row]:
    """All of it."""
    with threadpool_limits(1):
        bursts = [row for samples in (20, 50, 200) for row in burst_rows(samples)]
        shots = [row for triggers, samples in ((1, 50), (16, 50), (1, 500)) for row in shot_rows(triggers, samples)]
    return bursts + mirrors_rows() + shots + [row for samples in (20, 50, 200) for row in card_rows(samples)]


def main() -> None:
    """Measure and print."""
    for row in rows():
        reference = "" if row.reference is None else f"{row.against} {row.reference:.3g}, ratio {row.ratio:.2g}"
        sys.stdout.write(f"{row.what:60}{row.figure:9.3g} {row.unit}  {reference}\n")


if __name__ == "__main__":
    main()
