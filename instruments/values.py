"""What passes between a protocol and an instrument: settings on the way there, traces on the way back."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from instruments.errors import OutOfRange

Codes = NDArray[np.int8] | NDArray[np.int16]

Progress = Callable[[int, int], None]
"""Called with how much is done so far, and how much there is in all."""
Uploading = Callable[[str, int, int], None]
"""Called with what is uploaded, how much of it is there so far, and how much there is in all."""


@dataclass(frozen=True)
class Identity:
    """Who an instrument says it is: the four fields of `*IDN?` (IEEE 488.2, 10.14)."""

    manufacturer: str
    model: str
    serial: str
    firmware: str

    @classmethod
    def parse(cls, reply: str) -> "Identity":
        """Split a `*IDN?` reply; missing fields become empty strings.

        Example:
            >>> from instruments.values import Identity
            >>> Identity.parse("ALNAIR LABS, TLG-220")
            Identity(manufacturer='ALNAIR LABS', model='TLG-220', serial='', firmware='')
        """
        fields = [field.strip() for field in reply.split(",", 3)]
        return cls(*(fields + [""] * (4 - len(fields))))


@dataclass(frozen=True)
class Range:
    """A closed interval of allowed values with its unit."""

    low: float
    high: float
    unit: str

    def check(self, name: str, value: float, remedy: str = "choose a value inside") -> float:
        """Return `value` if it lies inside; `remedy` says what to do where it does not.

        Raises:
            OutOfRange: it does not, or is not a number.
        """
        if not self.low <= value <= self.high:
            raise OutOfRange(
                f"{name} = {value:g} {self.unit} is outside {self.low:g}..{self.high:g} {self.unit}: {remedy}"
            )
        return value


@dataclass(frozen=True)
class Examination:
    """What an instrument reports of its state: installed options, and the error queue as it was.

    `limits` are those that its driver keeps it in.
    """

    options: str = ""
    errors: tuple[str, ...] = ()
    limits: Mapping[str, Range] = field(default_factory=dict)


@dataclass(frozen=True)
class Change:
    """A setting that is not what it was set to: its name at the instrument, what it was and what it is."""

    setting: str
    then: str
    now: str


@dataclass(frozen=True)
class Answer:
    """What was measured where documents leave a question open.

    question: what nobody can know without this bench. assumed: what labctl takes for granted. found: what the bench
    says. agrees: whether the assumption holds here.
    """

    question: str
    assumed: str
    found: str
    agrees: bool


@dataclass(frozen=True)
class Drive:
    """The phase sequence the AWG plays for ever: `samples` in -1..1, shape (n,), float32, one period."""

    name: str
    samples: NDArray[np.float32]
    sample_rate: float
    amplitude_vpp: float

    @property
    def period_s(self) -> float:
        """Time after which the drive repeats."""
        return self.samples.size / self.sample_rate

    @property
    def marker(self) -> NDArray[np.bool_]:
        """High during the first quarter of the period, shape (n,): one rising edge at its start, to trigger on."""
        return self.excerpt(0, self.samples.size)[1]

    def repeated_length(self, minimum: int) -> int:
        """Samples of the fewest whole periods that make `minimum`; padding would leave the modulator idle between.

        Example:
            >>> import numpy as np
            >>> from instruments.values import Drive
            >>> ramp = Drive("ramp", np.linspace(-1, 1, 1000, dtype=np.float32), sample_rate=25e9, amplitude_vpp=0.5)
            >>> ramp.period_s, ramp.repeated_length(2400)
            (4e-08, 3000)
        """
        return -(-minimum // self.samples.size) * self.samples.size

    def excerpt(
        self, first: int, count: int, *, marked_once: bool = False
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """`count` samples and their marker from place `first` on, repeated as far as they go; shapes (count,).

        With `marked_once` the marker is high in the first period only.

        Example:
            >>> import numpy as np
            >>> from instruments.values import Drive
            >>> steps = Drive("steps", np.array([-1, 0, 1, 0.5], np.float32), sample_rate=25e9, amplitude_vpp=0.5)
            >>> samples, marker = steps.excerpt(2, 5)
            >>> samples.tolist(), marker.tolist()
            ([1.0, 0.5, -1.0, 0.0, 1.0], [False, False, True, False, False])
        """
        period, high = self.samples.size, max(1, self.samples.size // 4)
        places = np.arange(first, first + count)
        start = first % period
        inside = start + count <= period
        samples = self.samples[start : start + count] if inside else self.samples.take(places, mode="wrap")
        return samples, (places if marked_once else places % period) < high


@dataclass(frozen=True)
class Loaded:
    """What an AWG made of a drive, by its own answers: the sample rate (S/s) and the amplitude it settled on."""

    sample_rate: float
    amplitude_vpp: float


@dataclass(frozen=True)
class Timebase:
    """How a trace is sampled: `samples` points at `sample_rate` (S/s), the first one `delay_s` after the trigger."""

    sample_rate: float
    samples: int
    delay_s: float = 0.0


@dataclass(frozen=True)
class Vertical:
    """The vertical range of a channel: V per division and the voltage at mid-screen."""

    scale_v_per_div: float
    offset_v: float


@dataclass(frozen=True)
class Scaling:
    """What a code of a channel means: volts = `scale_v` * code + `offset_v`, as the instrument itself reports it."""

    scale_v: float
    offset_v: float


@dataclass(frozen=True)
class EdgeTrigger:
    """An edge on the auxiliary input ("AUX") or on a channel (1..4) at `level_v`."""

    source: Literal["AUX"] | int
    level_v: float
    rising: bool = True


@dataclass(frozen=True)
class Frames:
    """What an acquisition gave: for each trigger one frame of every channel. A single shot is a burst of one.

    codes: (triggers, channels, samples), int8, or int16 for averages. trigger_offset_s: (triggers, channels), time from
    the trigger to the sample grid. time_s: (triggers,), when each trigger came, from any start. clipped: (triggers,
    channels), whether a sample reached the end of the range. The arrays belong to whoever gets them.
    """

    codes: Codes
    trigger_offset_s: NDArray[np.float64]
    time_s: NDArray[np.float64]
    clipped: NDArray[np.bool_]

    def __len__(self) -> int:
        """Number of triggers."""
        return len(self.codes)

    def part(self, start: int, stop: int) -> "Frames":
        """The frames of the triggers `start` to `stop`, without copying them."""
        rows = slice(start, stop)
        return Frames(self.codes[rows], self.trigger_offset_s[rows], self.time_s[rows], self.clipped[rows])

    @classmethod
    def joined(cls, parts: "Sequence[Frames]") -> "Frames":
        """Several acquisitions one after the other."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            np.concatenate([part.codes for part in parts]),
            np.concatenate([part.trigger_offset_s for part in parts]),
            np.concatenate([part.time_s for part in parts]),
            np.concatenate([part.clipped for part in parts]),
        )
