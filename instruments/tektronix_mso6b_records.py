"""What a 6 Series B MSO says of the frames of its records: when they were triggered, and how far beside a sample.

Sources: programmer manual of the 4/5/6 Series MSO, as the package tm_devices has it: "Frame #: TimeStamp, Frame #:
TimeStamp" with stamps DD.MM.YYYY.HH:MM::SS.xxxxxxxxxxxx, and "frame #:xzero, frame #:xzero". The manual's layout leaves
open whether there are quotes, blanks and one colon or two: all of that is read.
"""

import re
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

_STAMP = re.compile(r"(\d+)\s*:\s*(\d{1,2}\.\d{1,2}\.\d{4})[.\s]+(\d{1,2}:\d{2}):{1,2}(\d{2})\.(\d{12})")
_OFFSET = re.compile(r"(\d+)\s*:\s*([-+]?[\d.]+(?:[Ee][-+]?\d+)?)")


def frame_times(reply: str) -> NDArray[np.float64]:
    """When frames were triggered, s after the first full second.

    Raises:
        ValueError: it is no list of stamps, in the order of the frames.
    """
    found = _STAMP.findall(reply)
    _require_order([number for number, *_ in found], reply)
    clock = [datetime.strptime(f"{date} {time}:{second}", "%d.%m.%Y %H:%M:%S") for _, date, time, second, _ in found]
    start = min(clock)
    parts = zip(clock, found, strict=True)
    return np.array([(moment - start).total_seconds() + int(stamp[-1]) * 1e-12 for moment, stamp in parts])


def frame_offsets(reply: str) -> NDArray[np.float64]:
    """How much later than their place in time the points of frames lie, s.

    Raises:
        ValueError: it is no list of numbers, in the order of the frames.
    """
    found = _OFFSET.findall(reply)
    _require_order([number for number, _ in found], reply)
    return np.array([float(offset) for _, offset in found])


def _require_order(numbers: list[str], reply: str) -> None:
    """Frames are numbered from 1 on, and none is left out.

    Raises:
        ValueError: they are not.
    """
    if not numbers or [int(number) for number in numbers] != list(range(1, len(numbers) + 1)):
        raise ValueError(reply)
