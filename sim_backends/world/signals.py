"""What travels between the instruments and the world: light, waveforms, patterns, trigger conditions, records."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim_backends.world.keyed_random import Purpose, digest

AUX = 0
BYPASS = 0


class OutOfMemory(MemoryError):
    """What the simulation has no memory for, such as the light of a very long record: one line that says so."""


@dataclass(frozen=True)
class Emission:
    """What the laser puts out: wavelength (nm) and power (W); power 0 is dark."""

    wavelength_nm: float
    power_w: float


@dataclass(frozen=True)
class Playback:
    """What the generator's channel 1 is putting out.

    volts: (n,) DAC volts into 50 ohm in front of the output stage, scaled, quantised and clipped.
    marker: (n,) marker 1, between `marker_low_v` and `marker_high_v`. sample_rate: S/s.
    lengths: None: one period, repeated for ever from t = 0 of the virtual clock. Otherwise `volts` and `marker` are cut
        into segments of these lengths; each edge at the trigger input starts the next one, cyclically, and is ignored
        while one plays; in between the output idles at 0 V with the marker low.
    runs_on: the last segment, once reached, repeats for ever.
    skew_s: how much later than its place in the period or the segment each of `volts` comes out; negative: sooner.
    marker_delay_s: how much later than its place the marker comes out.
    digest: names the playback; those that say the same are the same.

    Raises:
        ValueError: `volts` and `marker` are not equally long, or `lengths` do not add up to them.
    """

    volts: NDArray[np.float32] = field(compare=False)
    marker: NDArray[np.bool_] = field(compare=False)
    marker_low_v: float
    marker_high_v: float
    sample_rate: float
    lengths: tuple[int, ...] | None = None
    runs_on: bool = False
    skew_s: float = 0.0
    marker_delay_s: float = 0.0
    digest: bytes = field(init=False)

    def __post_init__(self) -> None:
        if self.volts.ndim != 1 or self.volts.size == 0 or self.marker.shape != self.volts.shape:
            raise ValueError(
                f"playback: volts {self.volts.shape}, marker {self.marker.shape}: give two equally long periods"
            )
        if self.lengths is not None and (sum(self.lengths) != self.volts.size or min(self.lengths) < 1):
            raise ValueError(
                f"playback: segments {self.lengths} of {self.volts.size} samples: they must add up to them"
            )
        if self.lengths is None and self.runs_on:
            raise ValueError("playback: only a triggered playback runs on: give lengths")
        object.__setattr__(self, "digest", self._named())

    @property
    def period(self) -> float:
        """Period (s); of a triggered playback the duration of all segments together."""
        return float(self.volts.size / self.sample_rate)

    def segment(self, number: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Volts and marker of segment `number`, from 0; all of them when there are no segments."""
        if self.lengths is None:
            return self.volts, self.marker
        begin = sum(self.lengths[:number])
        part = slice(begin, begin + self.lengths[number])
        return self.volts[part], self.marker[part]

    def _named(self) -> bytes:
        triggered: tuple[Purpose, ...] = () if self.lengths is None else ("triggered", *self.lengths, self.runs_on)
        late = (self.skew_s, self.marker_delay_s) if self.skew_s or self.marker_delay_s else ()
        return digest(
            self.volts.astype("<f4").tobytes(),
            np.packbits(self.marker).tobytes(),
            float(self.marker_low_v),
            float(self.marker_high_v),
            float(self.sample_rate),
            *triggered,
            *late,
        )


@dataclass(frozen=True, eq=False)
class Projection:
    """Pictures that the DMD shows one after another.

    counts: (n, 784) mirrors turned to the collecting fibre in every superpixel, as `mirrors.on_counts` has them: all
        that matters of a picture to the light, in a sixtieth of its memory.
    start_s: virtual time at which the first one is latched; the others follow every `picture_time_s`.
    synch_delay_s: from the latch to the frame synch pulse that goes to the generator's trigger input A.
    loop: from the beginning again after the last one, for ever; otherwise the last one stays.
    triggered: slave mode; each edge at the DMD's trigger input latches the next one, the first one included, but none
        sooner than `picture_time_s` after the one before. The generator's marker 1 supplies the edges, one a segment.
    synch_pulse_s: width of the frame synch pulse; 0: there is none. synch_high: whether it goes from 0 up to 3.3 V or
        down.
    repeats: how often a finite projection shows all its patterns. left_out: so many of the last repetition are not.
    trigger_delay_s: from an edge at the trigger input to the latch.
    lit_s: how long each picture is shown before every mirror turns away until the next one; infinite: all the time.
    """

    counts: NDArray[np.uint16]
    start_s: float
    picture_time_s: float
    synch_delay_s: float = 0.0
    loop: bool = False
    triggered: bool = False
    synch_pulse_s: float = 10e-6
    synch_high: bool = True
    repeats: int = 1
    left_out: int = 0
    trigger_delay_s: float = 0.0
    lit_s: float = math.inf


@dataclass(frozen=True)
class TriggerCondition:
    """An edge on `source` (`AUX` or a channel 1..4) through `level_v`."""

    source: int
    level_v: float
    rising: bool


@dataclass(frozen=True)
class Acquisition:
    """What the oscilloscope samples after each trigger; `start_s` is the first sample's time from the trigger.

    bandwidth_hz: what its inputs are limited to; infinite: to nothing, they have their full bandwidth.
    """

    channels: tuple[int, ...]
    sample_rate: float
    samples: int
    start_s: float
    bandwidth_hz: float = math.inf

    @cached_property
    def digest(self) -> bytes:
        """Names the acquisition."""
        limited = (self.bandwidth_hz,) if math.isfinite(self.bandwidth_hz) else ()
        return digest(*self.channels, "at", float(self.sample_rate), self.samples, float(self.start_s), *limited)


@dataclass(frozen=True, eq=False)
class Record:
    """Volts at the oscilloscope's inputs, (triggers, channels, samples) float32: detector and receiver noise included.

    trigger_offset_s: (triggers,) how much later than `start_s` after its trigger the first sample was really taken.
    keys: one noise key a trigger. further: volts of other points behind the same triggers, by the light as it was then.
    """

    volts: NDArray[np.float32]
    trigger_offset_s: NDArray[np.float64]
    keys: tuple[bytes, ...]
    further: Callable[[Acquisition], NDArray[np.float32]]
