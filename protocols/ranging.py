"""Finding the vertical ranges of the oscilloscope from probe shots."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.interfaces import Oscilloscope
from instruments.limits import Limits
from instruments.readback import confirm
from instruments.values import Frames, Scaling, Vertical
from protocols.light import Capture, require_light, while_lit

DIVISIONS = 10
HEADROOM = 1.3
"""Speckle intensities are exponentially distributed: the largest of a thousand images exceeds that of a few dozen
by about this factor (ratio of the logarithms of the numbers of samples)."""
ROOM_FOR_BRIGHTER = 6.0
"""How many times brighter than the first probe the others may be before the search widens."""
STEPS = 8
SAME_SCALE = 1e-3
"""A quarter of a code at the ends of the range: by so much a scale that is set again may differ."""


def find_ranges(bench: Bench, probes: Sequence[Capture]) -> tuple[Scaling, ...]:
    """Set each channel so that the traces of all `probes` fill its screen with some headroom.

    Starts at the coarsest range and narrows it on the first probe, since a trace of a few codes says little about its
    own height; then takes the extremes over all probes, widening where one is clipped.

    Returns:
        What a code of each channel now means.

    Raises:
        OverLimit: a detector gives more than it may.
        SettingChanged: somebody else has changed a setting.
    """
    return _search(bench, [while_lit(bench, probe) for probe in probes])[0]


def _search(bench: Bench, probes: Sequence[Capture]) -> tuple[tuple[Scaling, ...], Frames, Frames]:
    """The ranges found, and two frames of the first probe: in the range before, and in this one."""
    scope, limits = bench.scope, bench.limits
    verticals = [Vertical(scope.vertical_scale.high, 0.0)] * len(scope.channels)
    for _ in range(STEPS):
        verticals = _apply(scope, verticals)
        narrowed = [_fit(scope, *ends, room=ROOM_FOR_BRIGHTER) for ends in _extremes(scope, [probes[0]()])]
        bench.require_unchanged()
        scales = zip(narrowed, verticals, strict=True)
        settled = all(new.scale_v_per_div > old.scale_v_per_div / 2 for new, old in scales)
        verticals = narrowed
        if settled:
            break
    for _ in range(STEPS):
        verticals = _apply(scope, verticals)
        frames = [probe() for probe in probes]
        ends = _extremes(scope, frames)
        bench.require_unchanged()
        clipped = np.isnan(ends[:, 0])
        if not clipped.any():
            break
        verticals = [
            Vertical(min(2 * old.scale_v_per_div, scope.vertical_scale.high), old.offset_v) if wider else old
            for old, wider in zip(verticals, clipped, strict=True)
        ]
    widest = scope.vertical_scale.high * DIVISIONS / 2
    ends = np.where(np.isnan(ends), [-widest, widest], ends)
    for channel, pair in zip(scope.channels, ends, strict=True):
        limits.check_detector(channel, float(max(pair, key=abs)))
    _apply(scope, [_fit(scope, *pair, room=HEADROOM) for pair in ends])
    again = probes[0]()
    return scope.scalings(), frames[0], again


def lock_ranges(
    bench: Bench, known: Sequence[Scaling] | None, probes: Sequence[Capture], dark: Capture | None = None
) -> tuple[Scaling, ...]:
    """The vertical ranges of a pass: those `known` from an earlier part of the run, or found from all `probes`.

    `dark` takes a frame of dark mirrors, where there are any: light is found more surely with one.

    Raises:
        OverLimit: a detector gives more than it may.
        InstrumentError: the oscilloscope does not come back to a range it had, or no light reaches it.
    """
    if known is None:
        probes = [while_lit(bench, probe) for probe in probes]
        scalings, first, again = _search(bench, probes)
        require_light(bench, probes, first, again, dark)
        return scalings
    set_ranges(bench.scope, bench.limits, known, probes[0])
    return tuple(known)


def set_ranges(scope: Oscilloscope, limits: Limits, scalings: Sequence[Scaling], probe: Capture) -> None:
    """Set each channel to the range in which its codes mean what `scalings` say, and see on a probe that they do.

    Raises:
        OverLimit: a detector gives more than it may.
        InstrumentError: the oscilloscope does not come back to a range it had.
    """
    _apply(scope, [scope.vertical_for(scaling) for scaling in scalings])
    frames = probe()
    limits.check_traces(scope.channels, frames.codes, scalings)
    for channel, wanted, found in zip(scope.channels, scalings, scope.scalings(), strict=True):
        confirm(
            f"scope: CH{channel} volts per code", wanted.scale_v, found.scale_v, SAME_SCALE * wanted.scale_v, unit="V"
        )
        confirm(f"scope: CH{channel} offset", wanted.offset_v, found.offset_v, wanted.scale_v / 4, unit="V")


def _extremes(scope: Oscilloscope, frames: Sequence[Frames]) -> NDArray[np.float64]:
    """Lowest and highest voltage of each channel over all frames, shape (channels, 2); NaN where one is clipped."""
    scalings = scope.scalings()
    codes = np.concatenate([frame.codes for frame in frames])
    ends = np.stack([codes.min(axis=(0, 2)), codes.max(axis=(0, 2))], axis=1)
    volts = np.array([scaling.scale_v * pair + scaling.offset_v for scaling, pair in zip(scalings, ends, strict=True)])
    if len(frames) > 1:
        volts[np.any([frame.clipped[0] for frame in frames], axis=0)] = np.nan
    return volts


def _fit(scope: Oscilloscope, low: float, high: float, *, room: float) -> Vertical:
    limits = scope.vertical_scale
    scale = float(np.clip((high - low) * room / DIVISIONS, limits.low, limits.high))
    return Vertical(scale, float(low + high) / 2)


def _apply(scope: Oscilloscope, verticals: Sequence[Vertical]) -> list[Vertical]:
    """Set the range of each channel and return those it settled on."""
    return [scope.set_vertical(channel, vertical) for channel, vertical in zip(scope.channels, verticals, strict=True)]
