"""What a DPO72504DX says of its records: what codes mean, where points lie in time, when frames were triggered.

volts = (code - YOFf) YMUlt + YZEro, t = XZEro + XINcr (i - PT_Off) with t = 0 at the trigger. Sources: DPO/DSA/MSO70000
series programmer manual, WFMOutpre; lists of FastFrame as public parsers of such scopes read them, `"1: ...","2: ..."`.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from instruments.errors import SettingChanged, excerpt
from instruments.tektronix_dpo72504dx_settings import OFFSET_TOLERANCE_DIV, SCALE_TOLERANCE
from instruments.values import Codes, Scaling, Timebase, Vertical
from instruments.visa import number_in

CODES_PER_DIVISION = 25
FINER = 256
"""Codes of a mean for one of a single trigger."""
CLIP_LOW, CLIP_HIGH = -127, 126
"""Codes at the ends of the range (a public FastFrame capture script)."""
ELSEWHERE = "its settings were changed from elsewhere, leave it to this program"
PREAMBLE = tuple(f"WFMOutpre:{field}?" for field in ("YMUlt", "YZEro", "YOFf", "PT_Off"))
"""What stays the same from record to record."""
_SMALLEST_PART = 6
"""Digits of a sample: below, it is what numbers were rounded to."""


@dataclass(frozen=True)
class Meaning:
    """What the codes of a channel mean, and how much later than asked for the first one's place in time is, s."""

    scaling: Scaling
    late_s: float


def meaning(channel: str, preamble: Sequence[str], timebase: Timebase) -> Meaning:
    """What a preamble says of `channel`, as messages name it.

    Raises:
        SettingChanged: it is none of numbers.
    """
    numbers = [number for answer in preamble if (number := number_in(answer)) is not None]
    if len(numbers) < len(PREAMBLE):
        raise SettingChanged(f"{channel} is described by {preamble}: {ELSEWHERE}")
    multiplier, zero, offset, trigger_point = numbers
    late = round(-trigger_point - timebase.delay_s * timebase.sample_rate, _SMALLEST_PART)
    return Meaning(Scaling(scale_v=multiplier, offset_v=zero - offset * multiplier), late / timebase.sample_rate)


def require_range(channel: str, wanted: Vertical, found: Vertical) -> None:
    """Compare the range that a preamble describes with the one that was set.

    Raises:
        SettingChanged: it is another one.
    """
    scale = wanted.scale_v_per_div
    far = abs(found.scale_v_per_div - scale) > SCALE_TOLERANCE * scale
    if far or abs(found.offset_v - wanted.offset_v) > OFFSET_TOLERANCE_DIV * scale:
        raise SettingChanged(
            f"{channel} was set to {scale:.4g} V/div at {wanted.offset_v:.4g} V, its preamble says "
            f"{found.scale_v_per_div:.4g} V/div at {found.offset_v:.4g} V: {ELSEWHERE}"
        )


def require_source(instrument: str, channel: int, source: str) -> None:
    """Compare the source of a record with the channel that was asked for.

    Raises:
        SettingChanged: it is another one.
    """
    if source.upper() != f"CH{channel}":
        raise SettingChanged(f"{instrument}: asked for CH{channel}, got {excerpt(source)}: {ELSEWHERE}")


def mean(codes: Codes, finer: int) -> NDArray[np.int16]:
    """The mean of frames (frames, points), each with the same weight, in codes so many times as fine."""
    fine: NDArray[np.int16] = np.rint(codes.sum(axis=0, dtype=np.int64) * (finer / len(codes))).astype(np.int16)
    return fine


_NUMBERED = re.compile(r'"(\d+): ([^"]*)"')
_STAMP = re.compile(r"(\d{2} \w{3} \d{4} \d{2}:\d{2}:\d{2})\.(\d{3} \d{3} \d{3} \d{3})")


def frame_times(reply: str) -> NDArray[np.float64]:
    """When frames were triggered, by a list of `DD MON YYYY HH:MM:SS.fff fff fff fff`, s after the first full second.

    Raises:
        ValueError: an item of the list is no date.
    """
    stamps = []
    for item in _items(reply):
        if (match := _STAMP.fullmatch(item)) is None:
            raise ValueError(item)
        stamps.append((match[1], int(match[2].replace(" ", ""))))
    clock = {text: datetime.strptime(text, "%d %b %Y %H:%M:%S") for text in {text for text, _ in stamps}}
    start = min(clock.values(), default=datetime.min)
    return np.array([(clock[text] - start).total_seconds() + picoseconds * 1e-12 for text, picoseconds in stamps])


def frame_offsets(reply: str) -> NDArray[np.float64]:
    """How much later than their place in time the points of frames lie, s, by a list of numbers.

    Raises:
        ValueError: an item of the list is no number.
    """
    return np.array([float(item) for item in _items(reply)])


def _items(reply: str) -> list[str]:
    """The items of a list of frames, in the order of their numbers, which begin with 1 and leave none out.

    Raises:
        ValueError: it is no such list.
    """
    found = _NUMBERED.findall(reply)
    if [int(number) for number, _ in found] != list(range(1, len(found) + 1)):
        raise ValueError(reply)
    return [item for _, item in found]
