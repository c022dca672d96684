"""The function-generator mode of the virtual AWG: shapes, levels, commands, and one period of what comes out.

Source: the `FGEN` command tree and its defaults of the vendor's programmer interface; limits as the QCoDeS driver has
them. The shapes of the pulses (Gaussian and exponential) are recalled.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.arguments import Keyword, integer, keyword, real
from sim_backends.scpi.commands import Query, Setting
from sim_backends.scpi.status import ScpiError

LOWEST_HZ, FASTEST_HZ, FASTEST_OTHER_HZ = 1.0, 12.5e9, 6.25e9
LARGEST_V = 0.5  # Vpp into 50 ohm, direct path
LARGEST_LEVEL_V = LARGEST_V / 2
DAC_RATE = 25e9  # S/s
FEWEST_POINTS, MOST_POINTS = 2400, 2**20
PULSE_WIDTH = 1 / 8  # recalled: sigma and time constant of the pulses, in periods
NOISE_SIGMA = 1 / 6  # recalled: of the peak-to-peak amplitude

LOAD_OHM = 50


def power_dbm(amplitude_v: float) -> float:
    """The power (dBm) of a sine of a peak-to-peak amplitude (V) into 50 ohm."""
    return 10 * math.log10(max(amplitude_v, 1e-9) ** 2 / 8 / LOAD_OHM / 1e-3)


# the short form GAUSS is what the QCoDeS driver sends and expects; GAUS is accepted as well
SHAPE = Keyword(
    forms={
        **(keyword("SINE", "SQUare", "TRIangle", "NOISe", "DC", "GAUSSian", "EXPRise", "EXPDecay", "NONE").forms or {}),
        "GAUS": "GAUSSian",
    }
)

FUNCTION_COMMANDS = (
    Setting("FGEN:CHANnel#:TYPE", "functions#.shape", SHAPE),
    Setting("FGEN:CHANnel#:FREQuency", "functions#.frequency_hz", real(LOWEST_HZ, FASTEST_HZ)),
    Query("FGEN:CHANnel#:PERiod?", "function_period"),
    Setting("FGEN:CHANnel#:AMPLitude[:VOLTage]", "functions#.amplitude_v", real(0, LARGEST_V)),
    Setting("FGEN:CHANnel#:AMPLitude:POWer", "functions#.amplitude_dbm", real(-100, power_dbm(LARGEST_V))),
    Setting("FGEN:CHANnel#:HIGH", "functions#.high_v", real(-LARGEST_LEVEL_V, LARGEST_LEVEL_V)),
    Setting("FGEN:CHANnel#:LOW", "functions#.low_v", real(-LARGEST_LEVEL_V, LARGEST_LEVEL_V)),
    Setting("FGEN:CHANnel#:OFFSet", "functions#.offset_v", real()),
    Setting("FGEN:CHANnel#:DCLevel", "functions#.dc_level_v", real(-LARGEST_LEVEL_V, LARGEST_LEVEL_V)),
    Setting("FGEN:CHANnel#:PHASe", "functions#.phase_deg", real(-180, 180)),
    Setting("FGEN:CHANnel#:SYMMetry", "functions#.symmetry", integer(0, 100)),
    Setting("FGEN:CHANnel#:PATH", "sources#.path", keyword("DIRect", "DCAMplified", "AC")),
)


@dataclass
class SharedFrequency:
    """The one frequency of all channels (Hz)."""

    hz: float = 1.2e6


class Function:
    """What one channel generates; *RST: 1.2 MHz sine, 0.5 Vpp about 0 V."""

    def __init__(self, frequency: SharedFrequency) -> None:
        self._frequency = frequency
        self._shape = "SINE"
        self._amplitude_v = LARGEST_V
        self._offset_v = 0.0
        self.dc_level_v = 0.0
        self.phase_deg = 0.0
        self.symmetry = 100

    @property
    def shape(self) -> str:
        """The shape's word."""
        return self._shape

    @shape.setter
    def shape(self, word: str) -> None:
        self._shape = word
        self._frequency.hz = min(self._frequency.hz, self._fastest())

    @property
    def frequency_hz(self) -> float:
        """Frequency (Hz); sine and square reach twice as far as the others (-222)."""
        return self._frequency.hz

    @frequency_hz.setter
    def frequency_hz(self, hz: float) -> None:
        if hz > self._fastest():
            raise ScpiError(-222, f"{hz:g} Hz, {self._fastest():g} Hz is the most for {self._shape}")
        self._frequency.hz = hz

    def _fastest(self) -> float:
        return FASTEST_HZ if self._shape in ("SINE", "SQUare") else FASTEST_OTHER_HZ

    @property
    def amplitude_v(self) -> float:
        """Peak-to-peak amplitude (V); a larger one may shrink the offset."""
        return self._amplitude_v

    @amplitude_v.setter
    def amplitude_v(self, volts: float) -> None:
        self._amplitude_v = volts
        self.offset_v = self._offset_v

    @property
    def offset_v(self) -> float:
        """Offset (V); one outside its limits is set to the limit."""
        return self._offset_v

    @offset_v.setter
    def offset_v(self, volts: float) -> None:
        room = LARGEST_LEVEL_V - self._amplitude_v / 2
        self._offset_v = min(max(volts, -room), room)

    @property
    def amplitude_dbm(self) -> float:
        """The amplitude as the power of a sine (dBm)."""
        return power_dbm(self._amplitude_v)

    @amplitude_dbm.setter
    def amplitude_dbm(self, dbm: float) -> None:
        self.amplitude_v = math.sqrt(8 * LOAD_OHM * 1e-3 * 10 ** (dbm / 10))

    @property
    def high_v(self) -> float:
        """High level (V); -222 below the low one."""
        return self._offset_v + self._amplitude_v / 2

    @high_v.setter
    def high_v(self, volts: float) -> None:
        self._levels(self.low_v, volts)

    @property
    def low_v(self) -> float:
        """Low level (V); -222 above the high one."""
        return self._offset_v - self._amplitude_v / 2

    @low_v.setter
    def low_v(self, volts: float) -> None:
        self._levels(volts, self.high_v)

    def _levels(self, low_v: float, high_v: float) -> None:
        if high_v < low_v:
            raise ScpiError(-222, f"levels of {low_v:g} V and {high_v:g} V")
        self._amplitude_v, self._offset_v = high_v - low_v, (low_v + high_v) / 2

    def key(self) -> tuple[Any, ...]:
        """Differs whenever something else comes out."""
        levels = (self._amplitude_v, self._offset_v, self.dc_level_v)
        return (self._shape, self._frequency.hz, *levels, self.phase_deg, self.symmetry)

    def rendered(self, noise: np.random.Generator) -> tuple[NDArray[np.float32], float]:
        """Volts of one period of the output, and the sample rate (S/s) at which they are put out."""
        if self._shape in ("DC", "NONE"):
            return np.full(FEWEST_POINTS, self.dc_level_v if self._shape == "DC" else 0.0, np.float32), DAC_RATE
        if self._shape == "NOISe":
            white = np.clip(NOISE_SIGMA * noise.standard_normal(MOST_POINTS // 8), -0.5, 0.5)
            return np.asarray(self._offset_v + self._amplitude_v * white, np.float32), DAC_RATE
        periods = math.ceil(FEWEST_POINTS * self._frequency.hz / DAC_RATE)
        points = min(MOST_POINTS, math.floor(periods * DAC_RATE / self._frequency.hz))
        crest = 0.25 if points == 2 * periods else 0.0  # two samples a period: at its crests, not at its zeros
        turns = (np.arange(points) * periods / points + self.phase_deg / 360 + crest) % 1.0
        volts = self._offset_v + self._amplitude_v / 2 * unit_shape(self._shape, turns, self.symmetry / 100)
        return np.asarray(volts, np.float32), points * self._frequency.hz / periods


def unit_shape(word: str, turns: NDArray[np.float64], symmetry: float) -> NDArray[np.float64]:
    """A shape (-1..1) at `turns` (0..1 of its period); `symmetry` is the rising part of a triangle."""
    if word == "SINE":
        return np.sin(2 * np.pi * turns)
    if word == "SQUare":
        return np.where(turns < 0.5, 1.0, -1.0)
    if word == "TRIangle":
        return np.interp(turns, [0.0, symmetry, 1.0], [-1.0, 1.0, -1.0]) if symmetry < 1 else 2 * turns - 1
    if word == "GAUSSian":
        return 2 * np.exp(-0.5 * ((turns - 0.5) / PULSE_WIDTH) ** 2) - 1
    decay = np.exp(-turns / PULSE_WIDTH)
    return 1 - 2 * decay if word == "EXPRise" else 2 * decay - 1
