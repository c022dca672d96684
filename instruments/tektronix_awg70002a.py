"""Tektronix AWG70002A arbitrary waveform generator.

Commands: AWG70000 series programmer manual. Blocks are little-endian float32 in -1..1; marker 1 is bit 6 of a marker
byte.
"""

import math
import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from instruments.driver import Driver
from instruments.errors import InstrumentError, excerpt
from instruments.interfaces import Awg
from instruments.kept_settings import KeptSettings, Setting
from instruments.sections import AwgSection, Timeout
from instruments.units import Volts
from instruments.values import Change, Drive, Examination, Identity, Loaded, Progress, Range
from instruments.visa import VisaLink

CLOCKS = {"internal": "INTernal", "reference": "EFIXed"}
"""The argument of `CLOCk:SOURce` by the station's word."""


class Awg70002aSection(AwgSection):
    """The arbitrary waveform generator."""

    channel: Annotated[Literal[1, 2], Field(description="Channel that plays the drive.")] = 1
    clock: Annotated[
        Literal["internal", "reference"],
        Field(description='Its own, or locked to 10 MHz at Reference In: "reference".'),
    ] = "internal"
    trigger_high: Annotated[
        Volts,
        Field(ge=0.5, le=10, description="High level of the pulse at trigger input A: from 50 ohm, into an open end."),
    ] = 3.3
    trigger_impedance: Annotated[
        Literal[50, 1000], Field(description="Impedance of trigger input A, 50 or 1000 ohm.")
    ] = 50
    timeout: Timeout = 5.0


DRIVER = Driver(
    section=Awg70002aSection,
    open=lambda section, opening: Awg70002a(
        VisaLink(opening.address, name="awg", timeout_s=section.timeout, transcript=opening.transcript),
        channel=section.channel,
        clock=CLOCKS[section.clock],
        trigger=TriggerInput(section.trigger_high, section.trigger_impedance),
    ),
    identity=re.compile(r"TEKTRONIX AWG70\d{3}", re.IGNORECASE),
    sent_anew=(
        "mode",
        "sample_rate",
        "clock_source",
        "amplitude_vpp",
        "dac_bits",
        "waveform",
        "run_mode",
        "trigger_*",
        "skew_s",
        "marker_delay_s",
        "output",
    ),
)

RUN_STATE = "AWGControl:RSTate?"
RATE_TOLERANCE = 1e-6  # of the rate: by so much two windows of a drive may drift apart unseen
AMPLITUDE_TOLERANCE_V = 2e-3
MARKER_TOLERANCE_V = 0.05
TRIGGER_TOLERANCE_V = 0.05
SAMPLES_EVERY = 5
"""How often settings are asked for between two pieces of the waveform."""
SLOW_S = 30.0
"""Bound on the commands that the manual calls overlapping: clock, assignment, run and stop."""
SOURCE_OHM = 50.0
TRIGGER_STEP_DECIMALS = 1  # the level is set in steps of 0.1 V; recalled


class RunMode(StrEnum):
    """The argument of `RMODe`."""

    CONTINUOUS = "CONTinuous"
    TRIGGERED = "TRIGgered"
    TRIGGERED_CONTINUOUS = "TCONtinuous"

    @classmethod
    def of(cls, periods_per_trigger: float | None) -> "RunMode":
        """The mode that plays so many periods a trigger: None without one, infinitely many from the first one on."""
        if periods_per_trigger is None:
            return cls.CONTINUOUS
        return cls.TRIGGERED_CONTINUOUS if periods_per_trigger == math.inf else cls.TRIGGERED


@dataclass(frozen=True)
class TriggerInput:
    """Trigger input A and what is wired to it: `high_v` is that of its pulse into an open end, from 50 ohm."""

    high_v: float = 3.3
    impedance_ohm: int = 50

    @property
    def level_v(self) -> float:
        """Half of what the input gets of the pulse, V."""
        half = self.high_v * self.impedance_ohm / (self.impedance_ohm + SOURCE_OHM) / 2
        return round(half, TRIGGER_STEP_DECIMALS)


class Awg70002a(Awg):
    """One channel of an AWG70002A: 25 GS/s, 10-bit DAC shared with the markers.

    Drives shorter than the instrument's minimum are repeated, never padded with zeros: padding would leave the
    modulator idle for part of each period.
    """

    CHUNK_SAMPLES = 1_000_000
    READ_BACK_SAMPLES = 1000  # of each chunk
    SAMPLE_TOLERANCE = 2**-9  # of full scale: a step of 10 bits
    SAMPLE_RATE = Range(1.49e3, 25e9, "S/s")
    amplitude = Range(0.25, 0.5, "Vpp")  # of the direct path
    MARKER_HIGH_V, MARKER_LOW_V = 1.0, 0.0
    MARKER_1 = 0x40
    MARKER_RESOLUTION_BITS = 9  # 10 bits would take the marker's place
    CHANNELS = (1, 2)  # an AWG70001A has the first
    STOPPED, WAITING, RUNNING = "0", "1", "2"
    DIRECT = ("DIR", "DIRECT")
    self_test_s = 1200.0
    """It is the power-on test: minutes, and so long waits the vendor's own public test framework."""

    def __init__(
        self,
        link: VisaLink,
        *,
        channel: int = 1,
        clock: str = CLOCKS["internal"],
        trigger: TriggerInput = TriggerInput(),
    ) -> None:
        """Drive `channel` of the instrument behind `link`; `clock` is the argument of `CLOCk:SOURce`."""
        self._link = link
        self._channel = channel
        self._clock = clock
        self._trigger = trigger
        self._outputs: tuple[str, ...] = (f"OUTPut{channel}:STATe?", "OUTPut:OFF?")
        self._kept = KeptSettings(link)
        self._loaded: tuple[Drive, int, bool] | None = None  # with its length in memory, and whether marked once
        self._waits = False  # for triggers, and runs from each of them on for a while
        self._asked = self._compared = 0

    def identify(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

    def examine(self) -> Examination:
        """`*OPT?` and the error queue."""
        limits = {"sample rate": self.SAMPLE_RATE, "amplitude": self.amplitude}
        return Examination(self._link.query("*OPT?"), tuple(self._link.errors()), limits)

    def self_test(self) -> None:
        """`*TST?`: 0 means passed."""
        result = self._link.number("*TST?", timeout_s=self.self_test_s)
        if result != 0:
            raise InstrumentError(
                f"{self._link.name}: self-test failed with code {result:g}: see the instrument's screen"
            )

    def obstacles(self) -> tuple[str, ...]:
        """Other channels that are on: with this one's output they would be let out, with what was left there."""
        channels = self.CHANNELS[: int(self._link.number("AWGControl:CONFigure:CNUMber?"))]
        others = {number: f"OUTPut{number}:STATe?" for number in channels if number != self._channel}
        self._outputs = (f"OUTPut{self._channel}:STATe?", "OUTPut:OFF?", *others.values())
        return tuple(
            f"channel {number} is on, and would play what was left there: switch it off (OUTPut{number} OFF)"
            for number, question in others.items()
            if self._link.number(question)
        )

    def load(
        self, drive: Drive, *, periods_per_trigger: float | None = None, progress: Progress | None = None
    ) -> Loaded:
        """Upload `drive` with its marker, assign it, and return the rate and the amplitude it settled on.

        It goes in chunks, so that the longest waveform the instrument takes needs no memory here besides the drive.
        A trigger is the falling edge, since a DMD's pulse begins with the picture and ends when its mirrors rest. Where
        each starts several periods, the marker is high in the first one only: one edge, and so one frame, a trigger.

        Raises:
            OutOfRange: rate, amplitude or length outside the limits; nothing was sent.
            InstrumentError: the instrument's own error, with its text, or a setting that did not take.
        """
        mode = RunMode.of(periods_per_trigger)
        self.SAMPLE_RATE.check("drive sample rate", drive.sample_rate)
        self.amplitude.check("drive amplitude", drive.amplitude_vpp)
        shortest, longest = (int(self._link.number(f"WLISt:WAVeform:{limit}?")) for limit in ("LMINimum", "LMAXimum"))
        periods = periods_per_trigger if periods_per_trigger not in (None, math.inf) else 1
        length = drive.repeated_length(max(shortest, int(periods) * drive.samples.size))
        Range(1, longest, "samples").check("drive length", length)
        self._kept.forget()
        self._loaded, self._waits, self._asked = None, False, 0
        with self._link.checked():
            self._link.write("AWGControl:ARSettings 0")
            self._link.write(f'WLISt:WAVeform:DELete "{drive.name}"')
            self._link.errors()  # the waveform need not have been there
            self._link.write(f'WLISt:WAVeform:NEW "{drive.name}",{length}')
            self._finish()
        for first in range(0, length, self.CHUNK_SAMPLES):
            count = min(self.CHUNK_SAMPLES, length - first)
            samples, marker = drive.excerpt(first, count, marked_once=mode is RunMode.TRIGGERED)
            span = f'"{drive.name}",{first},{count},'
            with self._link.checked():
                self._link.write_block(f"WLISt:WAVeform:DATA {span}", samples.astype("<f4", copy=False))
                self._link.write_block(f"WLISt:WAVeform:MARKer:DATA {span}", marker * np.uint8(self.MARKER_1))
            begun = f'"{drive.name}",{first},{min(count, self.READ_BACK_SAMPLES)}'
            if not self._holds(begun, samples[: self.READ_BACK_SAMPLES]):  # a chunk that got lost leaves what was there
                raise InstrumentError(
                    f"{self._link.name} at {self._link.resource}: the samples of {begun} are not those that were sent: "
                    f"repeat the upload"
                )
            if progress is not None:
                progress(first + count, length)
        loaded = self._set(drive, mode)
        self._loaded = drive, length, mode is RunMode.TRIGGERED
        return loaded

    def _holds(self, span: str, samples: NDArray[np.float32]) -> bool:
        """Whether a span of a waveform in memory is what was sent."""
        found = self._link.read_block(f"WLISt:WAVeform:DATA? {span}", np.empty(samples.shape, "<f4"))
        return np.allclose(found, samples, rtol=0, atol=self.SAMPLE_TOLERANCE)

    def _holds_marker(self, span: str, marker: NDArray[np.bool_]) -> bool:
        found = self._link.read_block(f"WLISt:WAVeform:MARKer:DATA? {span}", np.empty(marker.shape, np.uint8))
        return np.array_equal(found & self.MARKER_1 != 0, marker)

    def _set(self, drive: Drive, mode: RunMode) -> Loaded:
        """Send every setting, and compare what became of it, and the way that the signal takes to its output."""
        source = f"SOURce{self._channel}"
        settings = (
            Setting("INSTrument:MODE", "AWG", name="instrument mode"),
            Setting(f"{source}:DAC:RESolution", str(self.MARKER_RESOLUTION_BITS), unit="bits", name="DAC resolution"),
            self._marker_level("OFFSet", (self.MARKER_HIGH_V + self.MARKER_LOW_V) / 2),  # each level limits the other
            self._marker_level("HIGH", self.MARKER_HIGH_V),
            self._marker_level("LOW", self.MARKER_LOW_V),
            Setting(f"{source}:MARKer1:DELay", "0", unit="s", name="marker delay"),
            Setting(f"{source}:SKEW", "0", unit="s", name="skew"),
            *(() if mode is RunMode.CONTINUOUS else self._on_trigger()),
            Setting(f"{source}:RMODe", mode),
            Setting(f"{source}:VOLTage", f"{drive.amplitude_vpp:.4f}", AMPLITUDE_TOLERANCE_V, "Vpp", "amplitude"),
            Setting("CLOCk:SOURce", self._clock, name="clock source"),
            Setting(
                "CLOCk:SRATe", f"{drive.sample_rate:.9E}", RATE_TOLERANCE * drive.sample_rate, "S/s", "sample rate"
            ),
        )
        with self._link.checked():
            for setting in settings:
                self._link.write(setting.message)
            self._link.write(f'{source}:CASSet:WAVeform "{drive.name}"')
            self._finish()
        *_, amplitude, _, rate = self._kept.confirm(settings)
        self._require_direct_path()
        self._kept.keep(
            [
                f"{source}:CASSet?",
                f'WLISt:WAVeform:LENGth? "{drive.name}"',
                f'WLISt:WAVeform:TSTamp? "{drive.name}"',
            ]
        )
        return Loaded(float(rate), float(amplitude))

    def _on_trigger(self) -> tuple[Setting, ...]:
        """Input A takes the falling edge of its pulse; the source comes first, it may choose an input of its own."""
        level = str(self._trigger.level_v)
        return (
            Setting("TRIGger:SOURce", "EXTernal", name="trigger source"),
            Setting(f"SOURce{self._channel}:TINPut", "ATRigger"),
            Setting("TRIGger:IMPedance", str(self._trigger.impedance_ohm), unit="ohm", target="ATRigger"),
            Setting("TRIGger:LEVel", level, TRIGGER_TOLERANCE_V, "V", target="ATRigger"),
            Setting("TRIGger:SLOPe", "NEGative", target="ATRigger"),
            Setting("TRIGger:MODE", "ASYNchronous", target="ATRigger"),
        )

    def _require_direct_path(self) -> None:
        """Amplitudes hold for the direct path; where there is another to choose, this one is asked for and kept.

        Without option AC or an MDC4500 the question may be refused (manual, `OUTPut[n]:PATH`): there is only one then.
        """
        path = f"OUTPut{self._channel}:PATH?"
        try:
            found, _ = self._kept.keep([path, "INSTrument:MODE?"])
        except InstrumentError:
            if not self._link.errors():
                raise
            return
        if found.upper() not in self.DIRECT:
            raise InstrumentError(
                f"{self._link.name}: {path.rstrip('?')} is {excerpt(found)}: amplitudes hold for the direct path only: "
                f"set it to DIRect"
            )

    def _marker_level(self, which: str, level_v: float) -> Setting:
        command = f"SOURce{self._channel}:MARKer1:VOLTage:{which}"
        return Setting(command, str(level_v), MARKER_TOLERANCE_V, "V", f"marker {which.lower()} level")

    def changes(self) -> tuple[Change, ...]:
        """All settings that were sent and the time of the waveform's last change, in one question.

        That time has seconds; and in case it misses a change, a piece of the waveform is read now and then.
        """
        if found := self._kept.changes():
            return found
        if self._waits and self._link.query(RUN_STATE) == self.STOPPED:
            return (Change(RUN_STATE.removesuffix("?"), self.WAITING, self.STOPPED),)
        self._asked += 1
        if self._loaded is None or self._asked % SAMPLES_EVERY != 1:
            return ()
        drive, length, marked_once = self._loaded
        count = min(length, self.READ_BACK_SAMPLES)
        first = self._compared % (length - count + 1)
        self._compared += count
        samples, marker = drive.excerpt(first, count, marked_once=marked_once)
        span = f'"{drive.name}",{first},{count}'
        if not (self._holds(span, samples) and self._holds_marker(span, marker)):
            return (Change(f"waveform {span}", "the samples that were sent", "others"),)
        return ()

    def play(self) -> None:
        """Run, then let it out: `AWGControl:RUN`, all-outputs-off released, output on."""
        for obstacle in self.obstacles():
            raise InstrumentError(f"{self._link.name}: {obstacle}")
        with self._link.checked():
            self._link.write("AWGControl:RUN")
            self._finish()
            self._link.write("OUTPut:OFF 0")
            self._link.write(f"OUTPut{self._channel}:STATe 1")
        state, *_ = self._kept.keep([RUN_STATE, *self._outputs])
        if state not in (self.WAITING, self.RUNNING):
            raise InstrumentError(
                f"{self._link.name}: does not run ({RUN_STATE} answers {excerpt(state)}): load a drive first"
            )
        self._waits = state == self.WAITING
        if self._waits:
            self._kept.forget([RUN_STATE])

    def stop(self) -> None:
        """All outputs off at once, then stop."""
        self._kept.forget([RUN_STATE, *self._outputs])
        self._waits = False
        with self._link.checked():
            self._link.write("OUTPut:OFF 1")
            self._link.write(f"OUTPut{self._channel}:STATe 0")
            self._link.write("AWGControl:STOP")
            self._finish()

    def settings(self) -> dict[str, str | float]:
        """Mode, clock, amplitude, resolution, assigned waveform, run mode, trigger input and output."""
        source = f"SOURce{self._channel}"
        return {
            "mode": self._link.query("INSTrument:MODE?"),
            "sample_rate": self._link.number("CLOCk:SRATe?"),
            "clock_source": self._link.query("CLOCk:SOURce?"),
            "clock_phase_deg": self._link.number("CLOCk:PHASe:ADJust:DEGRees?"),
            "jitter_reduction": int(self._link.number("CLOCk:JITTer?")),
            "amplitude_vpp": self._link.number(f"{source}:VOLTage?"),
            "dac_bits": int(self._link.number(f"{source}:DAC:RESolution?")),
            "waveform": self._link.query(f"{source}:WAVeform?").strip('"'),
            "run_mode": self._link.query(f"{source}:RMODe?"),
            "trigger_input": self._link.query(f"{source}:TINPut?"),
            "trigger_source": self._link.query("TRIGger:SOURce?"),
            "trigger_impedance_ohm": self._link.number("TRIGger:IMPedance? ATRigger"),
            "trigger_level_v": self._link.number("TRIGger:LEVel? ATRigger"),
            "trigger_slope": self._link.query("TRIGger:SLOPe? ATRigger"),
            "trigger_mode": self._link.query("TRIGger:MODE? ATRigger"),
            "skew_s": self._link.number(f"{source}:SKEW?"),
            "marker_delay_s": self._link.number(f"{source}:MARKer1:DELay?"),
            "output": int(self._link.number(f"OUTPut{self._channel}?")),
        }

    def make_safe(self) -> None:
        """Output off, stopped, sent even to an instrument that no longer answers; earlier errors do not count."""
        self._link.write("OUTPut:OFF 1")
        self._link.errors()
        self.stop()

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _finish(self) -> None:
        self._link.query("*OPC?", timeout_s=SLOW_S)
