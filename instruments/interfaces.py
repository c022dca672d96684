"""The instruments a protocol may speak to: five that every bench has, three that some have.

Protocols are written against these classes and nothing else, so the same protocol runs on any bench whose drivers
implement them. Every driver is reached through the entry-point group `labctl.instruments`.
"""

from abc import ABC, ABCMeta, abstractmethod
from collections.abc import Iterable, Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from instruments.values import (
    Answer,
    Change,
    Drive,
    EdgeTrigger,
    Examination,
    Frames,
    Identity,
    Loaded,
    Progress,
    Range,
    Scaling,
    Timebase,
    Vertical,
)

BYPASS_PORT = 0
"""The collection fibre itself: patching a channel to it takes the light before the chip."""


class Instrument(ABC):
    """What every instrument of the bench can be asked."""

    self_test_s: float = 60.0
    """How long `self_test` takes at most; one of minutes is run only where somebody asks for it."""

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

    def examine(self) -> Examination:
        """Ask for options and errors, and empty the error queue; an instrument that has neither is asked nothing.

        Raises:
            LinkError: it does not answer.
        """
        return Examination()

    def obstacles(self) -> tuple[str, ...]:
        """What an earlier user has left that no run may change, and what to do about it: asked before there is light.

        Raises:
            LinkError: it does not answer.
        """
        return ()

    @abstractmethod
    def settings(self) -> dict[str, str | float]:
        """What the instrument reports of its own state, for the run's manifest."""

    def changes(self) -> tuple[Change, ...]:
        """What is no longer as this program set it: somebody else did, by another program or at the front panel.

        Raises:
            LinkError: it does not answer.
        """
        return ()

    def answers(self) -> tuple[Answer, ...]:
        """What the instrument does where its documents leave a question open, measured on it alone and in the dark.

        Raises:
            InstrumentError: it refuses what it is asked for.
        """
        return ()

    @abstractmethod
    def make_safe(self) -> None:
        """Bring this instrument to its part of the safe state; may be called at any time, any number of times."""

    @abstractmethod
    def close(self) -> None:
        """Release the connection. The state of the instrument stays as it is."""


class Awg(Instrument):
    """Arbitrary waveform generator: plays a drive for ever, with a marker at the start of each period."""

    amplitude: Range
    """The amplitudes it can be set to, V peak to peak."""

    @abstractmethod
    def load(
        self, drive: Drive, *, periods_per_trigger: float | None = None, progress: Progress | None = None
    ) -> Loaded:
        """Upload `drive`, assign it to the channel and return what the instrument settled on.

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

    sample_rate: Range
    """The rates it samples at, S/s."""

    channels: tuple[int, ...]
    """The configured channels, in the order of the frames."""

    bandwidth_hz: float | None = None
    """What its inputs let through once it is configured; None where the driver does not know."""

    code_type: Literal["int8", "int16"] = "int8"
    """Type of the codes of a single trigger; those of means are always int16."""

    def require_rate(self, sample_rate: float) -> None:
        """Refuse what needs a rate, S/s, that it does not sample at: no setting of that would help.

        Raises:
            OutOfRange: it does not.
        """
        self.sample_rate.check("scope sample rate", sample_rate, "use one that samples so fast, such as the DPO72504DX")

    @abstractmethod
    def configure(self, timebase: Timebase, trigger: EdgeTrigger, channels: tuple[int, ...], averages: int) -> None:
        """Set everything but the vertical ranges.

        With `averages` > 1 a frame is the mean of that many triggers, each with the same weight, in int16 codes: what
        an instrument calls an average may be a running one, in which the last triggers weigh more.

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
            NoTrigger: no trigger came in time.
        """

    @abstractmethod
    def triggered(self) -> bool:
        """Whether a trigger that repeats quickly comes: one acquisition is started, and stopped if it stays without."""

    @abstractmethod
    def read(self) -> Frames:
        """Transfer the completed acquisition, a burst of one; channels in the configured order."""

    @abstractmethod
    def most_frames(self) -> int:
        """How many frames of the configured length one burst may have."""

    @abstractmethod
    def arm_burst(self, frames: int) -> None:
        """Start an acquisition of one frame at each of the next `frames` triggers; returns when ready for them."""

    @abstractmethod
    def read_burst(self) -> Frames:
        """Wait for the last frame of the burst, then transfer it, one block a channel.

        Raises:
            NoTrigger: frames are missing, and no more come.
        """


class TunableLaser(Instrument):
    """The light source. It starts dark and is dark unless it is switched on."""

    switches_itself: bool
    """Whether software can end emission; if not, a person or an interlock must."""

    @abstractmethod
    def tune(self, wavelength_nm: float) -> float:
        """Set the wavelength and return, when it has settled, the one it settled on, nm.

        Raises:
            OutOfRange: outside the tuning range.
        """

    @abstractmethod
    def set_power(self, power_w: float) -> float:
        """Set the optical output power and return the one it settled on, W.

        Raises:
            OutOfRange: outside the laser's range.
        """

    @abstractmethod
    def power(self) -> float:
        """The optical output power that the laser says it gives, W."""

    @abstractmethod
    def emit(self) -> None:
        """Switch emission on and return when the light is there."""

    @abstractmethod
    def require_emission(self) -> None:
        """Check that the light that was switched on is still there, as far as the laser knows.

        Raises:
            LightLost: it went out by itself.
        """

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

    picture_period_s: float
    """The time between pictures that are played as fast as its mirrors follow, s."""

    pulse_s: float
    """How long the pulse of a picture lasts where nobody asks for another length, s."""

    settling_s: float
    """How long after their command mirrors are taken to move at most."""

    @abstractmethod
    def capacity(self) -> int:
        """How many pictures its memory holds."""

    @abstractmethod
    def load(self, mirrors: Iterable[NDArray[np.uint8]], count: int, *, progress: Progress | None = None) -> None:
        """Put `count` pictures into its memory, in the place of those there.

        mirrors: blocks of packed bits, shape (n, rows, columns / 8), `count` pictures together. `progress` is called
        after each block.

        Raises:
            OutOfRange: more than its capacity.
        """

    @abstractmethod
    def hold(self) -> None:
        """Keep the picture that is shown and send no pulses: a picture shown for long is refreshed, with a pulse."""

    @abstractmethod
    def play(self, first: int, count: int, period_s: float, *, rounds: int = 1, pulse_s: float | None = None) -> None:
        """Show `count` pictures from the `first` on, one every `period_s`, so many `rounds`; returns at once.

        Each picture comes with a pulse that begins with it and lasts `pulse_s`, or that of the DMD. Both times are
        rounded to whole microseconds.

        Raises:
            OutOfRange: faster than the mirrors can follow.
        """


class PatchPanel(Instrument):
    """Connects waveguides of the chip to channels of the oscilloscope."""

    ports: tuple[int, ...]
    """The ports that are wired to the panel, `BYPASS_PORT` among them where the fibre before the chip is."""

    def asks(self, patching: Mapping[int, int]) -> bool:
        """Whether `connect` would ask a person to move fibres: no light is to be on then."""
        return False

    @abstractmethod
    def connect(self, patching: Mapping[int, int]) -> None:
        """Connect channel -> port for every item of `patching`, and nothing else.

        Raises:
            OutOfRange: a port that is not wired.
        """


class PowerMeter(Instrument):
    """An optical power meter behind a tap of the laser's output: it knows better than the laser what leaves it."""

    @abstractmethod
    def set_wavelength(self, wavelength_nm: float) -> float:
        """Correct for the sensor's response at this wavelength, and return the one it settled on, nm.

        Raises:
            OutOfRange: outside the sensor's range.
        """

    @abstractmethod
    def power(self) -> float:
        """Measure the optical power at the sensor, W.

        Raises:
            InstrumentError: it cannot be measured, for instance because there is more than the sensor measures.
        """


class Amplifier(Instrument):
    """An optical amplifier between modulator and fibre. It starts off and is off unless it is switched on."""

    @abstractmethod
    def set_power(self, power_w: float) -> float:
        """Set the output power, without switching it on, and return the one it settled on, W.

        Raises:
            OutOfRange: outside the amplifier's range.
        """

    @abstractmethod
    def power(self) -> float:
        """The output power that the amplifier says it gives, W."""

    @abstractmethod
    def switch_on(self) -> None:
        """Switch the pump on, confirmed. Its input must be lit: what is stored without comes out in one pulse."""

    @abstractmethod
    def require_on(self) -> None:
        """Check that the pump, which was switched on, still is.

        Raises:
            LightLost: it went off by itself, or somebody switched it off.
        """

    @abstractmethod
    def switch_off(self) -> None:
        """Switch the pump off, confirmed; this is the amplifier's safe state."""


class Attenuator(Instrument):
    """A variable attenuator behind the amplifier, where there is one, and before the fibre."""

    @abstractmethod
    def open(self, attenuation_db: float) -> float:
        """Let light through, attenuated by so many dB, and return the attenuation it settled on.

        Raises:
            OutOfRange: outside the attenuator's range.
        """

    @abstractmethod
    def require_open(self) -> None:
        """Check that it still lets light through, as it was told to.

        Raises:
            LightLost: it is shut.
        """

    @abstractmethod
    def shut(self) -> None:
        """Let nothing through, or as little as it can; confirmed. This is the attenuator's safe state."""


INTERFACES: Mapping[str, ABCMeta] = {
    "awg": Awg,
    "scope": Oscilloscope,
    "laser": TunableLaser,
    "dmd": Dmd,
    "patch_panel": PatchPanel,
    "power_meter": PowerMeter,
    "amplifier": Amplifier,
    "attenuator": Attenuator,
}
"""What the bench asks of an instrument, by its role; of one with another role, what it asks of every `Instrument`."""
