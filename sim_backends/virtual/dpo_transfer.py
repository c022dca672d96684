"""Waveform transfer of the virtual oscilloscope: what is sent, how it is encoded, and the preamble that explains it.

Source: instrument facts 2.7. volts = (level - YOFf) * YMUlt + YZEro with YOFf always 0; t = XZEro + XINcr (i - PT_Off).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.arguments import integer, keyword, quoted, real, several
from sim_backends.scpi.commands import Action, Chunk, Query, Setting, definite_block
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.dpo_settings import CHANNELS, DIVISIONS, RECORD_SHOWN, Vertical
from sim_backends.world import Acquisition

CODES_PER_DIVISION = 25
NO_CODES = np.empty(0, np.int8)
LAST_POINT = 10**15  # DATa:STOP accepts any number: clients send 1E12 for "all"

Codes = NDArray[np.int8] | NDArray[np.int16]

_CHANNEL = keyword(*CHANNELS)
_ENCODINGS = {  # DATa:ENCdg: number format, byte order
    "RIBinary": ("RI", "MSB"),
    "RPBinary": ("RP", "MSB"),
    "FPBinary": ("FP", "MSB"),
    "SRIbinary": ("RI", "LSB"),
    "SRPbinary": ("RP", "LSB"),
    "SFPbinary": ("FP", "LSB"),
}
_DTYPES = {("RI", 1): "i1", ("RI", 2): "i2", ("RP", 1): "u1", ("RP", 2): "u2", ("FP", 4): "f4"}

PREAMBLE = (
    Setting("WFMOutpre:BYT_Nr", "transfer.width", integer(1, 2)),
    Setting("WFMOutpre:BIT_Nr?", "transfer.bits", integer()),
    Setting("WFMOutpre:ENCdg", "transfer.words", keyword("ASCii", "BINary")),
    Setting("WFMOutpre:BN_Fmt", "transfer.number_format", keyword("RI", "RP", "FP")),
    Setting("WFMOutpre:BYT_Or", "transfer.byte_order", keyword("MSB", "LSB")),
    Setting("WFMOutpre:WFId?", "preamble.description", quoted),
    Setting("WFMOutpre:NR_Pt?", "preamble.points", integer()),
    Setting("WFMOutpre:PT_Fmt?", "preamble.point_format", keyword("Y")),
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
    Action("DATa", "initialise_transfer", keyword("INIT")),
    Setting("DATa:SOUrce", "transfer.sources", several(_CHANNEL)),
    Setting("DATa:STARt", "transfer.start", integer(1, LAST_POINT)),
    Setting("DATa:STOP", "transfer.stop", integer(1, LAST_POINT)),
    Setting("DATa:ENCdg", "transfer.encoding", keyword("ASCIi", "FAStest", *_ENCODINGS)),
    Setting("DATa:WIDth", "transfer.width", integer(1, 2)),
    *PREAMBLE,
    Query("WFMOutpre?", "whole_preamble", labelled=True),
    Query("CURVe?", "curve"),
)


@dataclass
class Transfer:
    """What CURVe? sends: sources, first and last point (from 1, inclusive), encoding."""

    sources: tuple[str, ...] = ("CH1",)
    start: int = 1
    stop: int = RECORD_SHOWN
    words: str = "BINary"
    number_format: str = "RI"
    byte_order: str = "MSB"
    _width: int = 1

    @property
    def width(self) -> int:
        """Bytes a point: 1 or 2 as set, 4 for floating point."""
        return 4 if self.number_format == "FP" else self._width

    @width.setter
    def width(self, count: int) -> None:
        self._width = count

    @property
    def bits(self) -> int:
        """Bits a point."""
        return 8 * self.width

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


@dataclass(eq=False, slots=True)
class Trace:
    """One channel of an acquisition and what its codes mean.

    Attributes:
        channel: 1..4.
        codes: (n,) int8, 25 codes a division; averages int16, 256 times as fine.
        acquisition: when the samples were taken.
        trigger_sample: index of the sample at the trigger.
        trigger_offset_s: how much later than that sample's grid point it was taken.
        vertical: how volts became codes.
    """

    channel: int
    codes: Codes
    acquisition: Acquisition
    trigger_sample: int
    trigger_offset_s: float
    vertical: Vertical

    def levels(self, first: int, last: int, number_format: str, width: int) -> NDArray[np.generic]:
        """Points `first` to `last` (exclusive) in native byte order; no copy when the codes are wanted as they are."""
        codes = self.codes[first:last]
        fine = codes.dtype == np.int16
        if number_format == "FP":
            return codes.astype(np.float32) / np.float32(256 if fine else 1)
        if width == 1:
            levels = np.clip(np.rint(codes / 256), -128, 127).astype(np.int8) if fine else codes
        else:
            levels = codes if fine else codes.astype(np.int16) << 8
        if number_format == "RP":
            return np.asarray(levels.astype(np.int32) + 2 ** (8 * width - 1), f"u{width}")
        return levels

    def curve(self, transfer: Transfer) -> list[Chunk]:
        """The points that `transfer` asks for, as CURVe? sends them; 2241 when there are none."""
        first, last = transfer.start - 1, min(transfer.stop, self.acquisition.samples)
        if first >= last:
            raise ScpiError(2241, f"DATa:STARt {transfer.start}, DATa:STOP {transfer.stop}, {last} points")
        levels = self.levels(first, last, transfer.number_format, transfer.width)
        if transfer.words == "ASCii":
            return [",".join(map(str, levels.tolist())).encode()]
        order = "<" if transfer.byte_order == "LSB" else ">"
        wanted = levels.astype(order + _DTYPES[transfer.number_format, transfer.width], copy=False)
        return definite_block(wanted.data.cast("B"))


@dataclass(frozen=True)
class Preamble:
    """The preamble of one trace under the present transfer settings."""

    trace: Trace
    transfer: Transfer

    point_format = "Y"
    point_order = "LINEAR"
    x_unit = "s"
    y_unit = "V"
    y_offset = 0.0
    frames = 1

    @property
    def description(self) -> str:
        """WFId: the trace in words."""
        trace = self.trace
        mode = "Average" if trace.codes.dtype == np.int16 else "Sample"
        samples, rate = trace.acquisition.samples, trace.acquisition.sample_rate
        return (
            f"Ch{trace.channel}, DC coupling, {trace.vertical.scale_v:g} V/div, {samples / rate / DIVISIONS:g} s/div, "
            f"{samples} points, {mode} mode"
        )

    @property
    def points(self) -> int:
        """Points that CURVe? sends."""
        return max(0, min(self.transfer.stop, self.trace.acquisition.samples) - self.transfer.start + 1)

    @property
    def x_increment_s(self) -> float:
        """Time between points."""
        return 1.0 / self.trace.acquisition.sample_rate

    @property
    def x_zero_s(self) -> float:
        """Sub-sample time of the trigger."""
        return self.trace.trigger_offset_s

    @property
    def trigger_point(self) -> int:
        """The trigger's point, counted from DATa:STARt."""
        return self.trace.trigger_sample - (self.transfer.start - 1)

    @property
    def y_multiplier_v(self) -> float:
        """Volts a level: 256 times finer with two bytes a point."""
        return self.trace.vertical.scale_v / CODES_PER_DIVISION / (256 if self.transfer.width == 2 else 1)

    @property
    def y_zero_v(self) -> float:
        """Position and offset together."""
        return self.trace.vertical.zero_v
