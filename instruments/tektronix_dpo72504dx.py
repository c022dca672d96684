"""Tektronix DPO72504DX digital phosphor oscilloscope.

Commands: DPO/DSA/MSO70000 series programmer manual. Codes leave the instrument as it digitised them; they become volts
only in analysis: volts = (code - YOFf) * YMUlt + YZEro.
"""

import re
import time
from collections.abc import Callable
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.driver import Driver
from instruments.errors import InstrumentError, NoTrigger
from instruments.interfaces import Oscilloscope
from instruments.readback import confirm
from instruments.sections import ScopeSection, Timeout
from instruments.values import (
    EdgeTrigger,
    Examination,
    Frames,
    Identity,
    Range,
    Scaling,
    Timebase,
    Vertical,
)
from instruments.visa import NoAnswer, VisaLink, tektronix_event_queue


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
        "trigger_source",
        "ch?_scale_v_per_div",
        "ch?_offset_v",
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
        self._samples = 0
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

        `DATa:STOP` is set with every record length: the instrument does not move it by itself.
        """
        record_length = max(timebase.samples, self.SHORTEST_RECORD)
        self.SAMPLE_RATE.check("scope sample rate", timebase.sample_rate)
        self.AVERAGES.check("averages", averages)
        with self._link.checked():
            for setting in (
                "ACQuire:STATE STOP",
                "*CLS",
                "HEADer OFF",
                "VERBose ON",
                "FASTAcq:STATE OFF",
                "HORizontal:FASTframe:STATE OFF",
                "ACQuire:SAMPlingmode RT",
                "ACQuire:STOPAfter SEQuence",
                *self._acquisition(averages),
                "HORizontal:MODE MANual",
                f"HORizontal:MODE:SAMPLERate {timebase.sample_rate:.6E}",
                f"HORizontal:MODE:RECOrdlength {record_length}",
                *self._delay(timebase.delay_s),
                *(f"SELect:CH{channel} {int(channel in channels)}" for channel in self.INPUTS),
                *self._trigger(trigger),
                "DATa:STARt 1",
                f"DATa:STOP {timebase.samples}",
                "DATa:ENCdg SRIbinary",
                f"WFMOutpre:BYT_Nr {1 if averages == 1 else 2}",
            ):
                self._link.write(setting)
        self._confirm("HORizontal:MODE:SAMPLERate", timebase.sample_rate, RATE_TOLERANCE * timebase.sample_rate, "S/s")
        self._confirm("HORizontal:MODE:RECOrdlength", record_length, 0, "samples")
        if averages > 1:
            self._confirm("ACQuire:NUMAVg", averages, 0)
        if timebase.delay_s != 0:
            self._confirm("HORizontal:MAIn:DELay:TIMe", timebase.delay_s, 1 / timebase.sample_rate, "s")
        level = "TRIGger:AUXLevel" if trigger.source == "AUX" else f"TRIGger:A:LEVel:CH{trigger.source}"
        self._confirm(level, trigger.level_v, LEVEL_TOLERANCE_V, "V")
        self.channels = channels
        self._samples = timebase.samples
        self._frames = 0
        self._dtype = np.dtype("<i1") if averages == 1 else np.dtype("<i2")

    def set_vertical(self, channel: int, vertical: Vertical) -> Vertical:
        """Set scale and offset with the trace at mid-screen, and read them back.

        Four digits, because replies carry five: a range can then be set again from what its preamble said, exactly.
        """
        self.vertical_scale.check(f"CH{channel} scale", vertical.scale_v_per_div)
        with self._link.checked():
            self._link.write(f"CH{channel}:SCAle {vertical.scale_v_per_div:.3E}")
            self._link.write(f"CH{channel}:POSition 0")
            self._link.write(f"CH{channel}:OFFSet {vertical.offset_v:.3E}")
        scale = vertical.scale_v_per_div
        return Vertical(
            self._confirm(f"CH{channel}:SCAle", scale, SCALE_TOLERANCE * scale, "V/div"),
            self._confirm(f"CH{channel}:OFFSet", vertical.offset_v, OFFSET_TOLERANCE_DIV * scale, "V"),
        )

    def scalings(self) -> tuple[Scaling, ...]:
        """YMUlt, YZEro and YOFf of each channel: the preamble belongs to the waveform, not to the knobs."""
        found = []
        for channel in self.channels:
            self._link.write(f"DATa:SOUrce CH{channel}")
            multiplier, zero, offset = (
                self._link.number(f"WFMOutpre:{field}?") for field in ("YMUlt", "YZEro", "YOFf")
            )
            found.append(Scaling(scale_v=multiplier, offset_v=zero - offset * multiplier))
        return tuple(found)

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
        """The sub-sample trigger time of every channel in one question, then one `CURVe?` per channel."""
        question = ";:".join(f"DATa:SOUrce CH{channel};:WFMOutpre:XZEro?" for channel in self.channels)
        offsets = np.array([self._link.numbers(question, len(self.channels))])
        codes = np.empty((1, len(self.channels), self._samples), self._dtype)
        for place, channel in enumerate(self.channels):
            self._curve(channel, codes[0, place])
        return Frames(codes, offsets, np.zeros(1), self._clipped(codes))

    def most_frames(self) -> int:
        """`HORizontal:FASTframe:MAXFRames?` at the configured record length."""
        return int(self._link.number("HORizontal:FASTframe:MAXFRames?"))

    def arm_burst(self, frames: int) -> None:
        """FastFrame of `frames` frames, started; ready for triggers 400 ms later, as `TRIGger:A:READY?` confirms."""
        if frames != self._frames:
            with self._link.checked():
                for setting in (
                    "HORizontal:FASTframe:STATE ON",
                    f"HORizontal:FASTframe:COUNt {frames}",
                    "HORizontal:FASTframe:SEQuence FIRst",
                    "HORizontal:FASTframe:SUMFrame NONe",
                    "DATa:FRAMESTARt 1",
                    f"DATa:FRAMESTOP {frames}",
                ):
                    self._link.write(setting)
            self._confirm("HORizontal:FASTframe:COUNt", frames, 0, "frames")
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
        codes = np.empty((len(self.channels), self._frames, self._samples), self._dtype)
        for place, channel in enumerate(self.channels):
            self._curve(channel, codes[place])
            offsets.append(self._of_each_frame(f"HORizontal:FASTframe:XZEro:ALL:CH{channel}? {span}", _numbers))
        stamps = self._of_each_frame(f"HORizontal:FASTframe:TIMEStamp:ALL:CH{self.channels[0]}? {span}", _times)
        codes = codes.swapaxes(0, 1)
        return Frames(codes, np.stack(offsets, axis=1), stamps, self._clipped(codes))

    def settings(self) -> dict[str, str | float]:
        """Timebase, acquisition, trigger and the vertical range of every channel that is on."""
        report: dict[str, str | float] = {
            "sample_rate": self._link.number("HORizontal:MODE:SAMPLERate?"),
            "record_length": self._link.number("HORizontal:MODE:RECOrdlength?"),
            "acquisition_mode": self._link.query("ACQuire:MODe?"),
            "trigger_source": self._link.query("TRIGger:A:EDGE:SOUrce?"),
        }
        for channel in self.channels:
            report[f"ch{channel}_scale_v_per_div"] = self._link.number(f"CH{channel}:SCAle?")
            report[f"ch{channel}_offset_v"] = self._link.number(f"CH{channel}:OFFSet?")
            report[f"ch{channel}_bandwidth_hz"] = self._link.number(f"CH{channel}:BANdwidth?")
        return report

    def make_safe(self) -> None:
        """Stop acquiring; errors of what went before are not held against it."""
        self._link.errors()
        with self._link.checked():
            self._link.write("ACQuire:STATE STOP")

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

    def _curve(self, channel: int, codes: NDArray[Any]) -> None:
        """`CURVe?` of a channel into `codes`; where it refuses, it says nothing but puts the reason in its queue."""
        try:
            self._link.read_block(f"DATa:SOUrce CH{channel};:CURVe?", codes)
        except NoAnswer:
            with self._link.checked():
                pass
            raise

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

    def _delay(self, delay_s: float) -> tuple[str, ...]:
        if delay_s == 0:
            return ("HORizontal:MAIn:DELay:MODe OFF", "HORizontal:POSition 0")
        return (
            "HORizontal:MAIn:DELay:MODe ON",
            "HORizontal:MAIn:DELay:POSition 0",
            f"HORizontal:MAIn:DELay:TIMe {delay_s:.6E}",
        )

    def _acquisition(self, averages: int) -> tuple[str, ...]:
        return ("ACQuire:MODe SAMple",) if averages == 1 else ("ACQuire:MODe AVErage", f"ACQuire:NUMAVg {averages}")

    def _trigger(self, trigger: EdgeTrigger) -> tuple[str, ...]:
        slope = "RISe" if trigger.rising else "FALL"
        common = ("TRIGger:A:TYPe EDGE", "TRIGger:A:MODe NORMal")
        if trigger.source == "AUX":
            return (
                *common,
                "TRIGger:A:EDGE:SOUrce AUXiliary",
                f"TRIGger:A:EDGE:SLOpe:AUX {slope}",
                f"TRIGger:AUXLevel {trigger.level_v:.4f}",
            )
        source = f"CH{trigger.source}"
        return (
            *common,
            f"TRIGger:A:EDGE:SOUrce {source}",
            f"TRIGger:A:EDGE:SLOpe:{source} {slope}",
            f"TRIGger:A:LEVel:{source} {trigger.level_v:.4f}",
        )

    def _confirm(self, command: str, asked: float, tolerance: float, unit: str = "") -> float:
        """Read a setting back; returns what the instrument settled on."""
        return confirm(f"{self._link.name}: {command}", asked, self._link.number(f"{command}?"), tolerance, unit=unit)


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
