"""Tektronix DPO72504DX digital phosphor oscilloscope.

Commands: DPO/DSA/MSO70000 series programmer manual. Codes leave the instrument as it digitised them; they become volts
only in analysis. The mean of several triggers is made here, of the frames of FastFrame: what the instrument calls an
average is a running exponential one (ACQuire:MODe).
"""

import re
import time
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from instruments.driver import Driver
from instruments.errors import InstrumentError, LinkError, NoTrigger, SettingChanged
from instruments.interfaces import Oscilloscope
from instruments.kept_settings import KeptSettings
from instruments.sections import ScopeSection, Timeout
from instruments.tektronix_dpo72504dx_answers import answers
from instruments.tektronix_dpo72504dx_records import (
    CLIP_HIGH,
    CLIP_LOW,
    CODES_PER_DIVISION,
    ELSEWHERE,
    FINER,
    PREAMBLE,
    Meaning,
    frame_offsets,
    frame_times,
    mean,
    meaning,
    require_range,
    require_source,
)
from instruments.tektronix_dpo72504dx_settings import (
    INPUTS,
    REPORTED,
    SENT_ANEW,
    configuration,
    framed_records,
    many_frames,
    reported,
    single_records,
    vertical_range,
)
from instruments.units import Hertz
from instruments.values import (
    Answer,
    Change,
    Codes,
    EdgeTrigger,
    Examination,
    Frames,
    Identity,
    Range,
    Scaling,
    Timebase,
    Vertical,
)
from instruments.visa import NoAnswer, VisaLink, number_in, room_for_blocks, tektronix_event_queue


class Dpo72504dxSection(ScopeSection):
    """The oscilloscope and what triggers it."""

    timeout: Timeout = 10.0
    bandwidth: Annotated[
        Hertz, Field(gt=0, le=25e9, description="Bandwidth of its inputs; higher frequencies are cut off.")
    ] = 25e9


DRIVER = Driver(
    section=Dpo72504dxSection,
    open=lambda section, opening: Dpo72504dx(
        VisaLink(
            opening.address,
            name="scope",
            timeout_s=section.timeout,
            transcript=opening.transcript,
            error_queue=tektronix_event_queue,
        ),
        bandwidth_hz=section.bandwidth,
    ),
    identity=re.compile(r"TEKTRONIX (DPO|DSA|MSO)7\d{4}", re.IGNORECASE),
    sent_anew=SENT_ANEW,
)

SELF_TEST_S = 60.0
TRIGGER_WAIT_S = 10.0
BURST_WAIT_S = 60.0
STALLED_S = 3.0
"""A burst that got no frame for so long gets no more: its triggers are microseconds apart."""
REPEATED_S = 0.5
"""So long is waited for a trigger that repeats quickly."""
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1e-3, 50e-3
"""Between questions whether it is ready, each pause twice the one before: a real one gets ready for frames in 400 ms
and stands a question every 50 ms (a public FastFrame capture script); a simulated one is ready at the first."""
TRIGGER_REMEDY = "check that the AWG plays, the trigger's cable and its level"
LARGEST_OFFSET = 2.0
"""Samples that the trigger may lie beside the sample grid: one, and what its position is uncertain by."""


class Dpo72504dx(Oscilloscope):
    """Four channels of 8 bits, read one source at a time as signed little-endian integers."""

    sample_rate = Range(1.0, 100e9, "S/s")
    AVERAGES = Range(1, 10240, "triggers")
    vertical_scale = Range(6.25e-3, 0.6, "V/div")
    INPUTS = INPUTS

    def __init__(self, link: VisaLink, *, bandwidth_hz: float = 25e9) -> None:
        """Drive the instrument behind `link`, whose inputs are to have a bandwidth."""
        self._link = link
        self.bandwidth_hz: float = bandwidth_hz
        self.channels = ()
        self._kept = KeptSettings(link)
        self._timebase = Timebase(1.0, 0)
        self._averages = 1
        self._curves = Curves(link, CODES_PER_DIVISION)
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

        Whatever else changes volts or time is set as well, as a former user may have left it otherwise. The front panel
        is locked.
        """
        self.require_rate(timebase.sample_rate)
        self.AVERAGES.check("averages", averages)
        self._kept.forget()
        for message in ("ACQuire:STATE STOP", "*CLS", "LOCk ALL"):
            self._link.write(message)
        self._kept.set(tuple(configuration(timebase, trigger, channels, averages, self.bandwidth_hz)))
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
        """YMUlt, YZEro and YOFf of each channel: the preamble belongs to the waveform, not to the knobs."""
        return tuple(
            Scaling(found.scale_v / self._fineness, found.offset_v)
            for found in (self._curves.meanings[channel].scaling for channel in self.channels)
        )

    def vertical_for(self, scaling: Scaling) -> Vertical:
        """25 codes a division, those of a mean 256 times finer."""
        return Vertical(scaling.scale_v * CODES_PER_DIVISION * self._fineness, scaling.offset_v)

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
        codes = np.empty((1, len(self.channels), self._timebase.samples), np.int8)
        offsets = np.array(
            [[self._curves.read(channel, codes[0, place]) for place, channel in enumerate(self.channels)]]
        )
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
        """FastFrame of `frames` frames, started; ready for triggers 400 ms later, as `TRIGger:A:READY?` confirms."""
        if frames != self._frames:
            self._kept.set(many_frames(self._timebase, frames))
            self._frames = frames
        self._link.write("ACQuire:STATE RUN")
        await_readiness(self._link, lambda: self._link.query("TRIGger:A:READY?") == "1")

    def read_burst(self) -> Frames:
        """Wait for the last frame; one `CURVe?`, one list of trigger offsets and of time stamps for each channel."""
        await_frames(self._link, self._frames)
        await_completion(self._link, BURST_WAIT_S)
        codes = room_for_blocks((len(self.channels), self._frames, self._timebase.samples), np.int8)
        places = enumerate(self.channels)
        offsets = [self._framed_curve(channel, codes[place]) for place, channel in places]
        header = f"HORizontal:FASTframe:TIMEStamp:ALL:CH{self.channels[0]}?"
        stamps = of_each_frame(self._link, header, f" 1,{self._frames}", self._frames, frame_times)
        codes = codes.swapaxes(0, 1)
        return Frames(codes, np.stack(offsets, axis=1), stamps, clipped(codes, CLIP_LOW, CLIP_HIGH))

    def settings(self) -> dict[str, str | float]:
        """Timebase, acquisition, trigger, and how every channel is set, as a former user may have left it."""
        return reported(self._link, REPORTED)

    def changes(self) -> tuple[Change, ...]:
        """All settings that were sent, in one question."""
        return self._kept.changes()

    def answers(self) -> tuple[Answer, ...]:
        """Of record lengths and unsigned codes."""
        self._kept.forget()
        return tuple(answers(self._link))

    def make_safe(self) -> None:
        """Stop acquiring and unlock the front panel; errors of what went before are not held against it."""
        self._link.errors()
        with self._link.checked():
            self._link.write("ACQuire:STATE STOP")
            self._link.write("LOCk NONe")

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _read_mean(self) -> Frames:
        """The mean of all frames, channel by channel, so that no more than one channel's are in memory."""
        shape = (1, len(self.channels), self._timebase.samples)
        codes, offsets, at_an_end = np.empty(shape, np.int16), np.empty(shape[:2]), np.empty(shape[:2], np.bool_)
        (frames,) = room_for_blocks((1, self._averages, self._timebase.samples), np.int8)
        for place, channel in enumerate(self.channels):
            offsets[0, place] = self._framed_curve(channel, frames).mean()
            codes[0, place], at_an_end[0, place] = mean(frames, FINER), clipped(frames, CLIP_LOW, CLIP_HIGH).any()
        return Frames(codes, offsets, np.zeros(1), at_an_end)

    def _framed_curve(self, channel: int, codes: NDArray[np.int8]) -> NDArray[np.float64]:
        """`Curves.read` of all frames of a channel; returns the trigger offset of each, s."""
        self._curves.read(channel, codes)
        header = f"HORizontal:FASTframe:XZEro:ALL:CH{channel}?"
        offsets = of_each_frame(self._link, header, f" 1,{len(codes)}", len(codes), frame_offsets)
        offsets += self._curves.meanings[channel].late_s
        check_offsets(self._link.name, offsets, self._timebase.sample_rate)
        return offsets

    @property
    def _fineness(self) -> int:
        return FINER if self._averages > 1 else 1


class Curves:
    """Reads curves of an oscilloscope's channels, each with what its codes mean, and holds that against its settings.

    `meanings` is what the codes that were last read mean, by channel.
    """

    def __init__(self, link: VisaLink, codes_per_division: int) -> None:
        """Of the instrument behind `link`, whose codes are so fine."""
        self._link = link
        self._codes_per_division = codes_per_division
        self._verticals: dict[int, Vertical] = {}
        self.meanings: dict[int, Meaning] = {}
        self._timebase = Timebase(1.0, 0)
        self._described: dict[int, tuple[str, list[str]]] = {}  # source and preamble that were found right

    def sampled(self, timebase: Timebase) -> None:
        """Curves are sampled like this from now on."""
        self._timebase = timebase
        self._described.clear()

    def ranged(self, channel: int, vertical: Vertical) -> None:
        """A channel has this range from now on."""
        self._described.pop(channel, None)
        self._verticals[channel] = vertical

    def read(self, channel: int, codes: NDArray[Any]) -> float:
        """`CURVe?` of a channel into `codes`, in one message with what they are; returns their trigger offset, s.

        Where the instrument refuses, it says nothing but puts the reason in its queue.

        Raises:
            SettingChanged: source or preamble are not those of this channel as it was set.
        """
        questions = (f"DATa:SOUrce CH{channel}", "DATa:SOUrce?", *PREAMBLE, "WFMOutpre:XZEro?", "CURVe?")
        try:
            source, *preamble, trigger_offset = self._link.read_described_block(questions, codes)
        except LinkError:
            with self._link.checked():
                pass
            raise
        if (described := (source, preamble)) != self._described.get(channel):
            self._understand(channel, source, preamble)
            self._described[channel] = described
        if (trigger_offset_s := number_in(trigger_offset)) is None:
            raise SettingChanged(f"{self._link.name}: trigger offset of CH{channel} is {trigger_offset}: {ELSEWHERE}")
        return self.meanings[channel].late_s + trigger_offset_s

    def _understand(self, channel: int, source: str, preamble: list[str]) -> None:
        """Take in what the codes of a channel mean by source and preamble, which must be those of its range.

        Raises:
            SettingChanged: they are not.
        """
        require_source(self._link.name, channel, source)
        found = meaning(name := f"{self._link.name}: CH{channel}", preamble, self._timebase)
        self.meanings[channel] = found
        if (wanted := self._verticals.get(channel)) is not None:
            scaling = found.scaling
            require_range(name, wanted, Vertical(scaling.scale_v * self._codes_per_division, scaling.offset_v))


def acquires(link: VisaLink) -> bool:
    """Whether an acquisition that was started ends soon, as with a trigger that repeats quickly; else it is stopped."""
    deadline = time.monotonic() + REPEATED_S
    for pause_s in pauses():
        if link.query("ACQuire:STATE?") == "0":
            return True
        if time.monotonic() > deadline:
            break
        time.sleep(pause_s)
    link.write("ACQuire:STATE STOP")
    return False


def await_completion(link: VisaLink, timeout_s: float) -> None:
    """Wait for the end of the acquisition; an instrument that answers all else waits for its trigger.

    Raises:
        NoTrigger: it still does.
    """
    try:
        link.query("*OPC?", timeout_s=timeout_s)
    except NoAnswer:
        if link.query("ACQuire:STATE?") == "0":
            raise
        raise NoTrigger(
            f"{link.name} at {link.resource}: no trigger came within {timeout_s:g} s: {TRIGGER_REMEDY}"
        ) from None


def await_frames(link: VisaLink, wanted: int) -> None:
    """Return when all frames of the burst are there.

    `*OPC?` alone would not show how many are missing, and how long to wait for all depends on the triggers' rate.

    Raises:
        NoTrigger: frames are missing, and no more come.
    """
    frames, last, waits = 0, time.monotonic(), pauses()
    while (found := link.number("ACQuire:NUMFRAMESACQuired?", timeout_s=BURST_WAIT_S)) < wanted:
        if found > frames:
            frames, last = int(found), time.monotonic()
        elif time.monotonic() > last + STALLED_S:
            raise NoTrigger(
                f"{link.name} at {link.resource} took {frames} of {wanted} frames, and none for {STALLED_S:g} s: "
                f"{TRIGGER_REMEDY}"
            )
        time.sleep(next(waits))


def await_readiness(link: VisaLink, ready: Callable[[], bool]) -> None:
    """Return when the instrument takes triggers, as `ready` asks it.

    Raises:
        InstrumentError: it is not ready in time.
    """
    deadline = time.monotonic() + TRIGGER_WAIT_S
    for pause_s in pauses():
        if ready():
            return
        if time.monotonic() > deadline:
            raise InstrumentError(f"{link.name}: not ready for triggers after {TRIGGER_WAIT_S:g} s: see its screen")
        time.sleep(pause_s)


def check_offsets(instrument: str, offsets_s: NDArray[np.float64], sample_rate: float) -> None:
    """Compare sub-sample trigger times with the sample interval.

    Raises:
        SettingChanged: one is longer than any can be.
    """
    worst = float(np.abs(offsets_s).max())
    if worst * sample_rate > LARGEST_OFFSET:
        raise SettingChanged(f"{instrument}: the trigger lies {worst:.3g} s beside the samples: {ELSEWHERE}")


def of_each_frame(
    link: VisaLink, header: str, arguments: str, frames: int, read: Callable[[str], NDArray[np.float64]]
) -> NDArray[np.float64]:
    """A list with a number for each of so many frames, shape (frames,).

    Raises:
        InstrumentError: it is another list.
    """
    reply = link.query(f"{header}{arguments}")
    try:
        found = read(reply)
    except ValueError:
        found = np.empty(0)
    found = found[np.isfinite(found)]
    if found.size != frames:
        raise InstrumentError(
            f"{link.name} at {link.resource}: {header} described {found.size} frames, not {frames}: check its trigger"
        )
    return found


def clipped(codes: Codes, lowest: int, highest: int) -> NDArray[np.bool_]:
    """Whether a point of each record, (..., points), reached an end of the range."""
    low, high = codes.min(axis=-1), codes.max(axis=-1)
    reached: NDArray[np.bool_] = (low <= lowest) | (high >= highest)
    return reached


def pauses() -> Iterator[float]:
    """How long to wait before each further question to an instrument that is not ready yet, s."""
    pause_s = FIRST_PAUSE_S
    while True:
        yield pause_s
        pause_s = min(2 * pause_s, LONGEST_PAUSE_S)
