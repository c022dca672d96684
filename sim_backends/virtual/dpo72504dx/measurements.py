"""What the automatic measurements of the virtual oscilloscope are, as functions of a waveform.

Definitions: tm_devices 3.7, descriptions of MEASUrement:IMMed:TYPe, MEASUrement:METHod and MEASUrement:IMMed:REFLevel.
Numbers that are only recalled are module constants. A measurement that a waveform does not have raises ScpiError with
the event of the instrument; types for eye diagrams and histograms have none here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.status import ScpiError

UNDEFINED = 9.91e37
BINS = 256  # recalled: of the histogram that finds high and low
HYSTERESIS = 0.05  # recalled: of the amplitude, on either side of the mid reference

NO_PERIOD, NO_EDGE, NO_WAVEFORM = 2202, 2216, 2225


class References(NamedTuple):
    """Reference levels: volts, or parts of the amplitude above low."""

    low: float
    mid: float
    high: float
    absolute: bool


PERCENT = References(0.1, 0.5, 0.9, absolute=False)
"""What `*RST` sets."""


@dataclass(frozen=True, eq=False)
class Waveform:
    """Points of a waveform, the first of them `start_s` behind the trigger, and how its levels are found.

    Attributes:
        points: In the unit of the waveform.
        start_s: Of the first point.
        step_s: Between points.
        unit: Of the points.
        method: HIStogram, MINMax or MEAN.
        references: What counts as low, middle and high.
    """

    points: NDArray[np.float64]
    start_s: float
    step_s: float
    unit: str
    method: str = "HIStogram"
    references: References = PERCENT

    @cached_property
    def levels(self) -> tuple[float, float]:
        """Low and high: 0% and 100%."""
        lowest, highest = float(self.points.min()), float(self.points.max())
        if self.method == "MINMax" or lowest == highest:
            return lowest, highest
        above = self.points > (lowest + highest) / 2
        if self.method == "MEAN":
            return float(self.points[~above].mean()), float(self.points[above].mean())
        return _commonest(self.points[~above]), _commonest(self.points[above])

    @property
    def amplitude(self) -> float:
        """High less low."""
        return self.levels[1] - self.levels[0]

    def reference(self, name: str) -> float:
        """The `low`, `mid` or `high` reference, in the unit of the points."""
        part: float = getattr(self.references, name)
        return part if self.references.absolute else self.levels[0] + part * self.amplitude

    @cached_property
    def edges(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Where the waveform passes the mid reference (points, with fractions), and whether it rises there."""
        mid, margin = self.reference("mid"), HYSTERESIS * self.amplitude
        side = np.zeros(self.points.size, np.int8)
        side[self.points > mid + margin] = 1
        side[self.points < mid - margin] = -1
        decided = np.flatnonzero(side)
        turns = np.flatnonzero(np.diff(side[decided])) + 1
        passed = np.flatnonzero(np.diff(self.points >= mid))  # between this point and the next
        last = passed[np.searchsorted(passed, decided[turns]) - 1]
        before, behind = self.points[last], self.points[last + 1]
        return last + (mid - before) / (behind - before), side[decided[turns]] > 0

    def edge(self, *, rising: bool | None = None, number: int = 0) -> float:
        """The place of an edge, of either slope if `rising` is None; -1 is the last one."""
        places, slopes = self.edges
        if rising is not None:
            places = places[slopes == rising]
        if not -len(places) <= number < len(places):
            raise ScpiError(NO_EDGE)
        return float(places[number])

    @property
    def cycle(self) -> tuple[float, float]:
        """Places where the first cycle begins and ends."""
        places, _ = self.edges
        if len(places) < 3:
            raise ScpiError(NO_PERIOD)
        return float(places[0]), float(places[2])

    @property
    def first_cycle(self) -> NDArray[np.float64]:
        """The points of the first cycle."""
        begin, end = self.cycle
        return self.points[int(np.ceil(begin)) : int(np.ceil(end))]

    def period(self) -> float:
        """Duration of the first cycle (s)."""
        begin, end = self.cycle
        return (end - begin) * self.step_s

    def width(self, *, positive: bool) -> float:
        """Duration of the first pulse (s)."""
        begin = self.edge(rising=positive)
        ends = [place for place in self.edges[0] if place > begin]
        if not ends:
            raise ScpiError(NO_EDGE)
        return float(ends[0] - begin) * self.step_s

    def transition(self, *, rising: bool) -> float:
        """Duration of the first edge between the low and the high reference (s)."""
        at = self.edge(rising=rising)
        points, near, far = self.points, self.reference("low"), self.reference("high")
        if not rising:
            points, near, far = -points, -far, -near
        before = np.flatnonzero(points[: int(at) + 1] <= near)
        behind = np.flatnonzero(points[int(at) + 1 :] >= far)
        if not (before.size and behind.size):
            raise ScpiError(NO_EDGE)
        first, last = int(before[-1]), int(at) + int(behind[0])
        return (_passing(points, last, far) - _passing(points, first, near)) * self.step_s

    def time(self, place: float) -> float:
        """Time of a place behind the trigger (s)."""
        return self.start_s + place * self.step_s


def _commonest(points: NDArray[np.float64]) -> float:
    counts, bounds = np.histogram(points, BINS)
    fullest = int(counts.argmax())
    return float(bounds[fullest] + bounds[fullest + 1]) / 2


def _passing(points: NDArray[np.float64], before: int, level: float) -> float:
    """The place between two points where `level` is passed."""
    rise = points[before + 1] - points[before]
    return before + float((level - points[before]) / rise)


def _burst(waveform: Waveform) -> float:
    return (waveform.edge(number=-1) - waveform.edge()) * waveform.step_s


def _rms(points: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(points**2)))


def _overshoot(waveform: Waveform, beyond: float) -> float:
    if waveform.amplitude == 0:
        raise ScpiError(NO_EDGE)
    return 100 * beyond / waveform.amplitude


MEASURED: dict[str, Callable[[Waveform], float]] = {
    "AMPlitude": lambda waveform: waveform.amplitude,
    "AREa": lambda waveform: float(waveform.points.sum()) * waveform.step_s,
    "BURst": _burst,
    "CARea": lambda waveform: float(waveform.first_cycle.sum()) * waveform.step_s,
    "CMEan": lambda waveform: float(waveform.first_cycle.mean()),
    "CRMs": lambda waveform: _rms(waveform.first_cycle),
    "FALL": lambda waveform: waveform.transition(rising=False),
    "FREQuency": lambda waveform: 1 / waveform.period(),
    "HIGH": lambda waveform: waveform.levels[1],
    "LOW": lambda waveform: waveform.levels[0],
    "MAXimum": lambda waveform: float(waveform.points.max()),
    "MEAN": lambda waveform: float(waveform.points.mean()),
    "MINImum": lambda waveform: float(waveform.points.min()),
    "NCROss": lambda waveform: waveform.time(waveform.edge(rising=False)),
    "NDUty": lambda waveform: 100 * waveform.width(positive=False) / waveform.period(),
    "NOVershoot": lambda waveform: _overshoot(waveform, waveform.levels[0] - float(waveform.points.min())),
    "NWIdth": lambda waveform: waveform.width(positive=False),
    "PCROss": lambda waveform: waveform.time(waveform.edge(rising=True)),
    "PDUty": lambda waveform: 100 * waveform.width(positive=True) / waveform.period(),
    "PERIod": Waveform.period,
    "PK2Pk": lambda waveform: float(np.ptp(waveform.points)),
    "POVershoot": lambda waveform: _overshoot(waveform, float(waveform.points.max()) - waveform.levels[1]),
    "PWIdth": lambda waveform: waveform.width(positive=True),
    "RISe": lambda waveform: waveform.transition(rising=True),
    "RMS": lambda waveform: _rms(waveform.points),
}
"""Measurements of one waveform."""

BETWEEN = ("DELay", "PHAse")
"""Measurements between two waveforms."""

UNMEASURED = (
    *("DISTDUty", "EXTINCTDB", "EXTINCTPCT", "EXTINCTRATIO", "EYEHeight", "EYEWIdth", "HITs", "MEDian", "PBASe"),
    *("PCTCROss", "PEAKHits", "PKPKJitter", "PKPKNoise", "PTOP", "QFACtor", "RMSJitter", "RMSNoise", "SIGMA1"),
    *("SIGMA2", "SIGMA3", "SIXSigmajit", "SNRatio", "STDdev", "UNDEFINED", "WAVEFORMS"),
)
"""Types that are accepted and never have a value: they measure eye diagrams and histograms."""

_PERCENT = ("NDUty", "NOVershoot", "PDUty", "POVershoot")
_SECONDS = ("BURst", "DELay", "FALL", "NCROss", "NWIdth", "PCROss", "PERIod", "PWIdth", "RISe")


def delay(one: Waveform, other: Waveform, *, rising: tuple[bool, bool], forwards: bool) -> float:
    """From the first edge of one waveform to the first or the last one of another (s)."""
    begin = one.time(one.edge(rising=rising[0]))
    return other.time(other.edge(rising=rising[1], number=0 if forwards else -1)) - begin


def phase(one: Waveform, other: Waveform) -> float:
    """How far another waveform lags behind one, in degrees of the first one's cycle."""
    return 360 * delay(one, other, rising=(True, True), forwards=True) / one.period()


def unit(kind: str, of_points: str) -> str:
    """The unit of a measurement of points in the unit `of_points`."""
    if kind == "FREQuency":
        return "Hz"
    if kind == "PHAse":
        return "degrees"
    if kind in ("AREa", "CARea"):
        return f"{of_points}s"
    return "%" if kind in _PERCENT else "s" if kind in _SECONDS else of_points
