"""When the generator starts its segments: the edges at its trigger input, and which of them it heeds.

An edge while a segment plays is ignored. Regular edges (the DMD's frame synch) therefore start segments in a pattern
that repeats, and any number of them is a formula, not a list: an endless projection costs no memory and no time.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backends.world import triggers
from sim_backends.world.signals import Playback, Projection

DEFAULT_LEVEL_V = 1.4  # the generator's own, as its outputs are 1 Vpp at most: TTL
SYNCH_HIGH_V = 3.3  # recalled: a TTL output

_SLACK_S = 20e-12  # rounding of a large virtual time must not lose an edge
_KEPT_RUNS = 256
_AT_ONCE = 4096

_Starts = tuple[NDArray[np.float64], NDArray[np.intp]]


@dataclass(frozen=True, eq=False)
class _Run:
    """Starts between two changes: the `count` heeded ones of the edges at `edge_s + k every_s`.

    Start j happens at edge first + cycle (j // K) + offsets[j % K] and plays segment (number + j) % K, K = segments.
    """

    edge_s: float
    every_s: float
    first: int
    offsets: NDArray[np.int64]
    cycle: int
    number: int
    count: float

    def starts(self, begin: int, end: int) -> _Starts:
        """Times (s) and segments of starts `begin` to `end`."""
        return self.numbered(np.arange(begin, min(end, self.count), dtype=np.int64))

    def numbered(self, each: NDArray[np.int64]) -> _Starts:
        """Times (s) and segments of starts with these numbers."""
        turn, place = np.divmod(each, self.offsets.size)
        edges = self.first + self.cycle * turn + self.offsets[place]
        times = np.asarray(self.edge_s + self.every_s * edges, np.float64)
        return times, np.asarray((self.number + each) % self.offsets.size, np.intp)

    def until(self, times: NDArray[np.float64]) -> NDArray[np.int64]:
        """How many starts have happened by each of `times`."""
        edges = np.floor((times - self.edge_s + _SLACK_S) / self.every_s).astype(np.int64) - self.first
        turn, place = np.divmod(edges, self.cycle)
        done = turn * self.offsets.size + np.searchsorted(self.offsets, place, side="right")
        return np.asarray(np.minimum(np.where(edges < 0, 0, done), self.count), np.int64)


class Repetition(NamedTuple):
    """A last segment that runs on: when it began (s), its period (s), the phases of its marker's edges (s).

    counted_s: edges before this time (s) are among those of the segments.
    """

    began_s: float
    period: float
    edges: NDArray[np.float64]
    counted_s: float


class SegmentStarts:
    """The starts of a triggered playback, those to come under the present settings included.

    Args:
        playback: what is played; the sequence begins with the next edge.
        level_v: which frame synch pulses are taken: those through this level (V),
        rising: with their rising or their falling edge.
        projection: where the pulses come from; None: there are none.
        now_s: virtual time.

    Raises:
        ValueError: the playback needs no trigger.
    """

    def __init__(
        self, playback: Playback, level_v: float, *, rising: bool, projection: Projection | None, now_s: float
    ) -> None:
        if playback.lengths is None:
            raise ValueError("segments: this playback repeats for ever: give one with lengths")
        self._playback = playback
        self._level_v, self._rising = level_v, rising
        self._projection = projection
        self._markers = [playback.segment(number)[1] for number in range(len(playback.lengths))]
        self._durations = np.array(playback.lengths) / playback.sample_rate  # s
        self._runs: deque[_Run] = deque(maxlen=_KEPT_RUNS)
        self._resume(now_s)

    def heed(self, level_v: float, *, rising: bool, now_s: float) -> None:
        """Take frame synch pulses through `level_v`, their rising or falling edge."""
        if (level_v, rising) != (self._level_v, self._rising):
            self._close(now_s)
            self._level_v, self._rising = level_v, rising
            self._resume(now_s)

    def project(self, projection: Projection | None, now_s: float) -> None:
        """Frame synch pulses of another projection; none without one."""
        if projection is not None or self._projection is not None:
            self._close(now_s)
            self._projection = projection
            self._resume(now_s)

    def edge(self, now_s: float) -> int | None:
        """An edge now: the segment that it starts; None while one plays."""
        self._close(now_s)
        before = len(self._runs)
        self._open(now_s, 1.0, 1, now_s)
        started = len(self._runs) > before
        number = self._runs[-1].number if started else None
        self._resume(now_s)
        return number

    def latest(self, times: NDArray[np.float64]) -> _Starts:
        """The latest start at or before each of `times` (s) and its segment; NaN and -1 where there is none."""
        starts, numbers = np.full(times.size, np.nan), np.full(times.size, -1, np.intp)
        for run in reversed(self._runs):
            last = run.until(times) - 1
            found = np.flatnonzero((numbers < 0) & (last >= 0))
            starts[found], numbers[found] = run.numbered(last[found])
            if np.all(numbers >= 0):
                break
        return starts, numbers

    def marker_edges(self, count: int, *, rising: bool, after_s: float, holdoff_s: float) -> list[float]:
        """Times (s) of at most `count` marker edges at or after `after_s`: the first one of every segment played."""
        times: list[float] = []
        for edges in self._marker_edges(rising, after_s):
            for edge in edges.tolist():
                if not times or edge >= times[-1] + holdoff_s - _SLACK_S:
                    times.append(edge)
                if len(times) == count:
                    return times
        return times

    def repetition(self, *, rising: bool) -> Repetition | None:
        """The last segment, if it was reached and repeats for ever."""
        began_s = self._runs_on_since(math.inf)
        edges = triggers.marker_edges(self._markers[-1], rising=rising) / self._playback.sample_rate
        if began_s is None or edges.size == 0:
            return None
        period = float(self._durations[-1])
        first = float(np.nan_to_num(self._edge_phases(rising)[-1]))
        return Repetition(began_s, period, edges, began_s + first + max(_SLACK_S, 2e-6 * period))

    def _marker_edges(self, rising: bool, after_s: float) -> Iterator[NDArray[np.float64]]:
        phases = self._edge_phases(rising)
        if np.all(np.isnan(phases)):
            return
        early = np.array([after_s - float(self._durations.max()) - 2 * _SLACK_S])
        for run in self._runs:
            begin = int(run.until(early)[0])
            while begin < run.count:
                starts, numbers = run.starts(begin, begin + _AT_ONCE)
                edges = starts + phases[numbers]
                yield edges[edges >= after_s - _SLACK_S]
                begin += _AT_ONCE

    def _edge_phases(self, rising: bool) -> NDArray[np.float64]:
        """Time of the first marker edge in every segment, from its start (s); the marker is low before and after."""
        phases = []
        for played in self._markers:
            marker = np.concatenate([[False], played, [False]]).astype(np.int8)
            places = np.flatnonzero(np.diff(marker) == (1 if rising else -1))
            phases.append(places[0] / self._playback.sample_rate if places.size else np.nan)
        return np.array(phases)

    def _runs_on_since(self, time_s: float) -> float | None:
        """When the last segment of a playback that runs on was reached, if it was before `time_s`."""
        for run in self._runs if self._playback.runs_on else ():
            if run.count and math.isfinite(run.count):
                start, number = run.starts(int(run.count) - 1, int(run.count))
                if number[0] == self._durations.size - 1 and start[0] <= time_s:
                    return float(start[0])
        return None

    def _close(self, now_s: float) -> None:
        """What was still to come will not."""
        if self._runs:
            run = self._runs.pop()
            done = int(run.until(np.array([now_s]))[0])
            if done:
                self._runs.append(replace(run, count=done))

    def _resume(self, now_s: float) -> None:
        """Frame synch pulses from now on."""
        projection = self._projection
        if projection is None or projection.triggered or projection.synch_pulse_s <= 0:
            return
        if not 0 < self._level_v < SYNCH_HIGH_V:
            return
        first = projection.start_s + projection.synch_delay_s
        if self._rising != projection.synch_high:
            first += projection.synch_pulse_s
        count = math.inf if projection.loop else len(projection.counts) * projection.repeats - projection.left_out
        self._open(first, projection.picture_time_s, count, now_s)

    def _open(self, edge_s: float, every_s: float, count: float, now_s: float) -> None:
        """Heed `count` edges `every_s` apart from `edge_s` on, as far as they come after now and nothing plays."""
        if self._runs_on_since(now_s) is not None:
            return
        durations = self._durations
        number, free_s = 0, now_s
        if self._runs:
            last = self._runs[-1]
            start, segment = last.starts(int(last.count) - 1, int(last.count))
            number = int(segment[0] + 1) % durations.size
            free_s = max(now_s, float(start[0] + durations[segment[0]]))
        first = max(0, math.ceil((free_s - edge_s - _SLACK_S) / every_s))
        taken = np.maximum(1, np.ceil((durations - _SLACK_S) / every_s)).astype(np.int64)
        taken = np.roll(taken, -number)
        run = _Run(edge_s, every_s, first, np.cumsum(taken) - taken, int(taken.sum()), number, math.inf)
        most: float = math.inf
        if math.isfinite(count):
            most = float(run.until(np.array([edge_s + (count - 1) * every_s]))[0])
        if self._playback.runs_on:
            most = min(most, durations.size - number)
        if most > 0:
            self._runs.append(replace(run, count=most))
