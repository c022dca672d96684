"""FastFrame of the virtual oscilloscope: many triggers in one acquisition, each with its time stamp.

Source: instrument facts 2.8; hardware facts, DPO72504DX: lists as three public parsers read them, `"1: ...","2: ..."`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.arguments import boolean, integer, keyword, nr3
from sim_backends.scpi.commands import Query, Setting
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.oscilloscope.horizontal import LONGEST_RECORD
from sim_backends.virtual.oscilloscope.vertical import CHANNELS

READY_S = 0.4  # from RUN until a burst of triggers is accepted
SWITCHED_ON = datetime(2026, 1, 1)  # what the oscilloscope's clock shows when the virtual clock is at 0
MOST_FRAMES = 2**31 - 1
SUMMARY_FRAMES = 2  # whose memory a summary takes (Blackchirp)

_MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")
_FRAME = integer(1, MOST_FRAMES)
_SPAN = (_FRAME, _FRAME)

FASTFRAME_COMMANDS = (
    Setting("HORizontal:FASTframe:STATE", "frames.on", boolean),
    Setting("HORizontal:FASTframe:COUNt", "frame_count", _FRAME),
    Setting("HORizontal:FASTframe:LENgth", "horizontal.record_length", integer(1, LONGEST_RECORD)),
    Query("HORizontal:FASTframe:MAXFRames?", "most_frames"),
    Setting("HORizontal:FASTframe:SEQuence", "frames.sequence", keyword("FIRst", "LAST")),
    Setting("HORizontal:FASTframe:SUMFrame", "frames.summary", keyword("NONe", "AVErage", "ENVelope")),
    Setting("HORizontal:FASTframe:SIXteenbit", "frames.sixteen_bit", boolean),
    Setting("HORizontal:FASTframe:SELECTED:CH#", "frames.selected#.frame", _FRAME),
    Setting("HORizontal:FASTframe:REF:FRAme", "frames.reference", _FRAME),
    Setting("HORizontal:FASTframe:FRAMELock", "frames.locked", boolean, effect=False),
    Setting("HORizontal:FASTframe:TRACk", "frames.tracking", keyword("LIVE", "ALL"), effect=False),
    Setting(
        "HORizontal:FASTframe:MULtipleframes:MODe",
        "frames.overlay",
        keyword("OFF", "OVERlay", "ONLYOVERlay"),
        effect=False,
    ),
    Setting(
        "HORizontal:FASTframe:MULtipleframes:FRAMESTart:CH#", "frames.selected#.overlay_start", _FRAME, effect=False
    ),
    Setting(
        "HORizontal:FASTframe:MULtipleframes:NUMFRames:CH#", "frames.selected#.overlay_count", _FRAME, effect=False
    ),
    Query("HORizontal:FASTframe:TIMEStamp:FRAMe:CH#?", "stamps.of_frame", _FRAME),
    Query("HORizontal:FASTframe:TIMEStamp:ALL:CH#?", "stamps.of_frames", *_SPAN),
    Query("HORizontal:FASTframe:TIMEStamp:DELTa:CH#?", "stamps.to_reference"),
    Query("HORizontal:FASTframe:TIMEStamp:BETWeen:CH#?", "stamps.between", *_SPAN),
    Query("HORizontal:FASTframe:TIMEStamp:SELECTED:CH#?", "stamps.of_selected"),
    Query("HORizontal:FASTframe:XZEro:FRAme:CH#?", "stamps.offset", _FRAME),
    Query("HORizontal:FASTframe:XZEro:ALL:CH#?", "stamps.offsets", *_SPAN),
)


@dataclass
class Shown:
    """Which frames of one channel are on the screen."""

    frame: int = 1
    overlay_start: int = 1
    overlay_count: int = 1


@dataclass
class FastFrame:
    """FastFrame settings."""

    on: bool = False
    count: int = 2
    sequence: str = "FIRst"
    summary: str = "NONe"
    sixteen_bit: bool = False
    reference: int = 1
    locked: bool = True
    tracking: str = "LIVE"
    overlay: str = "OFF"
    selected: dict[int, Shown] = field(default_factory=lambda: {number: Shown() for number in CHANNELS.values()})


class Timed(Protocol):
    """Frames of one channel: when each was triggered, and how far from a sample (s)."""

    @property
    def times_s(self) -> NDArray[np.float64]:
        """(frames,) virtual time."""

    @property
    def offsets_s(self) -> NDArray[np.float64]:
        """(frames,)."""


class Stamps:
    """The queries for time stamps and trigger offsets of the frames that were acquired.

    Frame numbers outside what was acquired are -222, a channel without any 2241.
    """

    def __init__(self, frames: Callable[[], FastFrame], acquired: Callable[[int], Timed]) -> None:
        self._frames = frames
        self._acquired = acquired

    def of_frame(self, channel: int, frame: int) -> str:
        """Date and time of one frame's trigger."""
        return f'"{date_stamp(self._time(channel, frame))}"'

    def of_frames(self, channel: int, first: int, last: int) -> str:
        """Number, date and time of every frame between two."""
        times = self._acquired(channel).times_s
        return _listed(span(first, last, times.size), lambda index: date_stamp(times[index]))

    def to_reference(self, channel: int) -> str:
        """Time from the reference frame to the selected one."""
        settings = self._frames()
        return self.between(channel, settings.reference, settings.selected[channel].frame)

    def between(self, channel: int, first: int, last: int) -> str:
        """Time from one frame's trigger to another's."""
        return f'"{duration_stamp(self._time(channel, last) - self._time(channel, first))}"'

    def of_selected(self, channel: int) -> str:
        """Date and time of the selected frame's trigger."""
        return self.of_frame(channel, self._frames().selected[channel].frame)

    def offset(self, channel: int, frame: int) -> float:
        """Sub-sample time of one frame's trigger (s)."""
        offsets = self._acquired(channel).offsets_s
        return float(offsets[span(frame, frame, offsets.size)[0]])

    def offsets(self, channel: int, first: int, last: int) -> str:
        """Number and sub-sample trigger time (s) of every frame between two."""
        offsets = self._acquired(channel).offsets_s
        return _listed(span(first, last, offsets.size), lambda index: nr3(offsets[index]))

    def _time(self, channel: int, frame: int) -> float:
        times = self._acquired(channel).times_s
        return float(times[span(frame, frame, times.size)[0]])


def span(first: int, last: int, acquired: int) -> range:
    """Indices of the frames from `first` to `last` (from 1, inclusive, in any order); -222 where none was acquired."""
    first, last = min(first, last), max(first, last)
    if last > acquired:
        raise ScpiError(-222, f"frame {last} of {acquired}")
    return range(first - 1, last)


def _listed(frames: range, item: Callable[[int], str]) -> str:
    return ",".join(f'"{index + 1}: {item(index)}"' for index in frames)


def date_stamp(time_s: float) -> str:
    """Virtual time as `01 JAN 2026 00:00:00.400 000 012 500`."""
    seconds, picoseconds = divmod(round(time_s * 1e12), 10**12)
    return f"{_date(seconds)}.{_grouped(picoseconds)}"


def duration_stamp(seconds: float) -> str:
    """A time difference as `00:00:00.000 100 000 000`, with a sign when it is negative."""
    sign = "-" if seconds < 0 else ""
    whole, picoseconds = divmod(round(abs(seconds) * 1e12), 10**12)
    return f"{sign}{whole // 3600:02}:{whole // 60 % 60:02}:{whole % 60:02}.{_grouped(picoseconds)}"


@lru_cache(maxsize=8)  # the frames of a burst share a few seconds
def _date(seconds: int) -> str:
    moment = SWITCHED_ON + timedelta(seconds=seconds)
    return f"{moment.day:02} {_MONTHS[moment.month - 1]} {moment.year} {moment:%H:%M:%S}"


def _grouped(picoseconds: int) -> str:
    digits = f"{picoseconds:012}"
    return f"{digits[:3]} {digits[3:6]} {digits[6:9]} {digits[9:]}"
