"""Time base of the virtual oscilloscope.

Source: instrument facts 2.4; hardware facts, DPO72504DX. Numbers that are only recalled are module constants.
"""

from dataclasses import dataclass

from sim_backends.scpi.arguments import boolean, integer, keyword, quoted, real
from sim_backends.scpi.commands import Setting
from sim_backends.scpi.status import ScpiError

RATES = tuple(100e9 / 2**octave for octave in range(18))  # S/s; 100 and 50 GS/s recalled, the lower steps assumed
SHORTEST_RECORD, LONGEST_RECORD = 500, 31_250_000  # samples, recalled
FRAME_LENGTHS = (50, 250)  # samples; permitted in FastFrame in addition (HORizontal:FASTframe:LENgth)
RECORD_SHOWN = 5000  # samples; AUTO keeps records below
DIVISIONS = 10
DELAY_LIMIT_S = 1.0  # recalled

HORIZONTAL_COMMANDS = (
    Setting("HORizontal:MODE", "horizontal.mode", keyword("AUTO", "CONStant", "MANual")),
    Setting("HORizontal:MODE:SAMPLERate", "horizontal.sample_rate", real(RATES[-1] / 2, 2 * RATES[0])),
    Setting("HORizontal:MODE:RECOrdlength", "horizontal.record_length", integer(1, LONGEST_RECORD)),
    Setting("HORizontal:MODE:SCAle", "horizontal.scale_s", real(1e-12, 1000)),
    Setting("HORizontal:POSition", "horizontal.position_percent", real(0, 100)),
    Setting("HORizontal[:MAIn]:DELay:MODe", "horizontal.delayed", boolean),
    Setting("HORizontal[:MAIn]:DELay:TIMe", "horizontal.delay_s", real(-DELAY_LIMIT_S, DELAY_LIMIT_S)),
    Setting("HORizontal[:MAIn]:DELay:POSition", "horizontal.delay_position_percent", real(0, 100)),
    Setting("HORizontal:ACQLENGTH?", "horizontal.record_length", integer()),
    Setting("HORizontal:ACQDURATION?", "horizontal.duration_s", real()),
    Setting("HORizontal:DIVisions?", "horizontal.divisions", integer()),
    Setting("HORizontal:MAIn:INTERPRatio?", "horizontal.interpolation", integer()),
    Setting("HORizontal:MAIn:UNIts", "horizontal.unit", quoted),
    Setting("HORizontal:ROLL", "horizontal.roll", keyword("AUTO", "OFF", "ON")),
)


@dataclass(frozen=True)
class Records:
    """What records a model takes.

    Attributes:
        rates: S/s, the highest first, which is for two channels or fewer where it is `shared`.
        shortest, longest: samples of one record, of all frames together.
        frame_lengths: samples of frames that may be shorter than the shortest record.
        shared: whether more than two channels have the next lower rate.
    """

    rates: tuple[float, ...]
    shortest: int
    longest: int
    frame_lengths: tuple[int, ...] = ()
    shared: bool = False


RECORDS = Records(RATES, SHORTEST_RECORD, LONGEST_RECORD, FRAME_LENGTHS, shared=True)


@dataclass
class Horizontal:
    """Time base. MANual sets rate and record length, CONStant rate and scale, AUTO the scale alone.

    `settle` goes to what is permitted after every setting, without a word, and stays there.
    """

    records: Records = RECORDS
    mode: str = "AUTO"
    highest_rate: float = RATES[0]  # what the number of channels allows
    follows: str = "HORIZontalscale"  # in MANual, what a new sample rate changes: the scale, or the record length
    _rate: float = 25e9
    _record_length: int = RECORD_SHOWN
    _position_percent: float = 50.0
    delayed: bool = False
    _delay_s: float = 0.0
    delay_position_percent: float = 50.0
    roll: str = "AUTO"
    unit: str = "s"

    divisions = DIVISIONS
    interpolation = 1

    @property
    def sample_rate(self) -> float:
        """Samples per second; the nearest rate there is is taken, -221 when set in AUTO."""
        return self._rate

    @sample_rate.setter
    def sample_rate(self, rate: float) -> None:
        if self.mode == "AUTO":
            raise ScpiError(-221, "HORizontal:MODE is AUTO: the sample rate follows the scale")
        length_s = self.duration_s
        nearest = min(self.records.rates, key=lambda step: max(step / rate, rate / step))
        self._rate = min(self.highest_rate, nearest)
        if self.mode == "CONStant" or self.follows == "RECORDLength":
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

    def settle(self, *, channels: int, frames: bool) -> None:
        """So many channels share the rate; records are as long as one, or a frame of FastFrame, may be."""
        self.highest_rate = self.records.rates[self.records.shared and channels > 2]
        self._rate = min(self._rate, self.highest_rate)
        short = self.records.frame_lengths if frames else ()
        longer = max(self._record_length, self.records.shortest)
        self._record_length = next((length for length in short if length >= self._record_length), longer)

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
            rates = self.records.rates[1:]
            self._rate = next((rate for rate in rates if rate * duration <= RECORD_SHOWN), rates[-1])
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
        return min(max(round(duration * self.sample_rate), self.records.shortest), self.records.longest)
