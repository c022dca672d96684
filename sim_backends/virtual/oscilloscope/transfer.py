"""Waveform transfer of the virtual oscilloscope: what is sent, how it is encoded, and the preamble that explains it.

Source: instrument facts 2.7. volts = (level - YOFf) * YMUlt + YZEro with YOFf always 0; t = XZEro + XINcr (i - PT_Off).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.arguments import boolean, integer, keyword, nr3, quoted, real, several
from sim_backends.scpi.commands import Action, Query, Setting, definite_block
from sim_backends.scpi.messages import Chunk
from sim_backends.virtual.oscilloscope.horizontal import DIVISIONS, RECORD_SHOWN
from sim_backends.virtual.oscilloscope.modes import Codes
from sim_backends.virtual.oscilloscope.plan import Plan
from sim_backends.virtual.oscilloscope.vertical import CHANNELS, Vertical

CODES_PER_DIVISION = 25
LAST_POINT = 10**15  # DATa:STOP accepts any number: clients send 1E12 for "all"

_SOURCE = keyword(*CHANNELS, *(f"{kind}{number}" for kind in ("MATH", "REF") for number in (1, 2, 3, 4)))
_ENCODINGS = {  # DATa:ENCdg: number format, byte order
    "RIBinary": ("RI", "MSB"),
    "RPBinary": ("RP", "MSB"),
    "FPBinary": ("FP", "MSB"),
    "SRIbinary": ("RI", "LSB"),
    "SRPbinary": ("RP", "LSB"),
    "SFPbinary": ("FP", "LSB"),
}
_DTYPES = {("RI", 1): "i1", ("RI", 2): "i2", ("RP", 1): "u1", ("RP", 2): "u2", ("FP", 4): "f4"}

_MODES = {
    "SAMple": "Sample",
    "PEAKdetect": "Peak detect",
    "HIRes": "Hi res",
    "AVErage": "Average",
    "ENVelope": "Envelope",
}

PREAMBLE = (
    Setting("WFMOutpre:BYT_Nr", "transfer.width", integer()),
    Setting("WFMOutpre:BIT_Nr", "transfer.bits", integer()),
    Setting("WFMOutpre:ENCdg", "transfer.words", keyword("ASCii", "BINary")),
    Setting("WFMOutpre:BN_Fmt", "transfer.number_format", keyword("RI", "RP", "FP")),
    Setting("WFMOutpre:BYT_Or", "transfer.byte_order", keyword("MSB", "LSB")),
    Setting("WFMOutpre:WFId?", "preamble.description", quoted),
    Setting("WFMOutpre:NR_Pt?", "preamble.points", integer()),
    Setting("WFMOutpre:PT_Fmt?", "preamble.point_format", keyword("Y", "ENV")),
    Setting("WFMOutpre:PT_ORder?", "preamble.point_order", keyword("LINEAR")),
    Setting("WFMOutpre:XUNit?", "preamble.x_unit", quoted),
    Setting("WFMOutpre:XINcr?", "preamble.x_increment_s", real()),
    Setting("WFMOutpre:XZEro?", "preamble.x_zero_s", real()),
    Setting("WFMOutpre:PT_Off?", "preamble.trigger_point", integer()),
    Setting("WFMOutpre:YUNit?", "preamble.y_unit", quoted),
    Setting("WFMOutpre:YMUlt?", "preamble.y_multiplier_v", real()),
    Setting("WFMOutpre:YOFf?", "preamble.y_offset", real()),
    Setting("WFMOutpre:YZEro?", "preamble.y_zero_v", real()),
    Setting("WFMOutpre:NR_FR?", "preamble.frames", integer()),
)

TRANSFER_COMMANDS = (
    Action("DATa", "preset_transfer", keyword("INIT", "SNAp")),
    Setting("DATa:SOUrce", "transfer.sources", several(_SOURCE)),
    Setting("DATa:STARt", "transfer.start", integer(1, LAST_POINT)),
    Setting("DATa:STOP", "transfer.stop", integer(1, LAST_POINT)),
    Setting("DATa:FRAMESTARt", "transfer.frame_start", integer(1, LAST_POINT)),
    Setting("DATa:FRAMESTOP", "transfer.frame_stop", integer(1, LAST_POINT)),
    Setting("DATa:SYNCSOUrces", "transfer.synchronous_sources", boolean, effect=False),
    Setting("DATa:ENCdg", "transfer.encoding", keyword("ASCIi", "FAStest", *_ENCODINGS)),
    Setting("DATa:WIDth", "transfer.width", integer(1, 2)),
    *PREAMBLE,
    Query("WFMOutpre?", "whole_preamble", labelled=True),
    Query("CURVe?", "curve"),
    Query("CURVENext?", "curve", waits="lacks_new"),
    Query("CURVEStream?", "curve", waits="lacks_new", endless=True),
    Query("WAVFrm?", "preamble_and_curve", labelled=True),
    Query("WAVFRMStream?", "preamble_and_curve", waits="lacks_new", endless=True, labelled=True),
)


@dataclass
class Transfer:
    """What CURVe? sends: sources, first and last point and frame (from 1, inclusive, in any order), encoding."""

    sources: tuple[str, ...] = ("CH1",)
    start: int = 1
    stop: int = RECORD_SHOWN
    frame_start: int = 1
    frame_stop: int = LAST_POINT
    synchronous_sources: bool = False
    words: str = "BINary"
    byte_order: str = "MSB"
    _number_format: str = "RI"
    _width: int = 1

    @property
    def number_format(self) -> str:
        """RI, RP or FP; of a channel, whose points are no floating-point numbers, RI in the place of FP."""
        return "RI" if self._number_format == "FP" and self.sources[0] in CHANNELS else self._number_format

    @number_format.setter
    def number_format(self, word: str) -> None:
        self._number_format = word

    @property
    def width(self) -> int:
        """Bytes a point: 1 or 2, the nearest to what is set, 4 for floating point. 8 would be a pixel map's."""
        return 4 if self.number_format == "FP" else self._width

    @width.setter
    def width(self, count: int) -> None:
        self._width = 1 if count <= 1 else 2

    @property
    def bits(self) -> int:
        """Bits a point: 8, or 16 where that many are set, 32 for floating point."""
        return 8 * self.width

    @bits.setter
    def bits(self, count: int) -> None:
        self.width = count // 8

    @property
    def last(self) -> int:
        """The last point that is sent of a record that is long enough."""
        return max(self.start, self.stop)

    def points(self, samples: int) -> range:
        """Which of a record's samples; beyond its end, its last one."""
        return _within(self.start, self.stop, samples)

    def frames(self, acquired: int) -> range:
        """Which of the acquired frames; beyond their end, the last one."""
        return _within(self.frame_start, self.frame_stop, acquired)

    @property
    def encoding(self) -> str:
        """`DATa:ENCdg`: text, or number format and byte order in one word; FAStest is RIBinary here."""
        if self.words == "ASCii":
            return "ASCIi"
        return next(word for word, form in _ENCODINGS.items() if form == (self.number_format, self.byte_order))

    @encoding.setter
    def encoding(self, word: str) -> None:
        if word == "ASCIi":
            self.words = "ASCii"
        else:
            self.words = "BINary"
            self.number_format, self.byte_order = _ENCODINGS["RIBinary" if word == "FAStest" else word]


def _within(first: int, last: int, count: int) -> range:
    first, last = min(first, last), max(first, last)
    return range(min(first, max(count, 1)) - 1, min(last, count))


@dataclass(eq=False, slots=True)
class Trace:
    """One channel of an acquisition, or what was computed of it, and what its codes mean.

    Attributes:
        channel: 1..4, 0 for a computed waveform.
        codes: (frames, samples) int8, 25 codes a division; averages and those of a finer digitiser int16, 256 times as
            fine.
        plan: How the samples were taken.
        vertical: How volts became codes.
        times_s: (frames,) when each frame was triggered, virtual time.
        offsets_s: (frames,) how much later than the grid point of the trigger's sample that sample was taken.
        values: (frames, samples) of a computed waveform, whose codes are these rounded; None: there is none but codes.
        unit: Of what the codes mean.
    """

    channel: int
    codes: Codes
    plan: Plan
    vertical: Vertical
    times_s: NDArray[np.float64]
    offsets_s: NDArray[np.float64]
    values: NDArray[np.float64] | None = None
    unit: str = "V"

    @property
    def samples(self) -> int:
        """Samples of each frame."""
        return self.plan.acquisition.samples

    @property
    def step_s(self) -> float:
        """Between points."""
        return 1.0 / self.plan.acquisition.sample_rate

    @property
    def start_s(self) -> float:
        """Time of the first frame's first point behind its trigger."""
        return float(self.offsets_s[0]) - self.plan.trigger_sample * self.step_s

    @property
    def zero(self) -> float:
        """What code 0 means: position and offset together."""
        return self.vertical.offset_v - self.vertical.position_div * self.vertical.scale_v

    def physical(self) -> NDArray[np.float64]:
        """(frames, samples) in `unit`."""
        if self.values is not None:
            return self.values
        fine = 256 if self.codes.dtype == np.int16 else 1
        codes = self.codes.astype(np.float64)
        return codes * (self.vertical.scale_v / CODES_PER_DIVISION / fine) + self.zero

    def sent_as_numbers(self, transfer: Transfer) -> bool:
        """Whether points go out as the numbers they mean, not as levels: text or floating point of computed ones."""
        return self.values is not None and (transfer.words == "ASCii" or transfer.number_format == "FP")

    def levels(self, transfer: Transfer) -> NDArray[np.generic]:
        """Points (frames, points) in native byte order; no copy when whole frames are wanted as they are."""
        frames, points = transfer.frames(self.codes.shape[0]), transfer.points(self.samples)
        if self.values is not None and self.sent_as_numbers(transfer):
            return self.values[frames.start : frames.stop, points.start : points.stop]
        codes = self.codes[frames.start : frames.stop, points.start : points.stop]
        fine = codes.dtype == np.int16
        if transfer.number_format == "FP":
            return codes.astype(np.float32) / np.float32(256 if fine else 1)
        if transfer.width == 1:
            levels = np.clip(np.rint(codes / 256), -128, 127).astype(np.int8) if fine else codes
        else:
            levels = codes if fine else codes.astype(np.int16) << 8
        if transfer.number_format == "RP":
            return np.asarray(levels.astype(np.int32) + 2 ** (8 * transfer.width - 1), f"u{transfer.width}")
        return levels

    def curve(self, transfer: Transfer) -> list[Chunk]:
        """The points that `transfer` asks for, as CURVe? sends them: one block, frame after frame."""
        levels = self.levels(transfer)
        if transfer.words == "ASCii":
            write = nr3 if self.sent_as_numbers(transfer) else str
            return [",".join(map(write, levels.ravel().tolist())).encode()]
        order = "<" if transfer.byte_order == "LSB" else ">"
        wanted = levels.astype(order + _DTYPES[transfer.number_format, transfer.width], copy=False)
        return definite_block(np.ascontiguousarray(wanted).data.cast("B"))


@dataclass(frozen=True)
class Preamble:
    """The preamble of one trace under the present transfer settings."""

    trace: Trace
    transfer: Transfer

    point_order = "LINEAR"
    x_unit = "s"
    y_offset = 0.0

    @property
    def y_unit(self) -> str:
        """Of the points."""
        return self.trace.unit

    @property
    def point_format(self) -> str:
        """ENV for points that are lowest and highest in turn."""
        return "ENV" if self.trace.plan.enveloped else "Y"

    @property
    def _source(self) -> str:
        return f"Ch{self.trace.channel}" if self.trace.channel else "Math"

    @property
    def description(self) -> str:
        """WFId: the trace in words."""
        trace = self.trace
        rate = trace.plan.acquisition.sample_rate
        frames = trace.codes.shape[0]
        return (
            f"{self._source}, {'GND' if trace.vertical.grounded else 'DC'} coupling, "
            f"{trace.vertical.scale_v:g} V/div, {trace.samples / rate / DIVISIONS:g} s/div, {trace.samples} points, "
            + (f"{frames} frames, " if frames > 1 else "")
            + f"{_MODES[trace.plan.mode]} mode"
        )

    @property
    def points(self) -> int:
        """Points that CURVe? sends, of each frame."""
        return len(self.transfer.points(self.trace.samples))

    @property
    def frames(self) -> int:
        """Frames that CURVe? sends; 1 before the first acquisition."""
        return len(self.transfer.frames(max(1, self.trace.codes.shape[0])))

    @property
    def x_increment_s(self) -> float:
        """Time between points."""
        return self.trace.step_s

    @property
    def x_zero_s(self) -> float:
        """Sub-sample time of the trigger, of the first frame that is sent."""
        offsets = self.trace.offsets_s
        return float(offsets[self.transfer.frames(offsets.size).start])

    @property
    def trigger_point(self) -> int:
        """The trigger's point, counted from the first one that is sent."""
        return self.trace.plan.trigger_sample - self.transfer.points(self.trace.samples).start

    @property
    def y_multiplier_v(self) -> float:
        """Volts a level: 256 times finer with two bytes a point; 1 where numbers are sent."""
        if self.trace.sent_as_numbers(self.transfer):
            return 1.0
        return self.trace.vertical.scale_v / CODES_PER_DIVISION / (256 if self.transfer.width == 2 else 1)

    @property
    def y_zero_v(self) -> float:
        """Position and offset together; 0 where numbers are sent."""
        return 0.0 if self.trace.sent_as_numbers(self.transfer) else self.trace.zero
