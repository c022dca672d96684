"""The measurements that a client of the virtual oscilloscope sets up: the immediate one and eight slots.

Source: tm_devices 3.7, descriptions of the MEASUrement commands. Statistics take in each acquisition that a query of a
slot meets; the real instrument takes in every one. Gating, histograms and eye diagrams are not simulated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from sim_backends.scpi.arguments import Kind, boolean, integer, keyword, quoted, real
from sim_backends.scpi.commands import Action, Command, Query, Setting
from sim_backends.scpi.messages import Argument, Chunk
from sim_backends.scpi.status import EventStatus, ScpiError
from sim_backends.virtual.dpo72504dx.measurements import (
    BETWEEN,
    MEASURED,
    NO_WAVEFORM,
    UNDEFINED,
    UNMEASURED,
    References,
    Waveform,
    delay,
    phase,
    unit,
)
from sim_backends.virtual.oscilloscope.vertical import CHANNELS

SLOTS = 8
VALUES_KEPT = 10_000  # of the statistics of a slot; bounds the memory

_SOURCE = keyword(*CHANNELS, *(f"{kind}{number}" for kind in ("MATH", "REF") for number in (1, 2, 3, 4)))
_EDGE = keyword("FALL", "RISe")
_PERCENT = real(0, 100)
_SETTINGS: tuple[tuple[str, str, Kind], ...] = (
    ("TYPe", "type", keyword(*sorted((*MEASURED, *BETWEEN, *UNMEASURED)))),
    ("SOUrce#", "inputs#.source", _SOURCE),
    ("SOUrce#:SIGType", "inputs#.signal", keyword("PULse", "EYE")),
    ("DELay:DIREction", "direction", keyword("BACKWards", "FORWards")),
    ("DELay:EDGE#", "inputs#.edge", _EDGE),
)
_SHARED: tuple[tuple[str, str, Kind], ...] = (
    ("METHod", "method", keyword("HIStogram", "MINMax", "MEAN")),
    ("NOISe", "noise", keyword("HIGH", "LOW")),
    ("REFLevel:METHod", "levels_by", keyword("ABSolute", "PERCent")),
    ("REFLevel:ABSolute:HIGH", "high_v", real()),
    ("REFLevel:ABSolute:LOW", "low_v", real()),
    ("REFLevel:ABSolute:MID#", "inputs#.mid_v", real()),
    ("REFLevel:PERCent:HIGH", "high_percent", _PERCENT),
    ("REFLevel:PERCent:LOW", "low_percent", _PERCENT),
    ("REFLevel:PERCent:MID#", "inputs#.mid_percent", _PERCENT),
)


class _Everywhere(Command):
    """A setting of the immediate measurement and of every slot at once; the query tells the immediate one's."""

    def __init__(self, header: str, attribute: str, kind: Kind) -> None:
        super().__init__(header)
        self._immediate = Setting(header, f"measuring.immediate.{attribute}", kind)
        self._slot = Setting(header, f"measuring.slots#.{attribute}", kind)

    def execute(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """Set them all."""
        for number in instrument.measuring.slots:
            self._slot.execute(instrument, (number, *suffixes), arguments)
        return self._immediate.execute(instrument, suffixes, arguments)

    def answer(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """The immediate measurement's."""
        return self._immediate.answer(instrument, suffixes, arguments)


MEASUREMENT_COMMANDS = (
    *(_Everywhere(f"MEASUrement:{name}", attribute, kind) for name, attribute, kind in _SHARED),
    *(
        Setting(f"MEASUrement:{place}:{name}", f"measuring.{owner}.{attribute}", kind)
        for place, owner in (("IMMed", "immediate"), ("MEAS#", "slots#"))
        for name, attribute, kind in (*_SETTINGS, *_SHARED)
    ),
    Setting("MEASUrement:MEAS#:STATE", "measuring.slots#.on", boolean),
    Query("MEASUrement:IMMed:VALue?", "measuring.immediate_value"),
    Setting("MEASUrement:IMMed:UNIts?", "measuring.immediate.unit", quoted),
    Query("MEASUrement:MEAS#:VALue?", "measuring.value"),
    Setting("MEASUrement:MEAS#:UNIts?", "measuring.slots#.unit", quoted),
    *(
        Query(f"MEASUrement:MEAS#:{name}?", f"measuring.{name.lower()}")
        for name in ("COUNt", "MAXimum", "MEAN", "MINImum", "STDdev")
    ),
    Action("MEASUrement:STATIstics:COUNt", "measuring.reset_statistics", keyword("RESET")),
    Setting(
        "MEASUrement:STATIstics:MODe",
        "measuring.statistics",
        keyword("OFF", "ALL", "VALUEMean", "MINMax", "MEANSTDdev"),
        effect=False,
    ),
    Setting("MEASUrement:STATIstics:WEIghting", "measuring.weighting", integer(2, 1000), effect=False),
)


@dataclass
class Input:
    """One of the two waveforms of a measurement."""

    source: str
    edge: str = "RISe"
    signal: str = "PULse"
    mid_v: float = 0.0
    mid_percent: float = 50.0


@dataclass
class Measurement:
    """What is measured, of what, and which levels count."""

    type: str = "UNDEFINED"
    on: bool = False
    direction: str = "FORWards"
    method: str = "HIStogram"
    noise: str = "HIGH"
    levels_by: str = "PERCent"
    high_v: float = 0.0
    low_v: float = 0.0
    high_percent: float = 90.0
    low_percent: float = 10.0
    inputs: dict[int, Input] = field(default_factory=lambda: {1: Input("CH1"), 2: Input("CH2")})

    @property
    def unit(self) -> str:
        """The unit of its value."""
        return unit(self.type, "V")

    def references(self, number: int) -> References:
        """The reference levels of one of its waveforms."""
        own = self.inputs[number]
        if self.levels_by == "ABSolute":
            return References(self.low_v, own.mid_v, self.high_v, absolute=True)
        return References(self.low_percent / 100, own.mid_percent / 100, self.high_percent / 100, absolute=False)


class Oscilloscope(Protocol):
    """What measurements need."""

    status: EventStatus

    def look_again(self) -> int:
        """Acquire anew if it runs freely; returns how many triggers were recorded."""

    def measured_waveform(self, source: str) -> Waveform:
        """What was last acquired; raises ScpiError."""


class Measuring:
    """The measurements of an oscilloscope, and their values."""

    def __init__(self, oscilloscope: Oscilloscope) -> None:
        self._oscilloscope = oscilloscope
        self.immediate = Measurement()
        self.slots = {number: Measurement() for number in range(1, SLOTS + 1)}
        self.statistics, self.weighting = "OFF", 32
        self.reset_statistics("RESET")

    def immediate_value(self) -> float:
        """`MEASUrement:IMMed:VALue?`: 9.91E37 and an event where it is undefined."""
        self._oscilloscope.look_again()
        return self._measured(self.immediate)

    def value(self, number: int) -> float:
        """`MEASUrement:MEAS<x>:VALue?`; 9.91E37 of a slot that is off."""
        slot = self.slots[number]
        if not slot.on:
            return UNDEFINED
        recorded = self._oscilloscope.look_again()
        value = self._measured(slot)
        if value != UNDEFINED and self._seen[number] != recorded:
            self._seen[number] = recorded
            self._values[number] = [*self._values[number], value][-VALUES_KEPT:]
        return value

    def _measured(self, measurement: Measurement) -> float:
        try:
            return self._defined(measurement)
        except ScpiError as error:
            self._oscilloscope.status.report(error)
            return UNDEFINED

    def _defined(self, measurement: Measurement) -> float:
        if measurement.type in UNMEASURED:
            raise ScpiError(NO_WAVEFORM, f"{measurement.type} has no value here")
        one = self._waveform(measurement, 1)
        if measurement.type in MEASURED:
            return MEASURED[measurement.type](one)
        other = self._waveform(measurement, 2)
        if measurement.type == "PHAse":
            return phase(one, other)
        first, second = (measurement.inputs[number].edge == "RISe" for number in (1, 2))
        return delay(one, other, rising=(first, second), forwards=measurement.direction == "FORWards")

    def _waveform(self, measurement: Measurement, number: int) -> Waveform:
        waveform = self._oscilloscope.measured_waveform(measurement.inputs[number].source)
        return replace(waveform, method=measurement.method, references=measurement.references(number))

    # --- statistics

    def reset_statistics(self, _word: str) -> None:
        """`MEASUrement:STATIstics:COUNt RESET`."""
        self._values: dict[int, list[float]] = {number: [] for number in self.slots}
        self._seen = dict.fromkeys(self.slots, -1)

    def _collected(self, number: int) -> list[float]:
        self.value(number)
        return self._values[number]

    def count(self, number: int) -> int:
        """Values that the statistics hold."""
        return len(self._collected(number))

    def maximum(self, number: int) -> float:
        """Their highest; 9.91E37 without any."""
        return max(self._collected(number), default=UNDEFINED)

    def minimum(self, number: int) -> float:
        """Their lowest."""
        return min(self._collected(number), default=UNDEFINED)

    def mean(self, number: int) -> float:
        """Their mean."""
        values = self._collected(number)
        return float(np.mean(values)) if values else UNDEFINED

    def stddev(self, number: int) -> float:
        """Their standard deviation."""
        values = self._collected(number)
        return float(np.std(values)) if values else UNDEFINED
