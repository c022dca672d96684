"""Aligning a bench: what a person measures before the first run, in the order in which each step needs the one before.

Dark first, then ranges, then what needs light in the right range. Every piece yields its volts; what they say is for
analysis. The generator may be closed after any piece, and leaves the bench in the safe state however it ends.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.interfaces import BYPASS_PORT
from instruments.safe_state import ending_with
from instruments.values import Drive, Frames, Timebase, Vertical
from protocols.base import Images, Shot, ShotKind
from protocols.image_readout import DRIVE_RATE, pseudorandom_drive
from protocols.light import Capture
from protocols.patterns import Patterns
from protocols.ranging import DIVISIONS, find_ranges

SAMPLE_RATE = 25e9
SAMPLES = 100
"""Of the frames that show range, noise and images: 4 ns."""
DARK_FRAMES = 32
REPEATS = 48
AVERAGES = 32
PROBES = 16
"""Images that ranges are found from, as many as are compared with each other."""

FINE_RATE = 50e9
"""Twice the drive's: at its own every sample meets the same part of a symbol, and their mean is no mean over time."""
HOP = 0.1
"""Of the drive's full scale, each way: so small that what the light does follows the phase in proportion."""
ORDER, COARSE_ORDER = 9, 7
COARSE_HOLD = 3
"""Periods of 20.44 ns and 15.24 ns: together they tell delays of up to 2 us apart."""
BLOCKS = 7
BLOCKS_ON = 6
BLOCK = 4
"""The delay's images: blocks of 4 x 4 of 28 x 28 superpixels, larger than a speckle grain, 6 of 49 of them on."""
DELAY_IMAGES, COARSE_IMAGES = 32, 8
DIRECT_WAVELENGTHS = 4
DIRECT_STEP_NM = 1.0
"""Without a projector other wavelengths take the place of other images: the chip answers each in another way."""

LEVELS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Of the drive's full scale. The drives hop between neighbours, between every other one, and between the ends."""
DEPTH_ORDER = 5
DEPTH_HOLDS = (10, 20)
"""Samples that a phase is held, 0.4 and 0.8 ns: long against modulator and generator, short enough for the fibre."""
DEPTH_IMAGES = 16
ROOM = 1.5
"""Ranges are found from a few images or under one drive; others may be brighter."""


@dataclass(frozen=True)
class Dark:
    """Without light: volts (frames, channels, samples) at the finest range; clipped (channels,)."""

    volts: NDArray[np.float64]
    clipped: NDArray[np.bool_]


@dataclass(frozen=True)
class Ranged:
    """Images in the ranges that were found.

    volts: (2, images, channels, samples), means of `AVERAGES` triggers, taken twice. clipped: (channels,), whether any
    of the images, a single trigger each, reached an end of the range. full_scale_v: (channels,). finest, coarsest:
    (channels,), whether the range is at that end of what the oscilloscope has.
    """

    volts: NDArray[np.float64]
    clipped: NDArray[np.bool_]
    full_scale_v: NDArray[np.float64]
    finest: NDArray[np.bool_]
    coarsest: NDArray[np.bool_]


@dataclass(frozen=True)
class Repeated:
    """One image again and again, a trigger each: volts (frames, channels, samples)."""

    volts: NDArray[np.float64]


@dataclass(frozen=True)
class Answered:
    """What many images, or ports and wavelengths, answer to a pseudorandom drive of two levels and to its opposite.

    upright, inverted: (answers, samples) V, one period; none that was clipped. sequence: (n,) 1 and -1, each held for
    `hold_s`. coarse: the same with another period. scope_hz: bandwidth of the oscilloscope. ports: where it was
    measured.
    """

    upright: NDArray[np.float64]
    inverted: NDArray[np.float64]
    sequence: NDArray[np.float64]
    hold_s: float
    interval_s: float
    scope_hz: float
    ports: tuple[int, ...]
    coarse: "Answered | None" = None


@dataclass(frozen=True)
class Hopped:
    """Mean signals of images under drives that hop between two levels, and under one that rests.

    idle: (traces,) V. hopping: (holds, pairs, traces) V, traces = images and channels. sequence: (n,) 0 and 1. pairs:
    (pairs, 2), places in `levels`. hold_s: (holds,).
    """

    idle: NDArray[np.float64]
    hopping: NDArray[np.float64]
    sequence: NDArray[np.float64]
    pairs: tuple[tuple[int, int], ...]
    levels: tuple[float, ...]
    hold_s: tuple[float, ...]


Piece = Dark | Ranged | Repeated | Answered | Hopped
Pieces = Generator[Piece, None, None]


def align(bench: Bench, images: Images, *, ports: Sequence[int], wavelength_nm: float, seed: int) -> Pieces:
    """Measure `bench` piece by piece: dark, ranges, repeats, delay, depth (the last with a projector only).

    Args:
        bench: What to align.
        images: Shown one after the other, where the light goes by the DMD.
        ports: What the channels are patched to, one each.
        wavelength_nm: What the laser is set to.
        seed: Fixes drive and patterns.
    """
    patching = dict(zip(bench.wiring.channels, ports, strict=False))
    drive = pseudorandom_drive(bench, seed)
    patterns: list[NDArray[np.uint8] | None] = [None]
    if bench.wiring.projector:
        patterns = [*_patterns(bench, images.images[:PROBES])]
    with ending_with(bench.make_safe):
        bench.connect(patching)
        bench.dmd.blank()
        _play(bench, drive)
        _sample(bench, patching, 1)
        finest = bench.scope.vertical_scale.low
        for channel in patching:
            bench.scope.set_vertical(channel, Vertical(finest, 0.0))
        frames = [bench.capture() for _ in range(DARK_FRAMES)]
        volts = np.stack([_volts(bench, frame) for frame in frames])
        yield Dark(volts, np.any([frame.clipped[0] for frame in frames], axis=0))
        with bench.emitting(wavelength_nm):
            yield _ranged(bench, patching, patterns)
            _sample(bench, patching, 1)
            yield Repeated(
                np.stack([_volts(bench, _shown(bench, shown)) for shown in [patterns[0], *[None] * (REPEATS - 1)]])
            )
            if bench.wiring.projector:
                fibre = _before_the_chip(bench, patching)
                bench.connect(fibre)
                mosaics = blocks(bench, seed)
                yield _projected_answers(bench, fibre, mosaics)
                yield hopped(bench, fibre, mosaics[:DEPTH_IMAGES])
            else:
                yield _direct_answers(bench, wavelength_nm)


def _ranged(bench: Bench, patching: dict[int, int], patterns: Sequence[NDArray[np.uint8] | None]) -> Ranged:
    captures = [partial(_shown, bench, pattern) for pattern in patterns]
    scalings = find_ranges(bench, captures)
    clipped = np.any([capture().clipped[0] for capture in captures], axis=0)
    scale = np.array([bench.scope.vertical_for(scaling).scale_v_per_div for scaling in scalings])
    _sample(bench, patching, AVERAGES)
    twice = [[_volts(bench, capture()), _volts(bench, bench.capture())] for capture in captures]
    limits = bench.scope.vertical_scale
    return Ranged(
        np.stack(twice, axis=1), clipped, DIVISIONS * scale, scale <= 1.01 * limits.low, scale >= 0.99 * limits.high
    )


def _before_the_chip(bench: Bench, patching: dict[int, int]) -> dict[int, int]:
    """One channel on the fibre before the chip, where that is wired: it knows the light's way to there alone."""
    channel, port = next(iter(patching.items()))
    return {channel: BYPASS_PORT if BYPASS_PORT in bench.patch_panel.ports else port}


def blocks(bench: Bench, seed: int) -> list[NDArray[np.uint8]]:
    """Patterns that have little in common, so that each meets another speckle."""
    generator = np.random.default_rng((seed, 5))
    on = np.zeros((DELAY_IMAGES, BLOCKS * BLOCKS), np.bool_)
    for row in on:
        row[generator.permutation(row.size)[:BLOCKS_ON]] = True
    images = np.repeat(np.repeat(on.reshape(-1, BLOCKS, BLOCKS), BLOCK, axis=1), BLOCK, axis=2)
    return _patterns(bench, images)


def _projected_answers(bench: Bench, patching: dict[int, int], patterns: Sequence[NDArray[np.uint8]]) -> Answered:
    coarse = _answers(bench, patching, patterns[:COARSE_IMAGES], COARSE_ORDER, COARSE_HOLD, None)
    return _answers(bench, patching, patterns, ORDER, 1, coarse)


def _direct_answers(bench: Bench, wavelength_nm: float) -> Answered:
    """Of all ports at several wavelengths: the chip answers each in its own way."""
    ports = tuple(port for port in bench.patch_panel.ports if port != BYPASS_PORT)
    found: list[Answered] = []
    coarse: Answered | None = None
    for step in range(DIRECT_WAVELENGTHS):
        bench.tune(wavelength_nm + DIRECT_STEP_NM * step)
        for patching in bench.patchings_for(ports):
            bench.connect(patching)
            if coarse is None:
                coarse = _answers(bench, patching, (None,), COARSE_ORDER, COARSE_HOLD, None)
            found.append(_answers(bench, patching, (None,), ORDER, 1, None))
    bench.tune(wavelength_nm)
    one = found[0]
    return Answered(
        np.concatenate([each.upright for each in found]),
        np.concatenate([each.inverted for each in found]),
        one.sequence,
        one.hold_s,
        one.interval_s,
        one.scope_hz,
        ports,
        coarse,
    )


def _answers(
    bench: Bench,
    patching: dict[int, int],
    patterns: Sequence[NDArray[np.uint8] | None],
    order: int,
    hold: int,
    coarse: Answered | None,
) -> Answered:
    sequence = maximum_length_sequence(order)
    samples = round(sequence.size * hold * FINE_RATE / DRIVE_RATE)
    captures = [partial(_shown, bench, pattern) for pattern in patterns]
    both: list[NDArray[np.float64]] = []
    clipped = np.zeros(len(patterns) * len(patching), np.bool_)
    for sign in (1.0, -1.0):
        _play(bench, _held(bench, sign * HOP * sequence, hold))
        bench.configure(Timebase(FINE_RATE, samples), patching, AVERAGES)
        if not both:
            _find_wide_ranges(bench, patching, captures[:COARSE_IMAGES])
        frames = [capture() for capture in captures]
        clipped |= np.concatenate([frame.clipped[0] for frame in frames])
        both.append(np.concatenate([_volts(bench, frame) for frame in frames]))
    settings = bench.scope.settings()
    bandwidths = [float(settings[name]) for name in settings if name.endswith("bandwidth_hz")]
    upright, inverted = (volts[~clipped] for volts in both)
    return Answered(
        upright,
        inverted,
        sequence=sequence,
        hold_s=hold / DRIVE_RATE,
        interval_s=1 / FINE_RATE,
        scope_hz=min(bandwidths, default=np.inf),
        ports=tuple(patching.values()),
        coarse=coarse,
    )


def hopped(bench: Bench, patching: dict[int, int], patterns: Sequence[NDArray[np.uint8] | None]) -> Hopped:
    """Mean signals of `patterns` on the channels of `patching` under drives that hop, and under one that rests."""
    places = range(len(LEVELS))
    pairs = (*pairwise(places), *zip(places, places[2:], strict=False), (places[0], places[-1]))
    sequence = (maximum_length_sequence(DEPTH_ORDER) + 1) / 2
    captures = [partial(_shown, bench, pattern) for pattern in patterns]

    def play(low: int, high: int, hold: int) -> None:
        _play(bench, _held(bench, LEVELS[low] + (LEVELS[high] - LEVELS[low]) * sequence, hold))
        samples = round(sequence.size * hold * FINE_RATE / DRIVE_RATE)
        bench.configure(Timebase(FINE_RATE, samples), patching, AVERAGES)

    def means() -> NDArray[np.float64]:
        return np.concatenate([_volts(bench, capture()).mean(axis=1) for capture in captures])

    play(places[len(LEVELS) // 2], places[-1], DEPTH_HOLDS[0])
    _find_wide_ranges(bench, patching, captures)
    play(places[len(LEVELS) // 2], places[len(LEVELS) // 2], DEPTH_HOLDS[0])
    idle = means()
    hopping = []
    for hold in DEPTH_HOLDS:
        for low, high in pairs:
            play(low, high, hold)
            hopping.append(means())
    holds = tuple(hold / DRIVE_RATE for hold in DEPTH_HOLDS)
    return Hopped(idle, np.reshape(hopping, (len(holds), len(pairs), -1)), sequence, pairs, LEVELS, holds)


def _find_wide_ranges(bench: Bench, patching: dict[int, int], captures: Sequence[Capture]) -> None:
    """Ranges for more light than there is in `captures`, from other images or another drive."""
    for channel, scaling in zip(patching, find_ranges(bench, captures), strict=True):
        found = bench.scope.vertical_for(scaling)
        scale = min(ROOM * found.scale_v_per_div, bench.scope.vertical_scale.high)
        bench.scope.set_vertical(channel, Vertical(scale, found.offset_v))


def _patterns(bench: Bench, images: NDArray[np.bool_]) -> list[NDArray[np.uint8]]:
    """The mirror bits of images (n, height, width)."""
    numbers = np.arange(len(images))
    patterns = Patterns(Images(images, numbers, numbers), bench.dmd.shape)
    return [patterns[Shot(number, ShotKind.IMAGE, number, number, number)] for number in numbers.tolist()]


def _held(bench: Bench, values: NDArray[np.float64], hold: int) -> Drive:
    """A drive of `values` in -1..1, each for `hold` samples."""
    return Drive("alignment", np.repeat(values, hold).astype(np.float32), DRIVE_RATE, bench.levels.rf_amplitude_vpp)


def _play(bench: Bench, drive: Drive) -> None:
    bench.load_drive(drive)
    bench.play_drive()


def _sample(bench: Bench, patching: dict[int, int], averages: int) -> None:
    bench.configure(Timebase(SAMPLE_RATE, SAMPLES), patching, averages)


def _shown(bench: Bench, mirrors: NDArray[np.uint8] | None) -> Frames:
    """One frame of a pattern; None: of what is there."""
    if mirrors is not None:
        bench.show(mirrors)
    return bench.capture()


def _volts(bench: Bench, frames: Frames) -> NDArray[np.float64]:
    """The frame of one trigger in V, (channels, samples)."""
    scale, offset = (
        np.array([getattr(scaling, name) for scaling in bench.scope.scalings()])[:, np.newaxis]
        for name in ("scale_v", "offset_v")
    )
    volts: NDArray[np.float64] = scale * frames.codes[0] + offset
    return volts


def maximum_length_sequence(order: int) -> NDArray[np.float64]:
    """2^order - 1 values 1 and -1 whose circular correlation with themselves is -1 but at 0 (Golomb, 1967)."""
    taps = {5: (5, 3), 7: (7, 6), 9: (9, 5)}[order]
    bits = [1] * order
    sequence = []
    for _ in range(2**order - 1):
        sequence.append(2.0 * bits[-1] - 1.0)
        bits = [sum(bits[tap - 1] for tap in taps) % 2, *bits[:-1]]
    return np.array(sequence)
