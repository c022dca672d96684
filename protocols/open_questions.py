"""What documents leave open about a bench as a whole, measured on it: trigger levels, latencies, settling mirrors."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.interfaces import BurstDmd
from instruments.safe_state import ending_with
from instruments.values import Answer, Drive, Frames, Timebase
from protocols.bursts import PICTURE_PERIOD_S, SETTLING_S, load_pictures, played
from protocols.image_readout import DRIVE_RATE, pseudorandom_drive
from protocols.ranging import find_ranges

SAMPLE_RATE = 25e9
FAR_V = 2.0
"""How far from the level of the station a trigger is looked for, either way."""
LEVEL_STEP_V = 0.02
CLOSE = 0.1
"""A level is safe where so much of the pulse's height lies between it and either end."""

SWITCH_AFTER_S = 4e-6
EARLIER_S = 2e-6
WINDOW_S = 16e-6
BLUR_S = 20e-9
"""Light is averaged over so long: noise goes, what mirrors do in microseconds stays."""
SCENES = 16
AT_REST = 0.05
"""Mirrors rest when the light stays within so much of its change."""
LATE_S = 1e-6
"""A switch that is seen so much beside its time: longer than any cable or electronics, shorter than pulses differ."""


def trigger_levels(bench: Bench, seed: int) -> Iterator[Answer]:
    """Between which levels the oscilloscope is triggered by the drive; in the dark.

    The accuracy of the level of an auxiliary input is in no specification.
    """
    wired = bench.wiring.trigger
    channels = bench.wiring.channels

    def triggers(level_v: float) -> bool:
        bench.scope.configure(Timebase(SAMPLE_RATE, 500), replace(wired, level_v=level_v), channels, 1)
        return bench.scope.triggered()

    with ending_with(bench.make_safe):
        bench.load_drive(pseudorandom_drive(bench, seed))
        bench.play_drive()
        question, assumed = "levels at which the drive's marker triggers the oscilloscope", f"{wired.level_v:g} V"
        if not triggers(wired.level_v):
            yield Answer(question, assumed, "none there: check the marker's cable and scope.trigger_level", agrees=False)
            return
        low = _last(triggers, wired.level_v, wired.level_v - FAR_V)
        high = _last(triggers, wired.level_v, wired.level_v + FAR_V)
    margin = CLOSE * (high - low)
    yield Answer(question, assumed, f"{low:.2f} to {high:.2f} V", low + margin < wired.level_v < high - margin)


@dataclass(frozen=True)
class Switched:
    """Light on one channel while the mirrors turn from away to a picture.

    volts: (samples,), mean over scenes. interval_s: of its samples. commanded_s: when the switch was commanded, by the
    drive's start at the end of the DMD's pulse.
    """

    volts: NDArray[np.float64]
    interval_s: float
    commanded_s: float


def switches(bench: Bench, dmd: BurstDmd, picture: NDArray[np.uint8]) -> Iterator[Switched]:
    """The mirrors turn from away to `picture`, twice: the DMD's pulse ends `EARLIER_S` later the second time.

    The bench emits already, and one channel is patched.
    """
    channel = bench.scope.channels[0] if bench.scope.channels else bench.wiring.channels[0]
    away = np.zeros_like(picture)
    load_pictures(bench, [np.stack([away, picture])], 2)
    rest = Drive("rest", np.zeros(round(1e-6 * DRIVE_RATE), np.float32), DRIVE_RATE, bench.levels.rf_amplitude_vpp)
    bench.load_drive(rest, periods_per_trigger=math.inf)
    bench.configure(Timebase(SAMPLE_RATE, round(WINDOW_S * SAMPLE_RATE)), (channel,))
    for later_s in (0.0, EARLIER_S):
        commanded_s = SWITCH_AFTER_S - later_s
        capture = partial(_switch, bench, dmd, PICTURE_PERIOD_S - commanded_s)
        if not later_s:
            find_ranges(bench.scope, bench.limits, [capture], bench.require_unchanged)
        volts = np.mean([_volts(bench, capture()) for _ in range(SCENES)], axis=0)
        yield Switched(_blurred(volts), BLUR_S, commanded_s)


def switching_answers(first: Switched, second: Switched) -> Iterator[Answer]:
    """What two switches say: which end of the pulse starts the drive, how late the light is, when the mirrors rest."""
    seen = [_half(one) for one in (first, second)]
    moved = seen[0] - seen[1]
    follows = abs(moved - EARLIER_S) < LATE_S
    yield Answer(
        "edge of the DMD's pulse that starts the drive",
        "its end",
        "its end" if follows else "its beginning" if abs(moved) < LATE_S else f"neither: {moved * 1e6:.2f} us between",
        follows,
    )
    late = float(np.mean([time - one.commanded_s for time, one in zip(seen, (first, second), strict=True)]))
    yield Answer(
        "half of the light after the mirrors' command", "0 to 50 us", f"{late * 1e6:.2f} us", 0 <= late <= SETTLING_S
    )
    rest = max(_at_rest(one) - one.commanded_s for one in (first, second))
    yield Answer(
        "mirrors at rest after their command", f"{SETTLING_S * 1e6:g} us", f"{rest * 1e6:.2f} us", rest <= SETTLING_S
    )


def _switch(bench: Bench, dmd: BurstDmd, pulse_s: float) -> Frames:
    dmd.hold()
    bench.stop_drive()
    bench.play_drive()
    return played(bench, 1, partial(dmd.play, 0, 2, PICTURE_PERIOD_S, pulse_s=pulse_s))


def _last(triggers: Callable[[float], bool], there: float, away: float) -> float:
    """The level farthest from `there` on the way `away` that triggers, by halving; `away` if all do."""
    if triggers(away):
        return away
    while abs(away - there) > LEVEL_STEP_V:
        between = (there + away) / 2
        there, away = (between, away) if triggers(between) else (there, between)
    return there


def _volts(bench: Bench, frames: Frames) -> NDArray[np.float64]:
    (scaling,) = bench.scope.scalings()
    volts: NDArray[np.float64] = scaling.scale_v * frames.codes[0, 0] + scaling.offset_v
    return volts


def _blurred(volts: NDArray[np.float64]) -> NDArray[np.float64]:
    width = round(BLUR_S * SAMPLE_RATE)
    means: NDArray[np.float64] = volts[: volts.size // width * width].reshape(-1, width).mean(axis=1)
    return means


def _ends(one: Switched) -> tuple[float, float]:
    """Light long before and long after: means of the first and last eighth."""
    eighth = max(1, one.volts.size // 16)
    return float(one.volts[:eighth].mean()), float(one.volts[-eighth:].mean())


def _half(one: Switched) -> float:
    before, after = _ends(one)
    passed = (one.volts - before) / (after - before) > 1 / 2
    return float(np.argmax(passed)) * one.interval_s


def _at_rest(one: Switched) -> float:
    before, after = _ends(one)
    moving = np.abs((one.volts - after) / (after - before)) > AT_REST
    return float(np.flatnonzero(moving)[-1] + 1) * one.interval_s if moving.any() else 0.0
