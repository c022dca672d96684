"""The Basic Waveform editor of the virtual AWG: settings of a shape, and the waveform that it compiles.

Source: the vendor's descriptions of the `BWAVeform` tree; scripts of others send the words in quotes. The words of
`AUTO` are those of the AWG5200; values after a reset are recalled.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.arguments import Keyword, boolean, integer, keyword, quoted, real, text_of
from sim_backends.scpi.commands import Action, Setting
from sim_backends.scpi.messages import Argument
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a.function_generator import LARGEST_LEVEL_V, LARGEST_V, unit_shape
from sim_backends.virtual.awg70002a.schedule import LONGEST_PLAYBACK
from sim_backends.virtual.awg70002a.waveforms import LONGEST, RATES

BLOCK = 2**16  # points that are computed at a time: what is in between stays in the processor's cache
NOISE_SIGMA = 1 / 6  # recalled: of the peak-to-peak amplitude


class Word(Keyword):
    """A keyword that may stand in quotes."""

    def parse(self, argument: Argument) -> str:
        """The declared word; -224 for any other."""
        return super().parse(text_of(argument).strip("\"'"))


def _word(*words: str) -> Word:
    return Word(forms=keyword(*words).forms)


BASIC_COMMANDS = (
    Setting("BWAVeform:FUNCtion", "basic.function", _word("SINE", "SQUare", "TRIangle", "RAMP", "NOISe", "DC")),
    Setting("BWAVeform:AUTO", "basic.auto", _word("LENgth", "CYCLe", "DURation", "FREQuency", "SR")),
    Setting("BWAVeform:FREQuency", "basic.frequency_hz", real(1e-3, RATES[1] / 2)),
    Setting("BWAVeform:CYCLe", "basic.cycles", real(1e-6, LONGEST)),
    Setting("BWAVeform:LENGth", "basic.length", integer(1, LONGEST)),
    Setting("BWAVeform:SRATe", "basic.sample_rate", real(*RATES)),
    Setting("BWAVeform:AMPLitude", "basic.amplitude_v", real(0, LARGEST_V)),
    Setting("BWAVeform:OFFSet", "basic.offset_v", real(-LARGEST_LEVEL_V, LARGEST_LEVEL_V)),
    Setting("BWAVeform:HIGH", "basic.high_v", real(-LARGEST_LEVEL_V, LARGEST_LEVEL_V)),
    Setting("BWAVeform:LOW", "basic.low_v", real(-LARGEST_LEVEL_V, LARGEST_LEVEL_V)),
    Setting("BWAVeform:FDRange", "basic.full_range", boolean),
    Setting("BWAVeform:COMPile:NAME", "basic.name", quoted),
    Setting("BWAVeform:COMPile:CHANnel", "basic.channel", _word("NONE", "1", "2")),
    Setting("BWAVeform:COMPile:CASSign", "basic.assigns", boolean),
    Setting("BWAVeform:COMPile:PLAY", "basic.plays", boolean),
    Action("BWAVeform:COMPile", "compile_basic"),
    Action("BWAVeform:RESet", "basic.reset"),
)


@dataclass(frozen=True)
class Compiled:
    """What comes of the settings: samples (n,) in -1..1, and what is recommended for them (S/s, Vpp, V)."""

    samples: NDArray[np.float32]
    sample_rate: float
    amplitude_v: float
    offset_v: float


class BasicWaveform:
    """A shape: length = cycles * sample rate / frequency, one of which follows from the others (`auto`)."""

    FOLLOWS: ClassVar = {"LENgth": "length", "DURation": "length", "CYCLe": "cycles", "FREQuency": "frequency_hz"}

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """`BWAVeform:RESet`: a sine of one cycle."""
        self.function, self._auto = "SINE", "CYCLe"
        self._values = {"frequency_hz": 1e6, "sample_rate": RATES[1], "length": 25000.0, "cycles": 1.0}
        self._amplitude_v, self._offset_v = LARGEST_V, 0.0
        self.full_range = True
        self.name, self.channel = "Waveform", "NONE"
        self.assigns = self.plays = False

    # --- time

    @property
    def auto(self) -> str:
        """Which setting follows from the others."""
        return self._auto

    @auto.setter
    def auto(self, word: str) -> None:
        self._auto = word
        self._follow()

    @property
    def frequency_hz(self) -> float:
        """Frequency (Hz)."""
        return self._values["frequency_hz"]

    @frequency_hz.setter
    def frequency_hz(self, hz: float) -> None:
        self._set("frequency_hz", hz)

    @property
    def cycles(self) -> float:
        """How often the shape is repeated."""
        return self._values["cycles"]

    @cycles.setter
    def cycles(self, count: float) -> None:
        self._set("cycles", count)

    @property
    def length(self) -> int:
        """Points."""
        return round(self._values["length"])

    @length.setter
    def length(self, points: int) -> None:
        self._set("length", points)

    @property
    def sample_rate(self) -> float:
        """Sample rate (S/s)."""
        return self._values["sample_rate"]

    @sample_rate.setter
    def sample_rate(self, rate: float) -> None:
        self._set("sample_rate", rate)

    def _set(self, name: str, value: float) -> None:
        """Set one; -221 if it follows from the others, -222 if one of them cannot follow."""
        if name == self._following:
            raise ScpiError(-221, f"it follows from the others (BWAVeform:AUTO {self._auto})")
        before = dict(self._values)
        self._values[name] = value
        try:
            self._follow()
        except ScpiError:
            self._values = before
            raise

    @property
    def _following(self) -> str:
        return self.FOLLOWS.get(self._auto, "sample_rate")

    def _follow(self) -> None:
        hz, rate, length, cycles = (self._values[name] for name in ("frequency_hz", "sample_rate", "length", "cycles"))
        found = {
            "length": float(round(cycles * rate / hz)),
            "cycles": length * hz / rate,
            "frequency_hz": cycles * rate / length,
            "sample_rate": length * hz / cycles,
        }[self._following]
        if self._following == "length" and not 1 <= found <= LONGEST:
            raise ScpiError(-222, f"{found:g} points")
        if self._following == "sample_rate" and not RATES[0] <= found <= RATES[1]:
            raise ScpiError(-222, f"{found:g} S/s")
        self._values[self._following] = found

    # --- volts

    @property
    def amplitude_v(self) -> float:
        """Peak-to-peak amplitude (V)."""
        return self._amplitude_v

    @amplitude_v.setter
    def amplitude_v(self, volts: float) -> None:
        self._level(volts, self._offset_v)

    @property
    def offset_v(self) -> float:
        """Offset (V)."""
        return self._offset_v

    @offset_v.setter
    def offset_v(self, volts: float) -> None:
        self._level(self._amplitude_v, volts)

    @property
    def high_v(self) -> float:
        """High level (V)."""
        return self._offset_v + self._amplitude_v / 2

    @high_v.setter
    def high_v(self, volts: float) -> None:
        low = self.low_v
        self._level(volts - low, (volts + low) / 2)

    @property
    def low_v(self) -> float:
        """Low level (V)."""
        return self._offset_v - self._amplitude_v / 2

    @low_v.setter
    def low_v(self, volts: float) -> None:
        high = self.high_v
        self._level(high - volts, (high + volts) / 2)

    def _level(self, amplitude_v: float, offset_v: float) -> None:
        slack = 1e-9  # V; decimal levels are no binary fractions
        if amplitude_v < 0 or abs(offset_v) + amplitude_v / 2 > LARGEST_LEVEL_V + slack:
            raise ScpiError(-222, f"{amplitude_v:g} Vpp about {offset_v:g} V")
        self._amplitude_v, self._offset_v = amplitude_v, offset_v

    # --- the waveform

    def compiled(self, noise: np.random.Generator) -> Compiled:
        """The samples: of the full range with amplitude and offset recommended, or of the range that they leave.

        Raises:
            ScpiError: -225, more than could be played here.
        """
        if self.length > LONGEST_PLAYBACK:
            raise ScpiError(-225, f"{self.length} points, {LONGEST_PLAYBACK} are the most that are simulated")
        if self.function == "DC":
            samples = np.full(self.length, self._offset_v / LARGEST_LEVEL_V, np.float32)
            return Compiled(samples, self.sample_rate, LARGEST_V, 0.0)
        samples = np.empty(self.length, np.float32)
        for first in range(0, self.length, BLOCK):
            block = samples[first : first + BLOCK]
            unit = self._unit(noise, np.arange(first, first + block.size, dtype=np.float64))
            block[:] = unit if self.full_range else (self._offset_v + self._amplitude_v / 2 * unit) / LARGEST_LEVEL_V
        if self.full_range:
            return Compiled(samples, self.sample_rate, self._amplitude_v, self._offset_v)
        return Compiled(samples, self.sample_rate, LARGEST_V, 0.0)

    def _unit(self, noise: np.random.Generator, points: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.function == "NOISe":
            return np.clip(2 * NOISE_SIGMA * noise.standard_normal(points.size), -1, 1)
        turns = points * (self.frequency_hz / self.sample_rate)
        turns -= np.floor(turns)
        words = {"RAMP": ("TRIangle", 1.0), "TRIangle": ("TRIangle", 0.5)}
        word, symmetry = words.get(self.function, (self.function, math.nan))
        return unit_shape(word, turns, symmetry)
