"""The five instruments a protocol may speak to, and the values that pass between them.

Protocols are written against these classes and nothing else, so the same protocol runs on any bench whose drivers
implement them. Every driver is reached through the entry-point group `labctl.instruments`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Codes = NDArray[np.int8] | NDArray[np.int16]

Progress = Callable[[int, int], None]
"""Called with how much is done so far, and how much there is in all."""

BYPASS_PORT = 0
"""The collection fibre itself: patching a channel to it takes the light before the chip."""


class InstrumentError(Exception):
    """An instrument refused, failed or did not answer; the message is one line that says what, where and what to do."""


class LinkError(InstrumentError):
    """The instrument cannot be reached, or did not answer in time."""


class OutOfRange(InstrumentError):
    """A value lies outside what the instrument or the station allows; nothing was sent."""


class NotConfigured(InstrumentError):
    """The driver lacks something only the operator can supply, such as a command of an undocumented laser."""


@dataclass(frozen=True)
class Identity:
    """Who an instrument says it is: the four fields of `*IDN?` (IEEE 488.2, 10.14)."""

    manufacturer: str
    model: str
    serial: str
    firmware: str

    @classmethod
    def parse(cls, reply: str) -> "Identity":
        """Split a `*IDN?` reply; missing fields become empty strings."""
        fields = [field.strip() for field in reply.split(",", 3)]
        return cls(*(fields + [""] * (4 - len(fields))))


@dataclass(frozen=True)
class Range:
    """A closed interval of allowed values with its unit."""

    low: float
    high: float
    unit: str

    def check(self, name: str, value: float) -> float:
        """Return `value` if it lies inside.

        Raises:
            OutOfRange: it does not, or is not a number.
        """
        if not self.low <= value <= self.high:
            raise OutOfRange(
                f"{name} = {value:g} {self.unit} is outside {self.low:g}..{self.high:g} {self.unit}: "
                f"choose a value inside"
            )
        return value


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
        """Samples of the fewest whole periods that make `minimum`; padding would leave the modulator idle between."""
        return -(-minimum // self.samples.size) * self.samples.size

    def excerpt(
        self, first: int, count: int, *, marked_once: bool = False
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """`count` samples and their marker from place `first` on, repeated as far as they go; shapes (count,).

        With `marked_once` the marker is high in the first period only.
        """
        period, high = self.samples.size, max(1, self.samples.size // 4)
        places = np.arange(first, first + count)
        start = first % period
        inside = start + count <= period
        samples = self.samples[start : start + count] if inside else self.samples.take(places, mode="wrap")
        return samples, (places if marked_once else places % period) < high


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
    """One frame per channel, for one trigger.

    codes: (channels, samples), int8, or int16 when averaged. trigger_offset_s: (channels,), time from the trigger to
    the sample grid. clipped: (channels,), whether a sample reached the end of the range.
    """

    codes: Codes
    trigger_offset_s: NDArray[np.float64]
    clipped: NDArray[np.bool_]


@dataclass(frozen=True)
class Burst:
    """One frame per channel for each of many triggers.

    codes: (triggers, channels, samples), int8, or int16 for averages. trigger_offset_s: (triggers, channels). time_s:
    (triggers,), when each trigger came, on the oscilloscope's clock, from any start. clipped: (triggers, channels).
    """

    codes: Codes
    trigger_offset_s: NDArray[np.float64]
    time_s: NDArray[np.float64]
    clipped: NDArray[np.bool_]


class Instrument(ABC):
    """What every instrument of the bench can be asked."""

    @abstractmethod
    def identify(self) -> Identity:
        """Ask the instrument who it is.

        Raises:
            LinkError: it does not answer.
        """

    @abstractmethod
    def self_test(self) -> None:
        """Let the instrument test itself, without light.

        Raises:
            InstrumentError: it reports a fault.
        """

    @abstractmethod
    def settings(self) -> dict[str, str | float]:
        """What the instrument reports of its own state, for the run's manifest."""

    @abstractmethod
    def make_safe(self) -> None:
        """Bring this instrument to its part of the safe state; may be called at any time, any number of times."""

    @abstractmethod
    def close(self) -> None:
        """Release the connection. The state of the instrument stays as it is."""


class Awg(Instrument):
    """Arbitrary waveform generator: plays a drive for ever, with a marker at the start of each period."""

    @abstractmethod
    def load(
        self, drive: Drive, *, periods_per_trigger: float | None = None, progress: Progress | None = None
    ) -> float:
        """Upload `drive`, assign it to the channel and return the sample rate the instrument settled on.

        It plays for ever; or so many periods at each falling edge of the trigger input, with one marker at their start;
        or, with infinitely many, for ever from the first such edge on.
        `progress` is called as the upload proceeds.

        Raises:
            OutOfRange: length, rate or amplitude outside the limits.
            InstrumentError: the instrument's own error, with its text.
        """

    @abstractmethod
    def play(self) -> None:
        """Start the loaded drive and switch the output on."""

    @abstractmethod
    def stop(self) -> None:
        """Switch the output off and stop; this is the AWG's safe state."""


class Oscilloscope(Instrument):
    """Digitises channels after a trigger."""

    vertical_scale: Range
    """The settable ranges, V per division."""

    channels: tuple[int, ...]
    """The configured channels, in the order of the frames."""

    @abstractmethod
    def configure(self, timebase: Timebase, trigger: EdgeTrigger, channels: tuple[int, ...], averages: int) -> None:
        """Set everything but the vertical ranges; `averages` > 1 gives int16 codes, the mean of that many triggers.

        Raises:
            OutOfRange: a setting outside the limits.
            InstrumentError: the instrument's own error, or a setting that did not take.
        """

    @abstractmethod
    def set_vertical(self, channel: int, vertical: Vertical) -> Vertical:
        """Set the range of one channel, for the acquisitions to come, and return the one it settled on."""

    @abstractmethod
    def scalings(self) -> tuple[Scaling, ...]:
        """What the codes of the last acquisition mean, channels in the configured order."""

    @abstractmethod
    def vertical_for(self, scaling: Scaling) -> Vertical:
        """The range in which codes of the configured acquisition mean `scaling`: the inverse of `scalings`."""

    @abstractmethod
    def arm(self) -> None:
        """Start a single acquisition; it completes at the next trigger (or after `averages` of them)."""

    @abstractmethod
    def wait(self) -> None:
        """Return when the acquisition has completed.

        Raises:
            LinkError: no trigger came in time.
        """

    @abstractmethod
    def read(self) -> Frames:
        """Transfer the completed acquisition, channels in the configured order."""

    @abstractmethod
    def most_frames(self) -> int:
        """How many frames of the configured length one burst may have."""

    @abstractmethod
    def arm_burst(self, frames: int) -> None:
        """Start an acquisition of one frame at each of the next `frames` triggers; returns when ready for them."""

    @abstractmethod
    def read_burst(self) -> Burst:
        """Transfer the completed burst, one block a channel.

        Raises:
            LinkError: not all triggers came in time.
        """

    def capture(self) -> Frames:
        """Arm, wait for the trigger, read."""
        self.arm()
        self.wait()
        return self.read()


class TunableLaser(Instrument):
    """The light source. It starts dark and is dark whenever it is not told to emit."""

    switches_itself: bool
    """Whether software can end emission; if not, a person or an interlock must."""

    @abstractmethod
    def tune(self, wavelength_nm: float) -> None:
        """Set the wavelength and return when it has settled.

        Raises:
            OutOfRange: outside the tuning range.
        """

    @abstractmethod
    def set_power(self, power_w: float) -> None:
        """Set the optical output power.

        Raises:
            OutOfRange: outside the laser's range.
        """

    @abstractmethod
    def emit(self) -> None:
        """Switch emission on and return when the light is there."""

    @abstractmethod
    def darken(self) -> None:
        """Switch emission off; this is the laser's safe state."""


class Dmd(Instrument):
    """Digital micromirror device."""

    shape: tuple[int, int]
    """Rows and columns of mirrors."""

    @abstractmethod
    def show(self, mirrors: NDArray[np.uint8]) -> None:
        """Show one binary pattern and return when the mirrors rest.

        mirrors: packed bits, shape (rows, columns / 8), most significant bit leftmost, 1 = towards the collection
        fibre.
        """

    @abstractmethod
    def blank(self) -> None:
        """Turn every mirror away from the collection fibre; this is the DMD's safe state."""


class BurstDmd(Dmd):
    """A DMD that plays pictures from its own memory and pulses its synchronisation output at each."""

    @abstractmethod
    def capacity(self) -> int:
        """How many pictures its memory holds."""

    @abstractmethod
    def load(self, mirrors: Iterable[NDArray[np.uint8]], count: int) -> None:
        """Put `count` pictures into its memory, in the place of those there.

        mirrors: blocks of packed bits, shape (n, rows, columns / 8), `count` pictures together.

        Raises:
            OutOfRange: more than its capacity.
        """

    @abstractmethod
    def hold(self) -> None:
        """Keep the picture that is shown and send no pulses: a picture shown for long is refreshed, with a pulse."""

    @abstractmethod
    def play(self, first: int, count: int, period_s: float, *, pulse_s: float | None = None) -> None:
        """Show `count` pictures from the `first` on, once, one every `period_s`; returns at once.

        Each picture comes with a pulse that begins with it and lasts `pulse_s`, or until its mirrors rest.

        Raises:
            OutOfRange: faster than the mirrors can follow.
        """


class PatchPanel(Instrument):
    """Connects waveguides of the chip to channels of the oscilloscope."""

    ports: tuple[int, ...]
    """The ports that are wired to the panel, `BYPASS_PORT` among them where the fibre before the chip is."""

    @abstractmethod
    def connect(self, patching: Mapping[int, int]) -> None:
        """Connect channel -> port for every item of `patching`, and nothing else.

        Raises:
            OutOfRange: a port that is not wired.
        """
