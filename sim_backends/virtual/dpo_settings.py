"""Vertical, horizontal and trigger settings of the virtual oscilloscope, and their commands.

Source: instrument facts 2.3, 2.4 and 2.6. Numbers that are only recalled are module constants.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

from sim_backends.scpi.arguments import boolean, integer, keyword, quoted, real
from sim_backends.scpi.commands import Setting
from sim_backends.scpi.status import ScpiError
from sim_backends.world import AUX, TriggerCondition

LOWEST_SCALE_V, HIGHEST_SCALE_V = 6.25e-3, 0.6  # V/div, recalled
BANDWIDTH_HZ = 25e9
RATES = tuple(100e9 / 2**octave for octave in range(18))  # S/s; 100 and 50 GS/s recalled, the lower steps assumed
SHORTEST_RECORD, LONGEST_RECORD = 50, 31_250_000  # samples, recalled
RECORD_SHOWN = 5000  # samples; AUTO keeps records below
TRIGGER_LIMIT_V = 5.0  # recalled
DIVISIONS = 10

CHANNELS = {f"CH{number}": number for number in (1, 2, 3, 4)}
TRIGGER_SOURCES = {"AUXiliary": AUX, **CHANNELS}

_SLOPE = keyword("RISe", "FALL")
_LEVEL = real(-TRIGGER_LIMIT_V, TRIGGER_LIMIT_V, ECL=-1.3, TTL=1.4)

VERTICAL_COMMANDS = (
    Setting("SELect:CH#", "channels#.selected", boolean),
    Setting("CH#:SCAle", "channels#.scale_v", real(LOWEST_SCALE_V, HIGHEST_SCALE_V)),
    Setting("CH#:OFFSet", "channels#.offset_v", real(-10, 10)),
    Setting("CH#:POSition", "channels#.position_div", real(-8, 8)),
    Setting("CH#:BANdwidth", "channels#.bandwidth_hz", real(BANDWIDTH_HZ, BANDWIDTH_HZ, FULl=BANDWIDTH_HZ)),
    Setting("CH#:BANdwidth:ENHanced", "channels#.enhanced", keyword("AUTO", "OFF")),
    Setting("CH#:COUPling", "channels#.coupling", keyword("DC")),
    Setting("CH#:TERmination", "channels#.termination_ohm", real(50, 50)),
    Setting("CH#:INVert", "channels#.inverted", boolean),
    Setting("CH#:DESKew", "channels#.deskew_s", real(0, 0)),
    Setting("CH#:LABel[:NAMe]", "channels#.label", quoted),
)

HORIZONTAL_COMMANDS = (
    Setting("HORizontal:MODE", "horizontal.mode", keyword("AUTO", "CONStant", "MANual")),
    Setting("HORizontal:MODE:SAMPLERate", "horizontal.sample_rate", real(RATES[-1] / 2, 2 * RATES[0])),
    Setting("HORizontal:MODE:RECOrdlength", "horizontal.record_length", integer(SHORTEST_RECORD, LONGEST_RECORD)),
    Setting("HORizontal:MODE:SCAle", "horizontal.scale_s", real(1e-12, 1000)),
    Setting("HORizontal:POSition", "horizontal.position_percent", real(0, 100)),
    Setting("HORizontal[:MAIn]:DELay:MODe", "horizontal.delayed", boolean),
    Setting("HORizontal[:MAIn]:DELay:TIMe", "horizontal.delay_s", real(-1, 1)),
    Setting("HORizontal[:MAIn]:DELay:POSition", "horizontal.delay_position_percent", real(0, 100)),
    Setting("HORizontal:ACQLENGTH?", "horizontal.record_length", integer()),
    Setting("HORizontal:ACQDURATION?", "horizontal.duration_s", real()),
    Setting("HORizontal:DIVisions?", "horizontal.divisions", integer()),
    Setting("HORizontal:MAIn:INTERPRatio?", "horizontal.interpolation", integer()),
    Setting("HORizontal:MAIn:UNIts?", "horizontal.unit", quoted),
    Setting("HORizontal:ROLL", "horizontal.roll", keyword("AUTO", "OFF")),
)

TRIGGER_COMMANDS = (
    Setting("TRIGger:A:TYPe", "trigger.type", keyword("EDGE")),
    Setting("TRIGger:A:MODe", "trigger.mode", keyword("AUTO", "NORMal")),
    Setting("TRIGger:A:EDGE:SOUrce", "trigger.source", keyword(*TRIGGER_SOURCES)),
    Setting("TRIGger:A:EDGE:SLOpe", "trigger.present.slope", _SLOPE),
    Setting("TRIGger:A:EDGE:SLOpe:AUX", "trigger.auxiliary.slope", _SLOPE),
    Setting("TRIGger:A:EDGE:SLOpe:CH#", "trigger.inputs#.slope", _SLOPE),
    Setting("TRIGger:A:EDGE:COUPling", "trigger.coupling", keyword("DC")),
    Setting("TRIGger:A:LEVel", "trigger.level_v", _LEVEL),
    Setting("TRIGger:A:LEVel:CH#", "trigger.inputs#.level_v", _LEVEL),
    Setting("TRIGger:AUXLevel", "trigger.auxiliary.level_v", _LEVEL),
    Setting("TRIGger:LVLSrcpreference", "trigger.level_preference", keyword("SRCDependent", "SRCIndependent")),
    Setting("TRIGger:A:HOLDoff:BY", "trigger.holdoff_by", keyword("TIMe", "DEFAult", "AUTO")),
    Setting("TRIGger:A:HOLDoff:TIMe", "trigger.holdoff_s", real(0, 10)),
)


class Vertical(NamedTuple):
    """What turns volts into codes."""

    scale_v: float
    offset_v: float
    position_div: float
    inverted: bool

    @property
    def zero_v(self) -> float:
        """Volts at code 0."""
        return self.offset_v - self.position_div * self.scale_v


@dataclass
class Channel:
    """Vertical settings of one channel. The front end is 50 ohm, DC, full bandwidth, and nothing else."""

    selected: bool = False
    scale_v: float = 0.1
    offset_v: float = 0.0
    position_div: float = 0.0
    bandwidth_hz: float = BANDWIDTH_HZ
    enhanced: str = "AUTO"
    coupling: str = "DC"
    termination_ohm: float = 50.0
    inverted: bool = False
    deskew_s: float = 0.0
    label: str = ""

    @property
    def vertical(self) -> Vertical:
        """The settings that matter to the codes."""
        return Vertical(self.scale_v, self.offset_v, self.position_div, self.inverted)


@dataclass
class Horizontal:
    """Time base. MANual sets rate and record length, CONStant rate and scale, AUTO the scale alone."""

    mode: str = "AUTO"
    highest_rate: float = RATES[0]  # what the number of channels allows
    _rate: float = 25e9
    _record_length: int = RECORD_SHOWN
    _position_percent: float = 50.0
    delayed: bool = False
    _delay_s: float = 0.0
    delay_position_percent: float = 50.0
    roll: str = "AUTO"

    divisions = DIVISIONS
    interpolation = 1
    unit = "s"

    @property
    def sample_rate(self) -> float:
        """Samples per second; the nearest rate there is is taken, -221 when set in AUTO."""
        return min(self._rate, self.highest_rate)

    @sample_rate.setter
    def sample_rate(self, rate: float) -> None:
        if self.mode == "AUTO":
            raise ScpiError(-221, "HORizontal:MODE is AUTO: the sample rate follows the scale")
        length_s = self.duration_s
        self._rate = min(RATES, key=lambda step: max(step / rate, rate / step))
        if self.mode == "CONStant":
            self._record_length = self._fitting(length_s)

    @property
    def record_length(self) -> int:
        """Samples of a record; -221 when set outside MANual."""
        return self._record_length

    @record_length.setter
    def record_length(self, samples: int) -> None:
        if self.mode != "MANual":
            raise ScpiError(-221, f"HORizontal:MODE is {self.mode.upper()}: the record length follows the scale")
        self._record_length = samples

    @property
    def duration_s(self) -> float:
        """Duration of a record."""
        return self._record_length / self.sample_rate

    @property
    def scale_s(self) -> float:
        """Time per division; -221 when set in MANual."""
        return self.duration_s / DIVISIONS

    @scale_s.setter
    def scale_s(self, seconds: float) -> None:
        if self.mode == "MANual":
            raise ScpiError(-221, "HORizontal:MODE is MANUAL: the scale follows rate and record length")
        duration = seconds * DIVISIONS
        if self.mode == "AUTO":
            self._rate = next((rate for rate in RATES[1:] if rate * duration <= RECORD_SHOWN), RATES[-1])
        self._record_length = self._fitting(duration)

    @property
    def position_percent(self) -> float:
        """Where in the record the trigger is; 50 in delay mode."""
        return 50.0 if self.delayed else self._position_percent

    @position_percent.setter
    def position_percent(self, percent: float) -> None:
        self._position_percent = percent

    @property
    def delay_s(self) -> float:
        """Delay of the point at `delay_position_percent` behind the trigger, on the sampling grid."""
        return round(self._delay_s * self.sample_rate) / self.sample_rate

    @delay_s.setter
    def delay_s(self, seconds: float) -> None:
        self._delay_s = seconds

    @property
    def trigger_sample(self) -> int:
        """Index of the sample at the trigger, 0 for the record's first; outside the record when it is delayed far."""
        if self.delayed:
            return round(self.delay_position_percent / 100 * self._record_length) - round(
                self._delay_s * self.sample_rate
            )
        return round(self._position_percent / 100 * self._record_length)

    def _fitting(self, duration: float) -> int:
        return min(max(round(duration * self.sample_rate), SHORTEST_RECORD), LONGEST_RECORD)


@dataclass
class TriggerInput:
    """Level and slope of one trigger source."""

    level_v: float = 0.0
    slope: str = "RISe"


@dataclass
class Trigger:
    """The A trigger: an edge on AUX or a channel."""

    type: str = "EDGE"
    mode: str = "AUTO"
    source: str = "CH1"
    coupling: str = "DC"
    level_preference: str = "SRCDependent"
    holdoff_by: str = "DEFAult"
    holdoff_s: float = 0.0
    inputs: dict[int, TriggerInput] = field(
        default_factory=lambda: {number: TriggerInput() for number in TRIGGER_SOURCES.values()}
    )

    @property
    def auxiliary(self) -> TriggerInput:
        """The AUX input."""
        return self.inputs[AUX]

    @property
    def present(self) -> TriggerInput:
        """The input that `source` names."""
        return self.inputs[TRIGGER_SOURCES[self.source]]

    @property
    def level_v(self) -> float:
        """Level of the channel that is the source; AUX has a command of its own, this one then means channel 1."""
        return self.inputs[TRIGGER_SOURCES[self.source] or 1].level_v

    @level_v.setter
    def level_v(self, volts: float) -> None:
        self.inputs[TRIGGER_SOURCES[self.source] or 1].level_v = volts

    @property
    def condition(self) -> TriggerCondition:
        """What the world is asked to wait for."""
        present = self.present
        return TriggerCondition(TRIGGER_SOURCES[self.source], present.level_v, rising=present.slope == "RISe")
