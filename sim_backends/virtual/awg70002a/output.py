"""What comes out of a channel of the virtual AWG: the playback that its schedule or its function makes."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sim_backends.virtual.awg70002a.channels import Source
from sim_backends.virtual.awg70002a.function_generator import Function
from sim_backends.virtual.awg70002a.player import INTERNAL
from sim_backends.virtual.awg70002a.schedule import Schedule, rendered
from sim_backends.virtual.awg70002a.waveforms import MARKER_1
from sim_backends.world.signals import Playback

Sample = TypeVar("Sample", np.float32, np.bool_)

LONGEST_INTERVAL = 2**18  # samples: internal triggers that are further apart come this often


def played_function(function: Function, source: Source, noise: np.random.Generator) -> Playback:
    """The function generator's output, free-running, its marker low."""
    volts, sample_rate = function.rendered(noise)
    return _playback(volts, np.zeros(volts.size, np.bool_), source, sample_rate)


def played_schedule(found: Schedule, source: Source, sample_rate: float, interval_s: float) -> Playback:
    """A schedule's output; with all 10 bits in use the DAC has none left for the marker."""
    unit, marker = rendered(found, source.dac_bits, MARKER_1 if source.dac_bits < 10 else 0)
    volts = unit * np.float32(source.amplitude_v / 2)
    if found.waits and set(found.waits) != {INTERNAL}:
        return _playback(volts, marker, source, sample_rate, found.lengths(), runs_on=found.runs_on)
    if found.waits and found.runs_on:
        volts, marker = volts[-found.lengths()[-1] :], marker[-found.lengths()[-1] :]
    elif found.waits:
        spacing = max(1, min(LONGEST_INTERVAL, round(interval_s * sample_rate)))
        volts, marker = _spaced(volts, found.lengths(), spacing), _spaced(marker, found.lengths(), spacing)
    return _playback(volts, marker, source, sample_rate)


def _spaced(data: NDArray[Sample], lengths: tuple[int, ...], spacing: int) -> NDArray[Sample]:
    """Segments that begin at multiples of `spacing` samples, the output idle in between."""
    parts = np.split(data, np.cumsum(lengths)[:-1])
    return np.concatenate([np.pad(part, (0, -part.size % spacing)) for part in parts])


def _playback(
    volts: NDArray[np.float32],
    marker: NDArray[np.bool_],
    source: Source,
    sample_rate: float,
    lengths: tuple[int, ...] | None = None,
    *,
    runs_on: bool = False,
) -> Playback:
    out = source.markers[1]
    return Playback(volts, marker, out.low_v, out.high_v, sample_rate, lengths, runs_on, source.skew_s, out.delay_s)
