"""Tektronix DPO72504DX digital phosphor oscilloscope.

Commands: DPO/DSA/MSO70000 series programmer manual. Codes leave the instrument as it digitised them; they become volts
only in analysis: volts = (code - YOFf) * YMUlt + YZEro.
"""

import re
import time
from collections.abc import Callable, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.driver import Driver
from instruments.errors import InstrumentError, LinkError, NoTrigger, SettingChanged, excerpt
from instruments.interfaces import Oscilloscope
from instruments.kept_settings import KeptSettings, Setting
from instruments.sections import ScopeSection, Timeout
from instruments.values import (
    Change,
    EdgeTrigger,
    Examination,
    Frames,
    Identity,
    Range,
    Scaling,
    Timebase,
    Vertical,
)
from instruments.visa import NoAnswer, VisaLink, number_in, tektronix_event_queue


class Dpo72504dxSection(ScopeSection):
    """The oscilloscope and what triggers it."""

    timeout: Timeout = 10.0


DRIVER = Driver(
    section=Dpo72504dxSection,
    open=lambda section, opening: Dpo72504dx(
        VisaLink(
            opening.address,
            name="scope",
            timeout_s=section.timeout,
            transcript=opening.transcript,
            error_queue=tektronix_event_queue,
        )
    ),
    identity=re.compile(r"TEKTRONIX (DPO|DSA|MSO)7\d{4}", re.IGNORECASE),
    sent_anew=(
        "sample_rate",
        "record_length",
        "acquisition_mode",
        "trigger_*",
        "ch?_*_v*",
        "ch?_position_div",
        "ch?_bandwidth_hz",
        "ch?_coupling",
        "ch?_inverted",
        "ch?_deskew_s",
        "ch?_external_attenuation",
    ),
)

SELF_TEST_S = 60.0
TRIGGER_WAIT_S = 10.0
BURST_WAIT_S = 60.0
STALLED_S = 3.0
"""A burst that got no frame for so long gets no more: its triggers are microseconds apart."""
POLL_S = 10e-3
TRIGGER_REMEDY = "check that the AWG plays, the trigger's cable and its level"
RATE_TOLERANCE = 1e-6
LEVEL_TOLERANCE_V = 0.02
SCALE_TOLERANCE = 0.02
OFFSET_TOLERANCE_DIV = 0.1
CODES_PER_DIVISION = 25
FULL_BANDWIDTH_HZ = 25e9
LARGEST_OFFSET = 2.0
"""Samples that the trigger may lie beside the sample grid: one, and what its position is uncertain by."""
ELSEWHERE = "its settings were changed from elsewhere, leave it to this program"
PREAMBLE = tuple(f"WFMOutpre:{field}?" for field in ("YMUlt", "YZEro", "YOFf", "XZEro"))
REPORTED = {
    "sample_rate": "HORizontal:MODE:SAMPLERate?",
    "record_length": "HORizontal:MODE:RECOrdlength?",
    "acquisition_mode": "ACQuire:MODe?",
    "trigger_source": "TRIGger:A:EDGE:SOUrce?",
    "trigger_coupling": "TRIGger:A:EDGE:COUPling?",
    "trigger_holdoff": "TRIGger:A:HOLDoff:BY?",
}
"""What the manifest has of the instrument."""
WORDS = ("mode", "source", "coupling", "holdoff")
"""What their names end in where the answer is no number."""
REPORTED_OF_CHANNEL = {
    "scale_v_per_div": "SCAle?",
    "offset_v": "OFFSet?",
    "position_div": "POSition?",
    "bandwidth_hz": "BANdwidth?",
    "coupling": "COUPling?",
    "inverted": "INVert?",
    "deskew_s": "DESKew?",
    "external_attenuation": "PROBEFunc:EXTAtten?",
    "termination_ohm": "TERmination?",
}
"""What the manifest has of each of its inputs."""


class Dpo72504dx(Oscilloscope):
    """Four channels of 8 bits, read one source at a time as signed little-endian integers."""

    SAMPLE_RATE = Range(1.0, 100e9, "S/s")
    AVERAGES = Range(1, 10240, "triggers")
    vertical_scale = Range(6.25e-3, 0.6, "V/div")
    SHORTEST_RECORD = 50  # points; of a shorter timebase only the first points are transferred
    CLIP_LOW, CLIP_HIGH = -127, 126
    INPUTS = (1, 2, 3, 4)

    def __init__(self, link: VisaLink) -> None:
        """Drive the instrument behind `link`."""
        self._link = link
        self.channels = ()
        self._kept = KeptSettings(link)
        self._timebase = Timebase(1.0, 0)
        self._verticals: dict[int, Vertical] = {}
        self._scalings: dict[int, Scaling] = {}
        self._described: dict[int, tuple[str, list[str]]] = {}  # source and preamble that were found right
        self._frames = 0
        self._dtype: np.dtype[np.int8] | np.dtype[np.int16] = np.dtype(np.int8)

    def identify(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

    def examine(self) -> Examination:
        """`*OPT?` and the event queue."""
        limits = {"sample rate": self.SAMPLE_RATE, "vertical scale": self.vertical_scale, "averages": self.AVERAGES}
        return Examination(self._link.query("*OPT?"), tuple(self._link.errors()), limits)

    def self_test(self) -> None:
        """`*TST?`: 0 means passed."""
        result = self._link.number("*TST?", timeout_s=SELF_TEST_S)
        if result != 0:
            raise InstrumentError(
                f"{self._link.name}: self-test failed with code {result:g}: see the instrument's screen"
            )

    def configure(self, timebase: Timebase, trigger: EdgeTrigger, channels: tuple[int, ...], averages: int) -> None:
        """Manual horizontal mode, edge trigger in normal mode, the channels, sample or average acquisition.

        Whatever else changes volts or time is set as well, as a former user may have left it otherwise: polarity,
        coupling, bandwidth, deskew and attenuation of the channels, coupling and holdoff of the trigger. The front
        panel is locked. `DATa:STOP` is set with every record length: the instrument does not move it by itself.
        """
        record_length = max(timebase.samples, self.SHORTEST_RECORD)
        self.SAMPLE_RATE.check("scope sample rate", timebase.sample_rate)
        self.AVERAGES.check("averages", averages)
        settings = (
            Setting("HEADer", "OFF"),
            Setting("VERBose", "ON"),
            Setting("FASTAcq:STATE", "OFF"),
            Setting("HORizontal:FASTframe:STATE", "OFF"),
            Setting("ACQuire:SAMPlingmode", "RT"),
            Setting("ACQuire:STOPAfter", "SEQuence"),
            *self._acquisition(averages),
            *(Setting(f"SELect:CH{channel}", str(int(channel in channels))) for channel in self.INPUTS),
            Setting("HORizontal:MODE", "MANual"),
            Setting(
                "HORizontal:MODE:SAMPLERate",
                f"{timebase.sample_rate:.6E}",
                RATE_TOLERANCE * timebase.sample_rate,
                "S/s",
            ),
            Setting("HORizontal:MODE:RECOrdlength", str(record_length), unit="samples"),
            *self._delay(timebase),
            *(setting for channel in channels for setting in self._input(channel)),
            *self._trigger(trigger),
            Setting("DATa:STARt", "1"),
            Setting("DATa:STOP", str(timebase.samples)),
            Setting("DATa:ENCdg", "SRIbinary"),
            Setting("WFMOutpre:BYT_Nr", "1" if averages == 1 else "2"),
        )
        self._kept.forget()
        self._described.clear()
        for message in ("ACQuire:STATE STOP", "*CLS", "LOCk ALL"):
            self._link.write(message)
        self._kept.set(settings)
        self.channels = channels
        self._timebase = timebase
        self._frames = 0
        self._dtype = np.dtype("<i1") if averages == 1 else np.dtype("<i2")

    def set_vertical(self, channel: int, vertical: Vertical) -> Vertical:
        """Set scale and offset with the trace at mid-screen, and read them back.

        Four digits, because replies carry five: a range can then be set again from what its preamble said, exactly.
        """
        scale = vertical.scale_v_per_div
        self.vertical_scale.check(f"CH{channel} scale", scale)
        settings = (
            Setting(f"CH{channel}:SCAle", f"{scale:.3E}", SCALE_TOLERANCE * scale, "V/div"),
            Setting(f"CH{channel}:POSition", "0"),
            Setting(f"CH{channel}:OFFSet", f"{vertical.offset_v:.3E}", OFFSET_TOLERANCE_DIV * scale, "V"),
        )
        settled, _, offset = map(float, self._kept.set(settings))
        self._described.pop(channel, None)
        self._verticals[channel] = Vertical(settled, offset)
        return self._verticals[channel]

    def scalings(self) -> tuple[Scaling, ...]:
        """YMUlt, YZEro and YOFf of each channel: the preamble belongs to the waveform, not to the knobs."""
        return tuple(self._scalings[channel] for channel in self.channels)

    def vertical_for(self, scaling: Scaling) -> Vertical:
        """25 codes a division, two bytes a point 256 times finer."""
        codes_per_division = CODES_PER_DIVISION * 256 ** (self._dtype.itemsize - 1)
        return Vertical(scaling.scale_v * codes_per_division, scaling.offset_v)

    def arm(self) -> None:
        """Start a single acquisition."""
        self._link.write("ACQuire:STATE RUN")

    def wait(self) -> None:
        """`*OPC?` answers when the single acquisition is complete."""
        self._completed(TRIGGER_WAIT_S)

    def read(self) -> Frames:
        """One question a channel: preamble, sub-sample trigger time and the codes they belong to."""
        codes = np.empty((1, len(self.channels), self._timebase.samples), self._dtype)
        offsets = np.array([[self._curve(channel, codes[0, place]) for place, channel in enumerate(self.channels)]])
        self._check_offsets(offsets)
        return Frames(codes, offsets, np.zeros(1), self._clipped(codes))

    def most_frames(self) -> int:
        """`HORizontal:FASTframe:MAXFRames?` at the configured record length."""
        return int(self._link.number("HORizontal:FASTframe:MAXFRames?"))

    def arm_burst(self, frames: int) -> None:
        """FastFrame of `frames` frames, started; ready for triggers 400 ms later, as `TRIGger:A:READY?` confirms."""
        if frames != self._frames:
            settings = (
                Setting("HORizontal:FASTframe:STATE", "ON"),
                Setting("HORizontal:FASTframe:COUNt", str(frames), unit="frames"),
                Setting("HORizontal:FASTframe:SEQuence", "FIRst"),
                Setting("HORizontal:FASTframe:SUMFrame", "NONe"),
                Setting("DATa:FRAMESTARt", "1"),
                Setting("DATa:FRAMESTOP", str(frames)),
            )
            self._kept.set(settings)
            self._frames = frames
        self._link.write("ACQuire:STATE RUN")
        deadline = time.monotonic() + TRIGGER_WAIT_S
        while self._link.query("TRIGger:A:READY?") != "1":
            if time.monotonic() > deadline:
                raise InstrumentError(
                    f"{self._link.name}: not ready for triggers after {TRIGGER_WAIT_S:g} s: see its screen"
                )

    def read_burst(self) -> Frames:
        """Wait for the last frame; one `CURVe?`, one list of trigger offsets and of time stamps for each channel."""
        self._count_frames()
        self._completed(BURST_WAIT_S)
        offsets = []
        span = f"1,{self._frames}"
        codes = np.empty((len(self.channels), self._frames, self._timebase.samples), self._dtype)
        for place, channel in enumerate(self.channels):
            self._curve(channel, codes[place])
            found = self._of_each_frame(f"HORizontal:FASTframe:XZEro:ALL:CH{channel}? {span}", _numbers)
            self._check_offsets(found)
            offsets.append(found)
        stamps = self._of_each_frame(f"HORizontal:FASTframe:TIMEStamp:ALL:CH{self.channels[0]}? {span}", _times)
        codes = codes.swapaxes(0, 1)
        return Frames(codes, np.stack(offsets, axis=1), stamps, self._clipped(codes))

    def settings(self) -> dict[str, str | float]:
        """Timebase, acquisition, trigger, and how every channel is set, as a former user may have left it."""
        names = {question: name for name, question in REPORTED.items()}
        for channel in self.INPUTS:
            names |= {
                f"CH{channel}:{question}": f"ch{channel}_{name}" for name, question in REPORTED_OF_CHANNEL.items()
            }
        answers = self._link.query(";:".join(names)).split(";")
        report = {
            name: answer if name.endswith(WORDS) else number_in(answer)
            for name, answer in zip(names.values(), answers, strict=False)
        }
        if len(answers) != len(names) or None in report.values():
            raise InstrumentError(
                f"{self._link.name} at {self._link.resource}: does not say in numbers how it is set: check that the "
                f"driver fits the instrument"
            )
        return {name: value for name, value in report.items() if value is not None}

    def changes(self) -> tuple[Change, ...]:
        """All settings that were sent, in one question."""
        return self._kept.changes()

    def make_safe(self) -> None:
        """Stop acquiring and unlock the front panel; errors of what went before are not held against it."""
        self._link.errors()
        with self._link.checked():
            self._link.write("ACQuire:STATE STOP")
            self._link.write("LOCk NONe")

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _completed(self, timeout_s: float) -> None:
        """Wait for the end of the acquisition; an instrument that answers all else waits for its trigger."""
        try:
            self._link.query("*OPC?", timeout_s=timeout_s)
        except NoAnswer:
            if self._link.query("ACQuire:STATE?") == "0":
                raise
            raise NoTrigger(
                f"{self._link.name} at {self._link.resource}: no trigger came within {timeout_s:g} s: {TRIGGER_REMEDY}"
            ) from None

    def _count_frames(self) -> None:
        """Return when all frames of the burst are there.

        `*OPC?` alone would not show how many are missing, and how long to wait for all depends on the triggers' rate.
        """
        frames, last = 0, time.monotonic()
        while (found := self._link.number("ACQuire:NUMFRAMESACQuired?", timeout_s=BURST_WAIT_S)) < self._frames:
            if found > frames:
                frames, last = int(found), time.monotonic()
            elif time.monotonic() > last + STALLED_S:
                raise NoTrigger(
                    f"{self._link.name} at {self._link.resource} took {frames} of {self._frames} frames, and none for "
                    f"{STALLED_S:g} s: {TRIGGER_REMEDY}"
                )
            time.sleep(POLL_S)

    def _curve(self, channel: int, codes: NDArray[Any]) -> float:
        """`CURVe?` of a channel into `codes`, in one message with what they are; returns their trigger offset, s.

        Where the instrument refuses, it says nothing but puts the reason in its queue.

        Raises:
            SettingChanged: source or preamble are not those of this channel as it was set.
        """
        questions = (f"DATa:SOUrce CH{channel}", "DATa:SOUrce?", *PREAMBLE, "CURVe?")
        try:
            source, *preamble = self._link.read_described_block(questions, codes)
        except LinkError:
            with self._link.checked():
                pass
            raise
        *scaling, trigger_offset = preamble
        if (described := (source, scaling)) != self._described.get(channel):
            self._scalings[channel] = self._checked(channel, source, scaling)
            self._described[channel] = described
        if (trigger_offset_s := number_in(trigger_offset)) is None:
            raise SettingChanged(f"{self._link.name}: trigger offset of CH{channel} is {trigger_offset}: {ELSEWHERE}")
        return trigger_offset_s

    def _checked(self, channel: int, source: str, preamble: Sequence[str]) -> Scaling:
        """What the codes of a channel mean by source and preamble, which must be those of its range.

        Raises:
            SettingChanged: they are not.
        """
        if source.upper() != f"CH{channel}":
            raise SettingChanged(f"{self._link.name}: asked for CH{channel}, got {excerpt(source)}: {ELSEWHERE}")
        numbers = [number for answer in preamble if (number := number_in(answer)) is not None]
        if len(numbers) < len(preamble):
            raise SettingChanged(f"{self._link.name}: CH{channel} is described by {preamble}: {ELSEWHERE}")
        multiplier, zero, offset = numbers
        found = Scaling(scale_v=multiplier, offset_v=zero - offset * multiplier)
        wanted, described = self._verticals.get(channel), self.vertical_for(found)
        if wanted is not None:
            scale = wanted.scale_v_per_div
            far = abs(described.scale_v_per_div - scale) > SCALE_TOLERANCE * scale
            if far or abs(described.offset_v - wanted.offset_v) > OFFSET_TOLERANCE_DIV * scale:
                raise SettingChanged(
                    f"{self._link.name}: CH{channel} was set to {scale:.4g} V/div at {wanted.offset_v:.4g} V, its "
                    f"preamble says {described.scale_v_per_div:.4g} V/div at {described.offset_v:.4g} V: {ELSEWHERE}"
                )
        return found

    def _check_offsets(self, offsets_s: NDArray[np.float64]) -> None:
        """Compare sub-sample trigger times with the sample interval.

        Raises:
            SettingChanged: one is longer than any can be.
        """
        worst = float(np.abs(offsets_s).max())
        if worst * self._timebase.sample_rate > LARGEST_OFFSET:
            raise SettingChanged(f"{self._link.name}: the trigger lies {worst:.3g} s beside the samples: {ELSEWHERE}")

    def _of_each_frame(self, query: str, read: Callable[[str], NDArray[np.float64]]) -> NDArray[np.float64]:
        """A list with a number for each frame of the burst, shape (frames,)."""
        reply = self._link.query(query)
        try:
            found = read(reply)
        except ValueError:  # a date that is none
            found = np.empty(0)
        found = found[np.isfinite(found)]
        if found.size != self._frames:
            raise InstrumentError(
                f"{self._link.name} at {self._link.resource}: {query.split()[0]} described {found.size} frames, not "
                f"{self._frames}: check its trigger"
            )
        return found

    def _clipped(self, codes: NDArray[np.integer]) -> NDArray[np.bool_]:
        step = 256 ** (codes.dtype.itemsize - 1)
        low, high = codes.min(axis=-1), codes.max(axis=-1)
        clipped: NDArray[np.bool_] = (low <= self.CLIP_LOW * step) | (high >= self.CLIP_HIGH * step)
        return clipped

    def _delay(self, timebase: Timebase) -> tuple[Setting, ...]:
        if timebase.delay_s == 0:
            return (Setting("HORizontal:MAIn:DELay:MODe", "OFF"), Setting("HORizontal:POSition", "0"))
        return (
            Setting("HORizontal:MAIn:DELay:MODe", "ON"),
            Setting("HORizontal:MAIn:DELay:POSition", "0"),
            Setting("HORizontal:MAIn:DELay:TIMe", f"{timebase.delay_s:.6E}", 1 / timebase.sample_rate, "s"),
        )

    def _acquisition(self, averages: int) -> tuple[Setting, ...]:
        if averages == 1:
            return (Setting("ACQuire:MODe", "SAMple"),)
        return (Setting("ACQuire:MODe", "AVErage"), Setting("ACQuire:NUMAVg", str(averages)))

    def _input(self, channel: int) -> tuple[Setting, ...]:
        return (
            Setting(f"CH{channel}:INVert", "OFF"),
            Setting(f"CH{channel}:COUPling", "DC"),
            Setting(f"CH{channel}:BANdwidth", f"{FULL_BANDWIDTH_HZ:.1E}", FULL_BANDWIDTH_HZ / 2, "Hz"),
            Setting(f"CH{channel}:DESKew", "0"),
            Setting(f"CH{channel}:PROBEFunc:EXTAtten", "1"),
        )

    def _trigger(self, trigger: EdgeTrigger) -> tuple[Setting, ...]:
        source, suffix = ("AUXiliary", "AUX") if trigger.source == "AUX" else (f"CH{trigger.source}",) * 2
        level = "TRIGger:AUXLevel" if trigger.source == "AUX" else f"TRIGger:A:LEVel:{source}"
        return (
            Setting("TRIGger:A:TYPe", "EDGE"),
            Setting("TRIGger:A:MODe", "NORMal"),
            Setting("TRIGger:A:HOLDoff:BY", "DEFAult"),
            Setting("TRIGger:A:EDGE:COUPling", "DC"),
            Setting("TRIGger:A:EDGE:SOUrce", source),
            Setting(f"TRIGger:A:EDGE:SLOpe:{suffix}", "RISe" if trigger.rising else "FALL"),
            Setting(level, f"{trigger.level_v:.4f}", LEVEL_TOLERANCE_V, "V"),
        )


_STAMP = re.compile(r"(\d{2} \w{3} \d{4} \d{2}:\d{2}:\d{2})\.(\d{3} \d{3} \d{3} \d{3})")
_OFFSET = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)")


def _times(reply: str) -> NDArray[np.float64]:
    """Time stamps `DD MON YYYY HH:MM:SS.fff fff fff fff` as seconds after the first one's full second."""
    stamps = [(match[1], int(match[2].replace(" ", ""))) for match in _STAMP.finditer(reply)]
    clock = {text: datetime.strptime(text, "%d %b %Y %H:%M:%S") for text in {text for text, _ in stamps}}
    start = min(clock.values())
    return np.array([(clock[text] - start).total_seconds() + picoseconds * 1e-12 for text, picoseconds in stamps])


def _numbers(reply: str) -> NDArray[np.float64]:
    """The numbers with exponent in a list of frame numbers and trigger offsets."""
    return np.array([float(text) for text in _OFFSET.findall(reply)])
