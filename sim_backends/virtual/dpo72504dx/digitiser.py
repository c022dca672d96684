"""From volts at the inputs to codes: every trigger of a record at once.

The digitiser's noise of a frame comes from that frame's own generator, so that the number of triggers which are
digitised together changes no byte. Effective bits: instrument facts 2.10.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from sim_backends.optics.receiver import CODES_PER_DIVISION, digitiser_noise_codes, gaussian_time_width
from sim_backends.virtual.dpo72504dx.vertical import BANDWIDTH_HZ, Vertical
from sim_backends.world.keyed_random import digest, unit_noise
from sim_backends.world.signals import Acquisition, Record
from sim_backends.world.world import World

LOWEST_CODE, HIGHEST_CODE = -128, 127
SAMPLES_AT_ONCE = 2**22  # of all channels together; bounds the memory, not the result


def digitised(
    world: World, acquisition: Acquisition, times: NDArray[np.float64], verticals: Sequence[Vertical]
) -> Iterator[tuple[NDArray[np.int8], NDArray[np.float64]]]:
    """Codes (channels, triggers, samples) and trigger offsets (triggers,) in s, for as many triggers as fit at once."""
    step = max(1, SAMPLES_AT_ONCE // (len(acquisition.channels) * acquisition.samples))
    setting = b"".join(struct.pack("<3d?", *vertical[:4]) for vertical in verticals)
    for first in range(0, times.size, step):
        yield _recorded(world, acquisition, times[first : first + step], verticals, setting)


def _recorded(
    world: World,
    acquisition: Acquisition,
    times: NDArray[np.float64],
    verticals: Sequence[Vertical],
    setting: bytes,
) -> tuple[NDArray[np.int8], NDArray[np.float64]]:
    """One record of the world; channels that are sampled at different times need one each."""
    deskews = [vertical.deskew_s for vertical in verticals]
    if not any(deskews):
        record = world.record(acquisition, times, setting=setting)
        return _codes(world, acquisition, record, verticals), record.trigger_offset_s
    codes = np.empty((len(verticals), times.size, acquisition.samples), np.int8)
    offsets = np.zeros(times.size)
    for deskew in dict.fromkeys(deskews):
        rows = [row for row, own in enumerate(deskews) if own == deskew]
        channels = tuple(acquisition.channels[row] for row in rows)
        part = replace(acquisition, channels=channels, start_s=acquisition.start_s + deskew)
        record = world.record(part, times, setting=setting)
        codes[rows] = _codes(world, part, record, [verticals[row] for row in rows])
        offsets = record.trigger_offset_s
    return codes, offsets


def _codes(world: World, acquisition: Acquisition, record: Record, verticals: Sequence[Vertical]) -> NDArray[np.int8]:
    """Codes (channels, triggers, samples)."""
    began = perf_counter()
    triggers, channels, samples = record.volts.shape
    noise = unit_noise([digest(key, "digitiser") for key in record.keys], (channels, samples))
    noise *= np.float32(digitiser_noise_codes(world.parameters.enob))
    codes = np.empty((channels, triggers, samples), np.int8)
    for channel, vertical in enumerate(verticals):
        seen = _seen(record.volts[:, channel], vertical, acquisition.sample_rate)
        codes[channel] = quantised(seen, noise[:, channel], vertical)
    world.physics_seconds += perf_counter() - began
    return codes


def quantised(volts: NDArray[np.float32], noise: NDArray[np.float32], vertical: Vertical) -> NDArray[np.int8]:
    """What the 8-bit digitiser of one channel makes of `volts`, any shape, with as much `noise` in codes before it.

    code = round((v - offset) 25 / scale + 25 position + noise), clipped to -128..127: 25 codes a division, 10.24
    divisions (instrument facts 2.3 and 2.7).
    """
    exact = volts - np.float32(vertical.offset_v)
    exact *= np.float32(CODES_PER_DIVISION / vertical.scale_v)
    exact += np.float32(CODES_PER_DIVISION * vertical.position_div)
    exact += noise
    np.rint(exact, out=exact)
    return np.clip(exact, LOWEST_CODE, HIGHEST_CODE, out=exact).astype(np.int8)


def _seen(volts: NDArray[np.float32], vertical: Vertical, sample_rate: float) -> NDArray[np.float32]:
    """What reaches the digitiser of one channel, in volts in front of its attenuator."""
    if vertical.grounded:
        return np.zeros_like(volts)
    if vertical.bandwidth_hz < BANDWIDTH_HZ:  # Gaussian filters in series: their widths add in squares
        width_s = np.sqrt(gaussian_time_width(vertical.bandwidth_hz) ** 2 - gaussian_time_width(BANDWIDTH_HZ) ** 2)
        volts = gaussian_filter1d(volts, width_s * sample_rate, axis=-1, mode="nearest")
    if vertical.attenuation != 1:
        volts = volts * np.float32(vertical.attenuation)
    return -volts if vertical.inverted else volts
