"""What documents leave open about a bench as a whole, measured on it: trigger levels, latencies, settling mirrors."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.errors import InstrumentError
from instruments.interfaces import BurstDmd
from instruments.safe_state import ending_with
from instruments.values import Answer, Drive, Frames, Timebase
from protocols.bursts import load_pictures, played
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
STEP_S = 0.25e-6
"""Light is looked at so often from the drive's start on, over the window, each time for 200 ns."""
LOOK = 5000
REST = 1000
"""Samples of a drive that rests."""
AT_REST = 0.05
"""Mirrors rest when the light stays within so much of its change."""
VISIBLE = 5.0
"""Times the scatter of settled light that it must have changed by."""
LATE_S = 1e-6
"""By so much two switches may be seen apart otherwise than commanded: half of what the pulses differ by."""


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
            yield Answer(
                question, assumed, "none there: check the marker's cable and scope.trigger_level", agrees=False
            )
            return
        low = _last(triggers, wired.level_v, wired.level_v - FAR_V)
        high = _last(triggers, wired.level_v, wired.level_v + FAR_V)
    margin = CLOSE * (high - low)
    yield Answer(question, assumed, f"{low:.2f} to {high:.2f} V", low + margin < wired.level_v < high - margin)


@dataclass(frozen=True)
class Switched:
    """Light on one channel while the mirrors turn from away to a picture.

    volts: (looks,), a look every `STEP_S` from the drive's start on. commanded_s: when the switch was commanded, if the
    drive starts at the end of the DMD's pulse.
    """

    volts: NDArray[np.float64]
    commanded_s: float


def switches(bench: Bench, dmd: BurstDmd, channel: int, picture: NDArray[np.uint8]) -> Iterator[Switched]:
    """The mirrors turn from away to `picture`, twice: the DMD's pulse ends `EARLIER_S` later the second time.

    The bench emits already, and the channel is patched.
    """
    load_pictures(bench, [np.stack([np.zeros_like(picture), picture])], 2)
    rest = Drive("rest", np.zeros(REST, np.float32), DRIVE_RATE, bench.levels.rf_amplitude_vpp)
    bench.load_drive(rest, periods_per_trigger=math.inf)
    looks = np.arange(0, WINDOW_S, STEP_S)

    def look(after_s: float) -> Frames:
        bench.configure(Timebase(SAMPLE_RATE, LOOK, after_s), (channel,))
        return _switch(bench, dmd, commanded_s)

    commanded_s = SWITCH_AFTER_S
    find_ranges(bench, [partial(look, looks[-1])])
    for commanded_s in (SWITCH_AFTER_S, SWITCH_AFTER_S - EARLIER_S):
        yield Switched(np.array([_volts(bench, look(after_s)).mean() for after_s in looks]), commanded_s)


def switching_answers(settling_s: float, first: Switched, second: Switched) -> Iterator[Answer]:
    """What two switches say: which end of the pulse starts the drive, how late the light is, when the mirrors rest.

    settling_s: how long `Dmd.show` takes them to need.

    Raises:
        InstrumentError: the light did not change.
    """
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
        "half of the light after the mirrors' command",
        f"0 to {settling_s * 1e6:g} us",
        f"{late * 1e6:.2f} us",
        0 <= late <= settling_s,
    )
    rest = max(_at_rest(one) - one.commanded_s for one in (first, second))
    yield Answer(
        "mirrors at rest after their command", f"{settling_s * 1e6:g} us", f"{rest * 1e6:.2f} us", rest <= settling_s
    )


def _switch(bench: Bench, dmd: BurstDmd, commanded_s: float) -> Frames:
    period_s = dmd.picture_period_s
    dmd.hold()
    bench.stop_drive()
    bench.play_drive()
    return played(bench, 1, partial(dmd.play, 0, 2, period_s, pulse_s=period_s - commanded_s))


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


def _part(one: Switched) -> NDArray[np.float64]:
    """How much of its change the light has behind it: 0 at the first look, 1 at the last ones."""
    before, settled = one.volts[0], one.volts[-len(one.volts) // 8 :]
    change = settled.mean() - before
    if not abs(change) > VISIBLE * settled.std():
        raise InstrumentError(
            "bench: the light does not change when the mirrors turn: check laser, fibres and DMD, then ask again"
        )
    part: NDArray[np.float64] = (one.volts - before) / change
    return part


def _half(one: Switched) -> float:
    """When the light passed the middle, by interpolation between two looks."""
    part = _part(one)
    place = int(np.argmax(part > 1 / 2))
    low, high = part[place - 1], part[place]
    return float(place - 1 + (1 / 2 - low) / (high - low)) * STEP_S


def _at_rest(one: Switched) -> float:
    """The first look from which on the light stays where it ends."""
    return float(np.flatnonzero(np.abs(_part(one) - 1) > AT_REST)[-1] + 1) * STEP_S
