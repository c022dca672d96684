"""Tektronix 6 Series B MSO, mixed signal oscilloscope.

Commands: programmer manual of the 4/5/6 Series MSO, as the descriptions of the package tm_devices have it (MSO6B). Its
codes have 16 bits, of which its digitiser fills the upper 12 (ACQuire:MODe: "12 bit precision data is zero padded in
lower 4 bits"). Recalled of the data sheet: 12 bits up to 25 GS/s, 8 bits above; 1 mV to 1 V a division into 50 ohm.
Assumed: it has an auxiliary input (TRIGger:AUXLevel: "for those instruments that have" one; else it says so when it
is configured); 25 codes a division in 8 bits, as in the rest of the family, `WFMOutpre:YMUlt` confirming it; DATa:STOP
cuts every frame; records are as long in FastFrame as without.
"""

import re
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from instruments.driver import Driver
from instruments.errors import InstrumentError
from instruments.interfaces import Oscilloscope
from instruments.kept_settings import KeptSettings
from instruments.sections import ScopeSection, Timeout
from instruments.tektronix_dpo72504dx import (
    BURST_WAIT_S,
    SELF_TEST_S,
    TRIGGER_WAIT_S,
    Curves,
    acquires,
    await_completion,
    await_frames,
    await_readiness,
    check_offsets,
    clipped,
    of_each_frame,
)
from instruments.tektronix_dpo72504dx_records import mean
from instruments.tektronix_dpo72504dx_settings import SENT_ANEW, reported, vertical_range
from instruments.tektronix_mso6b_records import frame_offsets, frame_times
from instruments.tektronix_mso6b_settings import (
    REPORTED,
    acquisition,
    conversion,
    framed_records,
    many_frames,
    single_records,
)
from instruments.units import Hertz
from instruments.values import Change, EdgeTrigger, Examination, Frames, Identity, Range, Scaling, Timebase, Vertical
from instruments.visa import VisaLink, room_for_blocks, tektronix_event_queue


class Mso6bSection(ScopeSection):
    """The oscilloscope and what triggers it."""

    timeout: Timeout = 10.0
    bandwidth: Annotated[
        Hertz, Field(gt=0, le=10e9, description="Bandwidth of its inputs; higher frequencies are cut off.")
    ] = 10e9


DRIVER = Driver(
    section=Mso6bSection,
    open=lambda section, opening: Mso6b(
        VisaLink(
            opening.address,
            name="scope",
            timeout_s=section.timeout,
            transcript=opening.transcript,
            error_queue=tektronix_event_queue,
        ),
        bandwidth_hz=section.bandwidth,
    ),
    identity=re.compile(r"TEKTRONIX MSO6\dB", re.IGNORECASE),
    sent_anew=SENT_ANEW,
)

CODES_PER_DIVISION = 25 * 256
CLIP_LOW, CLIP_HIGH = -32768 + 16, 32767 - 31
"""The last codes but one at the ends of the range, of which the digitiser makes every sixteenth."""
READY = ("READY", "TRIGGER")
"""What `TRIGger:STATE?` says once triggers are taken (the manual of TRIGger FORCe); ARMED before that."""


class Mso6b(Oscilloscope):
    """Four channels of 12 bits, read one source at a time as signed little-endian integers of 16."""

    sample_rate = Range(1.0, 25e9, "S/s")
    AVERAGES = Range(1, 10240, "triggers")
    vertical_scale = Range(1e-3, 1.0, "V/div")
    code_type = "int16"

    def __init__(self, link: VisaLink, *, bandwidth_hz: float = 10e9) -> None:
        """Drive the instrument behind `link`, whose inputs are to have a bandwidth."""
        self._link = link
        self.bandwidth_hz: float = bandwidth_hz
        self.channels = ()
        self._kept = KeptSettings(link)
        self._curves = Curves(link, CODES_PER_DIVISION)
        self._timebase = Timebase(1.0, 0)
        self._averages = 1
        self._frames = 0

    def identify(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

    def examine(self) -> Examination:
        """`*OPT?` and the event queue."""
        limits = {"sample rate": self.sample_rate, "vertical scale": self.vertical_scale, "averages": self.AVERAGES}
        return Examination(self._link.query("*OPT?"), tuple(self._link.errors()), limits)

    def self_test(self) -> None:
        """`*TST?`: 0 means passed."""
        result = self._link.number("*TST?", timeout_s=SELF_TEST_S)
        if result != 0:
            raise InstrumentError(
                f"{self._link.name}: self-test failed with code {result:g}: see the instrument's screen"
            )

    def configure(self, timebase: Timebase, trigger: EdgeTrigger, channels: tuple[int, ...], averages: int) -> None:
        """Manual horizontal mode, edge trigger in normal mode, the channels; FastFrame where there are averages.

        Whatever else changes volts or time is set as well, as a former user may have left it otherwise. How long a
        record is, is asked before its delay is set, which counts from its middle. The front panel is locked.
        """
        self.require_rate(timebase.sample_rate)
        self.AVERAGES.check("averages", averages)
        self._kept.forget()
        for message in ("ACQuire:STATE STOP", "*CLS", "LOCk ALL"):
            self._link.write(message)
        records = single_records(timebase) if averages == 1 else many_frames(timebase, averages)
        self._kept.set((*acquisition(timebase, channels), *records))
        points = self._link.number("HORizontal:MODe:RECOrdlength?")
        self._kept.set(tuple(conversion(timebase, points, trigger, channels, self.bandwidth_hz)))
        self.channels = channels
        self._timebase = timebase
        self._curves.sampled(timebase)
        self._averages = averages
        self._frames = 0

    def set_vertical(self, channel: int, vertical: Vertical) -> Vertical:
        """Set scale and offset with the trace at mid-screen, and read them back."""
        self.vertical_scale.check(f"CH{channel} scale", vertical.scale_v_per_div)
        settled, _, offset = map(float, self._kept.set(vertical_range(channel, vertical)))
        self._curves.ranged(channel, found := Vertical(settled, offset))
        return found

    def scalings(self) -> tuple[Scaling, ...]:
        """YMUlt, YZEro and YOFf of each channel, of a mean too: its codes are as fine."""
        return tuple(self._curves.meanings[channel].scaling for channel in self.channels)

    def vertical_for(self, scaling: Scaling) -> Vertical:
        """6400 codes a division."""
        return Vertical(scaling.scale_v * CODES_PER_DIVISION, scaling.offset_v)

    def arm(self) -> None:
        """Start a single acquisition."""
        self._link.write("ACQuire:STATE RUN")

    def wait(self) -> None:
        """`*OPC?` answers when the single acquisition is complete."""
        await_completion(self._link, TRIGGER_WAIT_S)

    def triggered(self) -> bool:
        """Whether the acquisition ends within half a second; `ACQuire:STATE?` says when."""
        self.arm()
        return acquires(self._link)

    def read(self) -> Frames:
        """One question a channel: preamble, sub-sample trigger time and the codes they belong to.

        A mean has all its triggers transferred, and of each the sub-sample time asked for.
        """
        if self._averages > 1:
            return self._read_mean()
        codes = np.empty((1, len(self.channels), self._timebase.samples), np.dtype("<i2"))
        offsets = np.array([[self._curves.read(channel, codes[0, place]) for place, channel in self._places()]])
        check_offsets(self._link.name, offsets, self._timebase.sample_rate)
        return Frames(codes, offsets, np.zeros(1), clipped(codes, CLIP_LOW, CLIP_HIGH))

    def most_frames(self) -> int:
        """`HORizontal:FASTframe:MAXFRames?` with FastFrame on, at the configured record length."""
        self._kept.set(framed_records(self._timebase))
        most = int(self._link.number("HORizontal:FASTframe:MAXFRames?"))
        if not self._frames:
            self._kept.set(single_records(self._timebase))
        return most

    def arm_burst(self, frames: int) -> None:
        """FastFrame of `frames` frames, started; returns once `TRIGger:STATE?` says that triggers are taken."""
        if frames != self._frames:
            self._kept.set(many_frames(self._timebase, frames))
            self._frames = frames
        self._link.write("ACQuire:STATE RUN")
        await_readiness(self._link, self._takes_triggers)

    def read_burst(self) -> Frames:
        """Wait for the last frame; one `CURVe?` and one list of trigger offsets a channel, one of time stamps."""
        await_frames(self._link, self._frames)
        await_completion(self._link, BURST_WAIT_S)
        codes = room_for_blocks((len(self.channels), self._frames, self._timebase.samples), "<i2")
        offsets = [self._framed_curve(channel, codes[place]) for place, channel in self._places()]
        header = "HORizontal:FASTframe:TIMEStamp:ALL?"
        stamps = of_each_frame(self._link, header, "", self._frames, frame_times)
        codes = codes.swapaxes(0, 1)
        return Frames(codes, np.stack(offsets, axis=1), stamps, clipped(codes, CLIP_LOW, CLIP_HIGH))

    def settings(self) -> dict[str, str | float]:
        """Timebase, acquisition, trigger, and how every channel is set, as a former user may have left it."""
        return reported(self._link, REPORTED)

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

    def _takes_triggers(self) -> bool:
        """Whether the acquisition that was started waits for triggers, or has had all that it waited for."""
        state, _, running = self._link.query("TRIGger:STATE?;:ACQuire:STATE?").partition(";")
        return state in READY or running == "0"

    def _places(self) -> tuple[tuple[int, int], ...]:
        """Each channel behind its place in the frames."""
        return tuple(enumerate(self.channels))

    def _read_mean(self) -> Frames:
        """The mean of all frames, channel by channel, so that no more than one channel's are in memory."""
        shape = (1, len(self.channels), self._timebase.samples)
        codes, offsets, at_an_end = np.empty(shape, np.int16), np.empty(shape[:2]), np.empty(shape[:2], np.bool_)
        (frames,) = room_for_blocks((1, self._averages, self._timebase.samples), "<i2")
        for place, channel in self._places():
            offsets[0, place] = self._framed_curve(channel, frames).mean()
            codes[0, place], at_an_end[0, place] = mean(frames, 1), clipped(frames, CLIP_LOW, CLIP_HIGH).any()
        return Frames(codes, offsets, np.zeros(1), at_an_end)

    def _framed_curve(self, channel: int, codes: NDArray[np.int16]) -> NDArray[np.float64]:
        """`Curves.read` of all frames of a channel; returns the trigger offset of each, s."""
        self._curves.read(channel, codes)
        offsets = of_each_frame(self._link, "HORizontal:FASTframe:XZEro:ALL?", "", len(codes), frame_offsets)
        offsets += self._curves.meanings[channel].late_s
        check_offsets(self._link.name, offsets, self._timebase.sample_rate)
        return offsets
