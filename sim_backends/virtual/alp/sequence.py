"""One sequence in the memory of the virtual DMD: its pictures, its controls, its timing.

Source: instrument facts 4.2; times in microseconds, as the interface has them.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics.mirrors import COLUMNS, ROWS, SIDE, on_counts
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.alp import codes

LEAST_PICTURE_US = 44
LEAST_ILLUMINATE_US = 8  # recalled
DARK_US = 44  # between the pictures, unless they are shown uninterrupted
LONGEST_PICTURE_US = 10_000_000
LONGEST_DELAY_US = 130_000
DEFAULT_PICTURE_US = 33_334  # 30 Hz
MOST_REPEATS = 1_048_576  # recalled

BYTES_PER_ROW = COLUMNS // 8

_CHOICES = {
    codes.BINARY_MODE: (codes.NORMAL, codes.UNINTERRUPTED),
    codes.DATA_FORMAT: (codes.MSB_ALIGN, codes.LSB_ALIGN, codes.BINARY_TOPDOWN, codes.BINARY_BOTTOMUP),
}


class Sequence:
    """Pictures of `bit_planes` planes each.

    Of a picture only the most significant plane counts: it is what a still picture shows; and of that only the mirrors
    on in every superpixel are kept, for no call reads pictures back.

    Attributes:
        controls: what SeqControl sets.
        timing: what SeqTiming sets (us).
    """

    def __init__(self, bit_planes: int, pictures: int) -> None:
        self.bit_planes = bit_planes
        self.pictures = pictures
        self.controls = {
            codes.REPEAT: 1,
            codes.FIRST_FRAME: 0,
            codes.LAST_FRAME: pictures - 1,
            codes.BIT_NUMBER: bit_planes,
            codes.BINARY_MODE: codes.NORMAL,
            codes.DATA_FORMAT: codes.MSB_ALIGN,
        }
        self.timing: dict[int, int] = {}
        self.set_timing(0, 0, 0, 0, 0)
        self._counts = np.zeros((pictures, SIDE**2), np.uint16)  # dark until something is loaded

    @property
    def memory(self) -> int:
        """Binary frames of on-board memory taken."""
        return self.bit_planes * self.pictures

    @property
    def frames(self) -> int:
        """Pictures of one finite run, repetitions counted."""
        return (self.controls[codes.LAST_FRAME] - self.controls[codes.FIRST_FRAME] + 1) * self.controls[codes.REPEAT]

    @property
    def picture_time_s(self) -> float:
        """Time from picture to picture (s)."""
        return 1e-6 * self.timing[codes.PICTURE_TIME]

    @property
    def shown(self) -> NDArray[np.uint16]:
        """Mirrors on in every superpixel (n, 784) of the pictures from FIRST_FRAME to LAST_FRAME."""
        return self._counts[self.controls[codes.FIRST_FRAME] : self.controls[codes.LAST_FRAME] + 1]

    def put(self, first: int, count: int, data: NDArray[np.uint8]) -> int:
        """Load `count` pictures (0: all from `first` on) in the present data format; returns how many.

        Raises ScpiError: 1005 beyond the sequence, 1006 when the data have another length.
        """
        count = count or self.pictures - first
        if count <= 0 or first + count > self.pictures:
            raise ScpiError(codes.PARAMETER_INVALID)
        self._counts[first : first + count] = on_counts(self._unpacked(data, count))
        return count

    def _unpacked(self, data: NDArray[np.uint8], count: int) -> NDArray[np.uint8]:
        """Mirror bits (count, 768, 128) of the uploaded bytes; packed top-down ones are not copied."""
        form = self.controls[codes.DATA_FORMAT]
        if form in (codes.BINARY_TOPDOWN, codes.BINARY_BOTTOMUP):
            if self.bit_planes > 1:
                raise ScpiError(codes.PARAMETER_INVALID)
            frames = _shaped(data, (count, ROWS, BYTES_PER_ROW))
            return frames if form == codes.BINARY_TOPDOWN else frames[:, ::-1]
        pixels = _shaped(data, (count, ROWS, COLUMNS))
        bit = 7 if form == codes.MSB_ALIGN else self.bit_planes - 1
        return np.packbits(pixels & np.uint8(1 << bit), axis=2)

    def control(self, kind: int, value: int) -> None:
        """`SeqControl`; 1005 for what it does not take."""
        limits = {
            codes.REPEAT: (1, MOST_REPEATS),
            codes.FIRST_FRAME: (0, self.controls[codes.LAST_FRAME]),
            codes.LAST_FRAME: (self.controls[codes.FIRST_FRAME], self.pictures - 1),
            codes.BIT_NUMBER: (1, self.bit_planes),
        }
        if kind in limits:
            low, high = limits[kind]
            allowed = low <= value <= high
        else:
            allowed = value in _CHOICES.get(kind, ())
        if not allowed:
            raise ScpiError(codes.PARAMETER_INVALID)
        self.controls[kind] = value

    def inquire(self, kind: int) -> int:
        """`SeqInquire`; 1005 for an unknown kind."""
        facts = {
            codes.BIT_PLANES: self.bit_planes,
            codes.PICTURES: self.pictures,
            codes.LEAST_PICTURE_TIME: LEAST_PICTURE_US,
            codes.LEAST_ILLUMINATE_TIME: LEAST_ILLUMINATE_US,
            **self.controls,
            **self.timing,
        }
        if kind not in facts:
            raise ScpiError(codes.PARAMETER_INVALID)
        return facts[kind]

    def set_timing(self, illuminate: int, picture: int, delay: int, width: int, trigger_delay: int) -> None:
        """`SeqTiming` (us, 0: default); 1005 outside the limits.

        Picture and illumination time follow from each other by the dark time; with neither given it is 30 Hz.
        """
        dark = 0 if self.controls[codes.BINARY_MODE] == codes.UNINTERRUPTED else DARK_US
        picture = picture or (illuminate + dark if illuminate else DEFAULT_PICTURE_US)
        illuminate = illuminate or max(picture - dark, LEAST_ILLUMINATE_US)
        width = width or illuminate
        if not (
            LEAST_PICTURE_US <= picture <= LONGEST_PICTURE_US
            and LEAST_ILLUMINATE_US <= illuminate <= picture
            and 0 <= delay <= min(LONGEST_DELAY_US, picture)
            and 0 < width <= picture
            and 0 <= trigger_delay <= LONGEST_DELAY_US
        ):
            raise ScpiError(codes.PARAMETER_INVALID)
        self.timing = {
            codes.PICTURE_TIME: picture,
            codes.ILLUMINATE_TIME: illuminate,
            codes.SYNCH_DELAY: delay,
            codes.SYNCH_PULSE_WIDTH: width,
            codes.TRIGGER_IN_DELAY: trigger_delay,
        }


def _shaped(data: NDArray[np.uint8], shape: tuple[int, int, int]) -> NDArray[Any]:
    if data.size != shape[0] * shape[1] * shape[2]:
        raise ScpiError(codes.USER_DATA_ERROR)
    return data.reshape(shape)
