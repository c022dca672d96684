"""What travels between the virtual instruments and the world: light, waveforms, trigger conditions, records."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim_backends import chance

AUX = 0
BYPASS = 0


@dataclass(frozen=True)
class Emission:
    """What the laser puts out: wavelength (nm) and power (W); power 0 is dark."""

    wavelength_nm: float
    power_w: float


@dataclass(frozen=True, eq=False)
class Playback:
    """What the generator's channel 1 is putting out, periodic for ever from t = 0 of the virtual clock.

    volts: (n,) DAC volts into 50 ohm in front of the output stage, scaled, quantised and clipped.
    marker: (n,) marker 1, between `marker_low_v` and `marker_high_v`. sample_rate: S/s.

    Raises:
        ValueError: `volts` and `marker` are not two equally long periods.
    """

    volts: NDArray[np.float32]
    marker: NDArray[np.bool_]
    marker_low_v: float
    marker_high_v: float
    sample_rate: float

    def __post_init__(self) -> None:
        if self.volts.ndim != 1 or self.volts.size == 0 or self.marker.shape != self.volts.shape:
            raise ValueError(
                f"playback: volts {self.volts.shape}, marker {self.marker.shape}: give two equally long periods"
            )

    @property
    def period(self) -> float:
        """Period (s)."""
        return float(self.volts.size / self.sample_rate)

    @cached_property
    def digest(self) -> bytes:
        """Names the playback, computed once."""
        return chance.digest(
            self.volts.astype("<f4").tobytes(),
            np.packbits(self.marker).tobytes(),
            float(self.marker_low_v),
            float(self.marker_high_v),
            float(self.sample_rate),
        )


@dataclass(frozen=True)
class TriggerCondition:
    """An edge on `source` (`AUX` or a channel 1..4) through `level_v`."""

    source: int
    level_v: float
    rising: bool


@dataclass(frozen=True)
class Acquisition:
    """What the oscilloscope samples after each trigger; `start_s` is the first sample's time from the trigger."""

    channels: tuple[int, ...]
    sample_rate: float
    samples: int
    start_s: float

    @cached_property
    def digest(self) -> bytes:
        """Names the acquisition."""
        return chance.digest(*self.channels, "at", float(self.sample_rate), self.samples, float(self.start_s))


@dataclass(frozen=True, eq=False)
class Record:
    """Volts at the oscilloscope's inputs, (triggers, channels, samples) float32: detector and receiver noise included.

    trigger_offset_s: (triggers,) how much later than `start_s` after its trigger the first sample was really taken.
    keys: one noise key a trigger.
    """

    volts: NDArray[np.float32]
    trigger_offset_s: NDArray[np.float64]
    keys: tuple[bytes, ...]

    @cached_property
    def noise(self) -> np.random.Generator:
        """Generator for the digitiser's noise of a record with one trigger: the same as `frame_noise(0)`."""
        return self.frame_noise(0)

    def frame_noise(self, trigger: int) -> np.random.Generator:
        """Generator for the digitiser's noise of one trigger, the same however many triggers the record has."""
        return chance.generator(chance.digest(self.keys[trigger], "digitiser"))
