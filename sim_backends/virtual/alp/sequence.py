"""One sequence in the memory of the virtual DMD: its controls, its timing, and room for its pictures.

Source: instrument facts 4.2; times in microseconds, as the interface has them.
"""

import numpy as np

from sim_backends.optics.mirrors import SIDE
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.alp import codes

LEAST_PICTURE_US = 44  # uninterrupted; otherwise that of the shortest illumination and the dark phase
LEAST_ILLUMINATE_US = 8  # recalled
DARK_US = 44  # at the end of each picture, unless they are shown uninterrupted
LONGEST_PICTURE_US = 10_000_000
LONGEST_DELAY_US = 130_000
DEFAULT_PICTURE_US = 33_334  # 30 Hz
MOST_REPEATS = 1_048_576  # recalled

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
        uninterrupted: whether pictures are shown without dark phase: the binary mode that the latest SeqTiming has
            activated. A sequence that was not timed since is shown in the mode before (vendor's sample in C).
        counts: mirrors on in every superpixel, (pictures, 784).
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
        self.counts = np.zeros((pictures, SIDE**2), np.uint16)  # dark until something is loaded

    @property
    def memory(self) -> int:
        """Binary frames of on-board memory taken."""
        return self.bit_planes * self.pictures

    @property
    def frames(self) -> int:
        """Pictures of one finite run, repetitions counted."""
        return (self.controls[codes.LAST_FRAME] - self.controls[codes.FIRST_FRAME] + 1) * self.controls[codes.REPEAT]

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
            codes.LEAST_PICTURE_TIME: _least_picture_us(uninterrupted=self.uninterrupted),
            codes.LEAST_ILLUMINATE_TIME: LEAST_ILLUMINATE_US,
            **self.controls,
            **self.timing,
        }
        if kind not in facts:
            raise ScpiError(codes.PARAMETER_INVALID)
        return facts[kind]

    def set_timing(self, illuminate: int, picture: int, delay: int, width: int, trigger_delay: int) -> None:
        """`SeqTiming` (us, 0: default); 1005 outside the limits. It activates the binary mode that was set.

        Picture and illumination time follow from each other by the dark time; with neither given it is 30 Hz.
        """
        uninterrupted = self.controls[codes.BINARY_MODE] == codes.UNINTERRUPTED
        dark = 0 if uninterrupted else DARK_US
        picture = picture or (illuminate + dark if illuminate else DEFAULT_PICTURE_US)
        illuminate = illuminate or max(picture - dark, LEAST_ILLUMINATE_US)
        width = width or illuminate
        if not (
            _least_picture_us(uninterrupted=uninterrupted) <= picture <= LONGEST_PICTURE_US
            and LEAST_ILLUMINATE_US <= illuminate <= picture - dark
            and 0 <= delay <= min(LONGEST_DELAY_US, picture)
            and 0 < width <= picture
            and 0 <= trigger_delay <= LONGEST_DELAY_US
        ):
            raise ScpiError(codes.PARAMETER_INVALID)
        self.uninterrupted = uninterrupted
        self.timing = {
            codes.PICTURE_TIME: picture,
            codes.ILLUMINATE_TIME: illuminate,
            codes.SYNCH_DELAY: delay,
            codes.SYNCH_PULSE_WIDTH: width,
            codes.TRIGGER_IN_DELAY: trigger_delay,
        }


def _least_picture_us(*, uninterrupted: bool) -> int:
    return LEAST_PICTURE_US if uninterrupted else LEAST_ILLUMINATE_US + DARK_US
