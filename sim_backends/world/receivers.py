"""From the light of every picture to the oscilloscope's codes: noise, jitter, the detectors' limit and the digitiser.

Every random number of a trigger comes from the trigger's own key, so that the number of triggers which are computed
together changes no byte.
"""

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics import receiver
from sim_backends.parameters import Parameters
from sim_backends.world.keyed_random import Rekeyed, derived
from sim_backends.world.light_path import IMAGE_BLOCK, Light, LightPath
from sim_backends.world.pictures import Sight
from sim_backends.world.signals import Acquisition
from sim_backends.world.twin import Setting

Device = Literal["cpu", "cuda"]
Codes = NDArray[np.int8] | NDArray[np.int16]

_BLOCK_BYTES = 2_000_000  # of fields computed together, which then stay in the cache

noise_colour = lru_cache(maxsize=16)(receiver.noise_colour)


class CardFull(MemoryError):
    """The graphics card has no room for what is to be computed on it: one line that says what to do."""

    def __init__(self) -> None:
        super().__init__("the graphics card, which sim.device = cpu does without, has no room")


class Drawn(NamedTuple):
    """What chance makes of some triggers.

    white: noise, as the receivers that drew it take it back. lateness: (triggers,) s, by which each trigger is late.
    offsets: (triggers,) s, from the sampling grid.
    """

    white: Any
    lateness: NDArray[np.float64]
    offsets: NDArray[np.float64]


class Alike(NamedTuple):
    """Triggers of one acquisition that see the same light, on whatever patterns of one scene.

    rows: which triggers of the acquisition. lateness: (triggers,) s, of all of them. setting: what the instruments fix.
    """

    rows: NDArray[np.intp]
    lateness: NDArray[np.float64]
    acquisition: Acquisition
    setting: Setting
    light: Light
    sight: Sight


class FrontEnd(NamedTuple):
    """One channel in front of its digitiser: volts a division, volts and divisions from the middle."""

    scale_v: float
    offset_v: float
    position_div: float


class Receivers(Protocol):
    """Detectors and digitisers of one world."""

    def drawn(self, keys: Sequence[bytes], acquisition: Acquisition) -> Drawn:
        """What chance makes of the triggers of these keys."""

    def white(self, keys: Sequence[bytes], acquisition: Acquisition) -> Any:
        """Noise alone, of further points behind triggers."""

    def detect(self, white: Any, alike: Alike, volts: NDArray[np.float32]) -> None:
        """Put into their rows of `volts`, (channels, samples) each, what the detectors put out at such triggers.

        Jitter, how late each is, enters by the trace's slope: first-order Taylor.
        """

    def digitised(
        self,
        keys: Sequence[bytes],
        seen: Sequence[NDArray[np.float32]],
        front_ends: Sequence[FrontEnd],
        noise: float,
        bits: int,
    ) -> Codes:
        """Codes (channels, triggers, samples) of what each channel sees, (triggers, samples) V.

        noise: rms of the digitiser's own (levels).
        """


class ProcessorReceivers:
    """`Receivers` computed where the program runs."""

    def __init__(self, light_path: LightPath, parameters: Parameters) -> None:
        self._light_path = light_path
        self._parameters = parameters
        self._rekeyed = Rekeyed()

    def drawn(self, keys: Sequence[bytes], acquisition: Acquisition) -> Drawn:
        """See `Receivers`; white noise is (triggers, channels and one that they share, samples)."""
        constants = self._parameters
        white = np.empty((len(keys), *self._noise_shape(acquisition)), np.float32)
        lateness, offsets = np.zeros((2, len(keys)))
        for number, (key, noise) in enumerate(zip(keys, white, strict=True)):
            source = self._rekeyed.generator(key)
            source.standard_normal(out=noise, dtype=np.float32)
            lateness[number] = source.standard_normal()
            if not constants.shared_reference:
                offsets[number] = (source.random() - 0.5) / acquisition.sample_rate
        return Drawn(white, lateness * jitter_s(constants), offsets)

    def white(self, keys: Sequence[bytes], acquisition: Acquisition) -> NDArray[np.float32]:
        """See `Receivers`."""
        return self._rekeyed.unit_noise(keys, self._noise_shape(acquisition))

    def detect(self, white: NDArray[np.float32], alike: Alike, volts: NDArray[np.float32]) -> None:
        """See `Receivers`."""
        rows, lateness, acquisition, setting, light, sight = alike
        optics = self._light_path.optics(setting)
        laws, colour = optics.laws, colour_of(self._parameters, acquisition)
        amplitudes = sight.scenes[light.scene].amplitudes
        moving = math.isfinite(light.age_s)
        seen = sight.after[rows] * len(amplitudes) + (sight.before[rows] if moving else 0)
        pairs, which = np.unique(seen, return_inverse=True)
        order = np.argsort(which, kind="stable")
        after, before = np.divmod(pairs, len(amplitudes))
        points = self._light_path.grid(acquisition, light.shift_s).points
        fitting = int(_BLOCK_BYTES / (16 * len(acquisition.channels) * points * IMAGE_BLOCK))
        block = max(1, fitting) * IMAGE_BLOCK
        at_once = max(1, _BLOCK_BYTES // white[0].nbytes)
        seen_by = which[order]

        def part(begin: int) -> None:
            shown = amplitudes[after[begin : begin + block]]
            settled = amplitudes[before[begin : begin + block]] if moving else shown
            clean, slope = self._light_path.sampled(
                optics,
                acquisition,
                shown,
                phase_s=light.phase_s,
                shift_s=light.shift_s,
                before=settled if moving else None,
                moving_since_s=light.age_s,
            )
            signal = np.maximum(clean, 0)
            shared = np.sqrt(laws.quadratic) * signal
            clean = clean + self._light_path.level(optics, settled)
            low, high = np.searchsorted(seen_by, (begin, begin + len(clean)))
            for first in range(low, high, at_once):
                places = order[first : min(first + at_once, high)]
                own, image = rows[places], which[places] - begin
                unit = receiver.coloured(white[own], colour)
                traces = laws.own_noise(signal[image], unit[:, :-1])
                traces += shared[image] * unit[:, -1:]
                traces += clean[image]
                traces += lateness[own, np.newaxis, np.newaxis].astype(np.float32) * slope[image]
                volts[own] = receiver.limited(traces, self._parameters.detector_limit_v)

        parts = range(0, len(pairs), block)
        if fitting and len(parts) > 1:  # long records, side by side, would take the memory of as many
            list(_threads().map(part, parts))
        else:
            for begin in parts:
                part(begin)

    def digitised(
        self,
        keys: Sequence[bytes],
        seen: Sequence[NDArray[np.float32]],
        front_ends: Sequence[FrontEnd],
        noise: float,
        bits: int,
    ) -> Codes:
        """See `Receivers`."""
        samples = seen[0].shape[-1] if seen else 0
        unit = self._rekeyed.unit_noise(derived(keys, "digitiser"), (len(seen), samples))
        unit *= np.float32(noise)
        shape = len(seen), len(keys), samples
        codes: Codes = np.empty(shape, np.int8) if bits == 8 else np.empty(shape, np.int16)
        for channel, (volts, front_end) in enumerate(zip(seen, front_ends, strict=True)):
            codes[channel] = receiver.quantised(volts, unit[:, channel], *front_end, bits)
        return codes

    def _noise_shape(self, acquisition: Acquisition) -> tuple[int, int]:
        colour = colour_of(self._parameters, acquisition)
        return len(acquisition.channels) + 1, acquisition.samples + colour.size - 1


def colour_of(parameters: Parameters, acquisition: Acquisition) -> NDArray[np.float32]:
    """Filter that gives white noise the spectrum of detector and oscilloscope."""
    scope_hz = min(parameters.scope_bandwidth_hz, acquisition.bandwidth_hz)
    return noise_colour(acquisition.sample_rate, detector_hz=parameters.detector_bandwidth_hz, scope_hz=scope_hz)


def jitter_s(parameters: Parameters) -> float:
    """Rms of how late a trigger is (s)."""
    return math.hypot(parameters.trigger_jitter_s, parameters.awg_jitter_s)


@lru_cache(maxsize=1)
def _threads() -> ThreadPoolExecutor:
    """One for each core: NumPy lets others go on while it computes."""
    return ThreadPoolExecutor(os.cpu_count(), thread_name_prefix="physics")
