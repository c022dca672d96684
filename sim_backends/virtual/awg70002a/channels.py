"""The channels of the virtual AWG: amplitude, resolution, markers, trigger inputs, and their commands.

Source: instrument facts 1.5 and 1.6. Limits that are only recalled are module constants.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from sim_backends.scpi.arguments import boolean, integer, keyword, optional, real, short_form
from sim_backends.scpi.commands import Setting, bind, chunks
from sim_backends.scpi.messages import Argument, Chunk
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a.sequences import SequenceEntry
from sim_backends.virtual.awg70002a.waveforms import AMPLITUDES_V, Waveform

LOWEST_AMPLITUDE_V, HIGHEST_AMPLITUDE_V = AMPLITUDES_V
MARKER_LIMIT_V = 1.4
SMALLEST_MARKER_V, LARGEST_MARKER_V = 0.5, 1.4  # high minus low
TRIGGER_LIMIT_V = 5.0  # recalled, for 1 kohm
SOURCE_OHM = 50  # of what is wired to a trigger input: the DMD's frame synch output; recalled
LARGEST_SKEW_S = 1e-9  # recalled

TRIGGER_INPUT = keyword("ATRigger", "BTRigger")


class InputSetting(Setting):
    """A setting of one trigger input, which is named behind the value: `TRIGger:LEVel 1.4,BTRigger`."""

    def execute(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """Set the attribute of the input (A if none is named)."""
        value, name = bind((self.kind, optional(TRIGGER_INPUT)), arguments)
        setattr(instrument.inputs[name or "ATRigger"], self.attribute, value)
        return []

    def answer(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """The attribute of the input."""
        (name,) = bind((optional(TRIGGER_INPUT),), arguments)
        value = getattr(instrument.inputs[name or "ATRigger"], self.attribute)
        return chunks(self.kind.format(value, verbose=False))


_LEVEL = "[SOURce#:]VOLTage[:LEVel][:IMMediate]"
_MARKER = "[SOURce#:]MARKer#:VOLTage[:LEVel][:IMMediate]"

CHANNEL_COMMANDS = (
    Setting(_LEVEL + "[:AMPLitude]", "sources#.amplitude_v", real(LOWEST_AMPLITUDE_V, HIGHEST_AMPLITUDE_V)),
    Setting(_LEVEL + ":HIGH", "sources#.high_v", real(LOWEST_AMPLITUDE_V / 2, HIGHEST_AMPLITUDE_V / 2)),
    Setting(_LEVEL + ":LOW", "sources#.low_v", real(-HIGHEST_AMPLITUDE_V / 2, -LOWEST_AMPLITUDE_V / 2)),
    Setting(_LEVEL + ":OFFSet", "sources#.offset_v", real()),
    Setting("[SOURce#:]DAC:RESolution", "sources#.dac_bits", integer(8, 10)),
    Setting("[SOURce#:]SKEW", "sources#.skew_s", real(-LARGEST_SKEW_S, LARGEST_SKEW_S)),
    Setting("[SOURce#:]TINPut?", "sources#.trigger_input", keyword("ITRigger", "ATRigger", "BTRigger")),
    Setting(_MARKER + ":HIGH", "sources#.markers#.high_v", real(-MARKER_LIMIT_V, MARKER_LIMIT_V)),
    Setting(_MARKER + ":LOW", "sources#.markers#.low_v", real(-MARKER_LIMIT_V, MARKER_LIMIT_V)),
    Setting(_MARKER + "[:AMPLitude]", "sources#.markers#.amplitude_v", real(SMALLEST_MARKER_V, LARGEST_MARKER_V)),
    Setting(_MARKER + ":OFFSet", "sources#.markers#.offset_v", real(-MARKER_LIMIT_V, MARKER_LIMIT_V)),
    Setting("[SOURce#:]MARKer#:DELay", "sources#.markers#.delay_s", real(0, LARGEST_SKEW_S)),
    Setting("OUTPut#[:STATe]", "sources#.output", boolean),
    Setting("OUTPut#:PATH", "sources#.path", keyword("DIRect", "AC", "DCAmplified")),
    Setting("OUTPut#:WVALue[:ANALog][:STATe]", "sources#.waiting", keyword("FIRSt", "ZERO"), effect=False),
    Setting("OUTPut#:SVALue[:ANALog][:STATe]", "sources#.stopped", keyword("OFF", "ZERO"), effect=False),
    Setting(
        "OUTPut#:WVALue:MARKer#[:STATe]", "sources#.markers#.waiting", keyword("FIRSt", "LOW", "HIGH"), effect=False
    ),
    Setting("OUTPut#:SVALue:MARKer#[:STATe]", "sources#.markers#.stopped", keyword("OFF", "LOW"), effect=False),
    InputSetting("TRIGger[:SEQuence]:LEVel", "level_v", real(-TRIGGER_LIMIT_V, TRIGGER_LIMIT_V)),
    InputSetting("TRIGger[:SEQuence]:SLOPe", "slope", keyword("POSitive", "NEGative")),
    InputSetting("TRIGger[:SEQuence]:IMPedance", "impedance_ohm", integer(50, 1000)),
    InputSetting("TRIGger[:SEQuence]:MODE", "mode", keyword("SYNChronous", "ASYNchronous")),
)


@dataclass
class TriggerInput:
    """Settings of trigger input A or B; the impedance is 50 ohm or 1 kohm."""

    level_v: float = 1.4
    slope: str = "POSitive"
    mode: str = "ASYNchronous"
    _impedance_ohm: int = 50

    @property
    def impedance_ohm(self) -> int:
        """50 or 1000."""
        return self._impedance_ohm

    @impedance_ohm.setter
    def impedance_ohm(self, ohm: int) -> None:
        if ohm not in (50, 1000):
            raise ScpiError(-224, f"{ohm} ohm")
        self._impedance_ohm = ohm

    @property
    def open_level_v(self) -> float:
        """The level, seen at the open end of the cable: the input's impedance divides what comes."""
        return self.level_v * (SOURCE_OHM + self._impedance_ohm) / self._impedance_ohm


@dataclass
class Marker:
    """A marker output; its levels stay 0.5 to 1.4 V apart and within -1.4..1.4 V."""

    _high_v: float = 1.0
    _low_v: float = 0.0
    delay_s: float = 0.0
    waiting: str = "LOW"
    stopped: str = "LOW"

    @property
    def high_v(self) -> float:
        """High level (V)."""
        return self._high_v

    @high_v.setter
    def high_v(self, volts: float) -> None:
        self._set(self._low_v, volts)

    @property
    def low_v(self) -> float:
        """Low level (V)."""
        return self._low_v

    @low_v.setter
    def low_v(self, volts: float) -> None:
        self._set(volts, self._high_v)

    @property
    def amplitude_v(self) -> float:
        """High minus low (V)."""
        return self._high_v - self._low_v

    @amplitude_v.setter
    def amplitude_v(self, volts: float) -> None:
        self._set(self.offset_v - volts / 2, self.offset_v + volts / 2)

    @property
    def offset_v(self) -> float:
        """Mean of high and low (V)."""
        return (self._high_v + self._low_v) / 2

    @offset_v.setter
    def offset_v(self, volts: float) -> None:
        self._set(volts - self.amplitude_v / 2, volts + self.amplitude_v / 2)

    def _set(self, low: float, high: float) -> None:
        slack = 1e-9  # V; decimal levels are no binary fractions
        apart = SMALLEST_MARKER_V - slack <= high - low <= LARGEST_MARKER_V + slack
        if not apart or low < -MARKER_LIMIT_V - slack or high > MARKER_LIMIT_V + slack:
            raise ScpiError(-222, f"marker levels {low:g} V and {high:g} V")
        self._low_v, self._high_v = low, high


@dataclass
class Source:
    """One channel.

    Attributes:
        waveform: What is assigned, if it is a waveform.
        sequence: What is assigned, if it is a sequence, and its `track`.
        component: Of an IQ waveform, the component that is played.
    """

    number: int
    waveform: Waveform | None = None
    sequence: SequenceEntry | None = None
    track: int = 1
    component: str = "I"
    output: bool = False
    amplitude_v: float = HIGHEST_AMPLITUDE_V
    dac_bits: int = 10
    run_mode: str = "CONTinuous"
    trigger_input: str = "ATRigger"
    skew_s: float = 0.0
    waiting: str = "ZERO"
    stopped: str = "ZERO"
    markers: dict[int, Marker] = field(default_factory=lambda: {1: Marker(), 2: Marker()})

    @property
    def assigned(self) -> bool:
        """Whether a waveform or a sequence is assigned."""
        return self.waveform is not None or self.sequence is not None

    def clear(self) -> None:
        """Take the asset off."""
        self.waveform = self.sequence = None
        self.track, self.component = 1, "I"

    def couple(self, other: "Source") -> None:
        """Take over the analogue and marker settings of another channel."""
        self.amplitude_v, self.dac_bits, self.skew_s = other.amplitude_v, other.dac_bits, other.skew_s
        self.waiting, self.stopped = other.waiting, other.stopped
        self.markers = {number: replace(marker) for number, marker in other.markers.items()}

    @property
    def high_v(self) -> float:
        """High level (V): the direct path is centred on 0 V, so setting it sets the amplitude."""
        return self.amplitude_v / 2

    @high_v.setter
    def high_v(self, volts: float) -> None:
        self.amplitude_v = 2 * volts

    @property
    def low_v(self) -> float:
        """Low level (V)."""
        return -self.amplitude_v / 2

    @low_v.setter
    def low_v(self, volts: float) -> None:
        self.amplitude_v = -2 * volts

    @property
    def offset_v(self) -> float:
        """An offset exists behind the external DC amplifier only: -221, and its query stays without a reply."""
        raise ScpiError(-221, f"OUTPUT{self.number}:PATH is DIR: no offset")

    @offset_v.setter
    def offset_v(self, volts: float) -> None:
        raise ScpiError(-221, f"OUTPUT{self.number}:PATH is DIR: no offset of {volts:g} V")

    @property
    def path(self) -> str:
        """Output path: the direct one only. The text of its error ends in CR LF, as the real one does."""
        return "DIRect"

    @path.setter
    def path(self, word: str) -> None:
        if word != "DIRect":
            raise ScpiError(-222, f"Data Out of Range - OUTPUT{self.number}:PATH {short_form(word)}\r\n")
