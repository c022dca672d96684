"""Where physics meets the instruments: their settings go in, volts at the oscilloscope's inputs come out.

The world knows what is on the wires and in the fibres, never why: no label, no image but mirror bits, no experiment.
The wires: DMD frame synch -> generator's trigger input A, generator's marker 1 -> oscilloscope's AUX input and DMD's
trigger input. Every random number of a record is a function of the twin's seed, the instruments' state when the
trigger comes (the pattern on the mirrors, not the ones before or after it in a projection), the acquisition and how
many triggers were recorded in that state since a setting was last changed. Byte-equality holds on one machine with one
number of BLAS threads; matrix shapes are kept fixed so that the number of triggers in a record changes nothing.
"""

import math
from collections import Counter
from collections.abc import Mapping
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics import chain
from sim_backends.optics.mirrors import on_counts
from sim_backends.parameters import Parameters
from sim_backends.world import triggers
from sim_backends.world.clock import VirtualClock
from sim_backends.world.keyed_random import Rekeyed, digest, generator
from sim_backends.world.light_path import LightPath, Setting
from sim_backends.world.pictures import Pictures, Sight
from sim_backends.world.segments import SegmentStarts
from sim_backends.world.signals import (
    AUX,
    BYPASS,
    Acquisition,
    Emission,
    Playback,
    Projection,
    Record,
    TriggerCondition,
)

__all__ = ["AUX", "BYPASS", "Acquisition", "Emission", "Playback", "Projection", "Record", "TriggerCondition", "World"]

CHANNELS = (1, 2, 3, 4)
_SHIFT_STEP_S = 2.5e-12
_PHASE_STEP_S = 1.25e-12
_SAME_PHASE_S = 15e-12

_BLOCK_BYTES = 32_000_000  # of fields computed together; bounds the memory, not the result
_ONSET_S = 15e-9  # longer than fibre, chip and filters remember
_LONGEST_ONSET = 2**22  # samples of a repeated segment that are followed from its first one on


class _Light(NamedTuple):
    """What triggers have in common that one computation serves: all but the pattern."""

    step: int
    segment: int | None
    repeats: int
    phase_s: float
    shift_s: float
    scene: int
    age_s: float | None
    lit: bool


class World:
    """The bench's light, from the laser to the oscilloscope's inputs, under the settings of the instruments."""

    def __init__(self, parameters: Parameters | None = None, *, twin_seed: int = 1) -> None:
        began = perf_counter()
        self.parameters = parameters or Parameters()
        self.twin_seed = twin_seed
        self.clock = VirtualClock()
        self._light_path = LightPath(self.parameters, twin_seed)
        self._emission: Emission | None = None
        self._lit_from_s = 0.0
        self._playback: Playback | None = None
        self._starts = SegmentStarts()
        self._patching: dict[int, int] = {}
        self._pictures = Pictures(
            self._light_path.amplitudes,
            leaves_s=self.parameters.mirror_leaves_s,
            arrives_s=self.parameters.mirror_arrives_s,
        )
        self._recorded: Counter[bytes] = Counter()
        self._marker_phases = np.empty(0)
        self._light_phases = np.empty(0)
        self.physics_seconds = perf_counter() - began

    def emit(self, emission: Emission | None, *, lit_from_s: float = 0.0) -> None:
        """Laser output; None is dark. Light starts at virtual time `lit_from_s` (a tuning laser is dark until then)."""
        if emission is not None and emission.power_w <= 0:
            emission = None
        if emission != self._emission:
            self._emission = emission
            self._changed()
        self._lit_from_s = lit_from_s

    def play(self, playback: Playback | None) -> None:
        """Generator output; None leaves the modulator idle and the marker without edges."""
        before = self._playback.digest if self._playback else None
        if (playback.digest if playback else None) == before:
            return
        self._playback = playback
        self._starts.play(playback, self.clock.now)
        self._marker_phases = np.empty(0)
        if playback is not None:
            segments = range(len(playback.lengths or (0,)))
            markers = [playback.segment(number)[1] for number in segments]
            edges = [triggers.marker_edges(marker, rising=rising) for marker in markers for rising in (True, False)]
            self._marker_phases = np.unique(np.concatenate([[0.0], *edges])) / playback.sample_rate
        self._changed()

    def trigger_awg(self) -> None:
        """An edge at the generator's trigger input A now: a software or internal trigger."""
        number = self._starts.edge(self.clock.now)
        if number is not None and self._playback is not None and self._playback.segment(number)[1].any():
            self._pictures.advance(self.clock.now)

    def awg_trigger_level(self, level_v: float, *, rising: bool) -> None:
        """Which edge of the DMD's frame synch pulse (0 and 3.3 V) the generator's input A takes; 1.4 V rising at first.

        A level the pulse does not cross takes none.
        """
        self._starts.heed(level_v, rising=rising, now_s=self.clock.now)

    def show(self, mirrors: NDArray[np.uint8] | None) -> None:
        """Latch a pattern: packed bits (768, 128), 1 = towards the collecting fibre; None lets the mirrors float.

        It stays; the frame synch output is silent.

        Raises:
            ValueError: not (768, 128) bytes.
        """
        began = perf_counter()
        self._starts.project(None, self.clock.now)
        self._latch(None if mirrors is None else on_counts(mirrors[np.newaxis]), None)
        self.physics_seconds += perf_counter() - began

    def project(self, projection: Projection) -> None:
        """Play pictures one after another on the virtual clock; after the last one of a finite projection it stays."""
        began = perf_counter()
        self._latch(projection.counts, projection)
        self._starts.project(projection, self.clock.now)
        self.physics_seconds += perf_counter() - began

    def hold(self) -> None:
        """Stop a projection: the picture of now stays, the frame synch output is silent."""
        self._starts.project(None, self.clock.now)
        if self._pictures.hold(self.clock.now):
            self._changed()

    def pictures_shown(self) -> int:
        """How many pictures of the present projection have been latched, repetitions counted."""
        return self._pictures.latched_count(self.clock.now)

    def patch(self, patching: Mapping[int, int]) -> None:
        """Connect oscilloscope channels to ports: 0 is the collecting fibre itself, past the chip.

        Raises:
            ValueError: a channel outside 1..4 or a port the chip does not have.
        """
        ports = self.parameters.chip_ports
        for channel, port in patching.items():
            if channel not in CHANNELS or not BYPASS <= port <= ports:
                raise ValueError(f"patching {channel} -> {port}: channels are 1..4, ports 0..{ports}")
        if dict(patching) != self._patching:
            self._patching = dict(patching)
            self._changed()

    def generator(self, *purpose: str | int | bytes) -> np.random.Generator:
        """Counter-based generator keyed by the twin's seed and `purpose`."""
        return generator(digest(self.twin_seed, *purpose))

    def next_triggers(
        self, condition: TriggerCondition, count: int, holdoff_s: float = 0.0, *, after_s: float | None = None
    ) -> NDArray[np.float64] | None:
        """Times (s) of the next `count` triggers at or after `after_s` (default: now); it may lie in the past.

        A triggered playback gives one AUX edge for every segment played whose marker has one, perhaps fewer than
        `count`; light itself triggers on a periodic playback only. None if no trigger will ever come in this state.
        """
        began = perf_counter()
        after_s = self.clock.now if after_s is None else after_s
        playback = self._playback
        times = None
        if playback is not None and playback.lengths is not None:
            if condition.source == AUX and playback.marker_low_v < condition.level_v < playback.marker_high_v:
                times = self._starts.marker_edges(count, rising=condition.rising, after_s=after_s, holdoff_s=holdoff_s)
        elif playback is not None:
            phases = self._trigger_phases(playback, condition)
            if phases.size:
                times = triggers.upcoming(phases, playback.period, after=after_s, count=count, holdoff=holdoff_s)
        self.physics_seconds += perf_counter() - began
        return None if times is None or times.size == 0 else times

    def record(self, acquisition: Acquisition, trigger_times: NDArray[np.float64], *, setting: bytes = b"") -> Record:
        """Sample the light after each of `trigger_times`, (T,) s.

        Every trigger sees the pattern that is on the mirrors then, and the light of the segment that plays then.
        `setting` names what else the oscilloscope's noise depends on, its vertical settings for instance.
        """
        began = perf_counter()
        times = np.asarray(trigger_times, np.float64)
        shape = (len(times), len(acquisition.channels), acquisition.samples)
        sight = self._pictures.sight(
            times,
            begins_s=acquisition.start_s,
            ends_s=acquisition.start_s + acquisition.samples / acquisition.sample_rate,
        )
        keys = self._keys(sight.names, acquisition, setting)
        offsets, lateness = np.zeros(shape[0]), np.empty(shape[0])
        volts = np.empty(shape, np.float32)
        rekeyed = Rekeyed()
        for number, key in enumerate(keys):
            source = rekeyed.generator(key)
            source.standard_normal(out=volts[number], dtype=np.float32)
            lateness[number] = self.parameters.trigger_jitter_s * source.standard_normal()
            if not self.parameters.shared_reference:
                offsets[number] = (source.random() - 0.5) / acquisition.sample_rate
        coarse = np.rint(offsets / _SHIFT_STEP_S) * _SHIFT_STEP_S
        lateness += offsets - coarse
        for light, rows in self._alike(times, coarse, acquisition, sight).items():
            self._expose(volts, np.array(rows), lateness, acquisition, light, sight)
        self.physics_seconds += perf_counter() - began
        return Record(volts, offsets, tuple(keys))

    def _expose(
        self,
        volts: NDArray[np.float32],
        rows: NDArray[np.intp],
        lateness: NDArray[np.float64],
        acquisition: Acquisition,
        light: _Light,
        sight: Sight,
    ) -> None:
        """Turn unit noise in `volts[rows]` into noisy volts. Jitter enters by the trace's slope: first-order Taylor."""
        setting = self._setting(acquisition.channels, light.step, light.segment, light.repeats, lit=light.lit)
        optics = self._light_path.optics(setting)
        floor, linear, quadratic, offset = optics.laws
        amplitudes = sight.scenes[light.scene].amplitudes
        seen = sight.after[rows] * len(amplitudes) + (sight.before[rows] if light.age_s is not None else 0)
        pairs, which = np.unique(seen, return_inverse=True)
        after, before = amplitudes[pairs // len(amplitudes)], amplitudes[pairs % len(amplitudes)]
        points = acquisition.samples / (acquisition.sample_rate * self.parameters.record_step_s) + 100
        block = max(1, int(_BLOCK_BYTES / (8 * len(acquisition.channels) * points * chain.IMAGE_BLOCK)))
        block *= chain.IMAGE_BLOCK
        order = np.argsort(which, kind="stable")
        at_once = max(1, _BLOCK_BYTES // volts[0].nbytes)
        for begin in range(0, len(pairs), block):
            clean, slope = self._light_path.sampled(
                optics,
                acquisition,
                after[begin : begin + block],
                phase_s=light.phase_s,
                shift_s=light.shift_s,
                before=None if light.age_s is None else before[begin : begin + block],
                moving_since_s=light.age_s or 0.0,
            )
            signal = np.maximum(clean, 0)
            deviation = np.sqrt(floor + signal * (linear + quadratic * signal))
            clean = clean + offset
            low, high = np.searchsorted(which[order], [begin, begin + len(clean)])
            for first in range(low, high, at_once):
                places = order[first : min(first + at_once, high)]
                own, image = rows[places], which[places] - begin
                traces = volts[own]
                traces *= deviation[image]
                traces += clean[image]
                traces += lateness[own, np.newaxis, np.newaxis].astype(np.float32) * slope[image]
                volts[own] = np.minimum(traces, np.float32(self.parameters.detector_limit_v), out=traces)

    def _latch(self, counts: NDArray[np.uint16] | None, projection: Projection | None) -> None:
        if self._pictures.latch(counts, projection, self.clock.now):
            self._changed()

    def _changed(self) -> None:
        self._recorded.clear()
        self._light_phases = np.empty(0)

    def _keys(self, shown: list[bytes], acquisition: Acquisition, setting: bytes) -> list[bytes]:
        """Noise keys of triggers that come while the patterns named `shown` are latched; counts them."""
        others = digest(
            self._setting(CHANNELS, 0, None, 1, lit=True).key,
            *(f"{channel}:{port}" for channel, port in sorted(self._patching.items())),
        )
        frames: dict[bytes, bytes] = {}
        keys = []
        for name in shown:
            if name not in frames:
                frames[name] = digest(self.twin_seed, others, name, acquisition.digest, setting)
            keys.append(digest(frames[name], self._recorded[name]))
            self._recorded[name] += 1
        return keys

    def _setting(
        self, channels: tuple[int, ...], step: int, segment: int | None, repeats: int, *, lit: bool
    ) -> Setting:
        ports = tuple(self._lit_port(channel) for channel in channels)
        return Setting(self._emission if lit else None, self._playback, ports, step, segment, repeats)

    def _lit_port(self, channel: int) -> int | None:
        """The port whose light a channel sees; None: nothing connected, the input port, or the fibre is unplugged."""
        port = self._patching.get(channel)
        unplugged = port != BYPASS and BYPASS in self._patching.values()
        return None if unplugged or port == self.parameters.chip_input_port else port

    def _wander_step(self, time_s: float) -> int:
        constants = self.parameters
        wanders = constants.laser_wander_hz > 0 or constants.chip_wander_hz > 0
        return math.floor(time_s / constants.wander_step_s) if wanders else 0

    def _alike(
        self, times: NDArray[np.float64], coarse: NDArray[np.float64], acquisition: Acquisition, sight: Sight
    ) -> dict[_Light, list[int]]:
        """Triggers that see the same light, on whatever patterns of one scene."""
        groups: dict[_Light, list[int]] = {}
        phases, segments, repeats = self._phases(times, acquisition)
        columns = (times, segments, repeats, phases, coarse, sight.scene, sight.age_s)
        for row, (time, segment, repeat, phase, shift, scene, age) in enumerate(
            zip(*(column.tolist() for column in columns), strict=True)
        ):
            light = _Light(
                self._wander_step(time),
                segment if segment >= 0 else None,
                repeat,
                phase,
                shift,
                scene,
                None if math.isnan(age) else age,
                time >= self._lit_from_s,
            )
            groups.setdefault(light, []).append(row)
        return groups

    def _phases(
        self, times: NDArray[np.float64], acquisition: Acquisition
    ) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:
        """Phases of triggers (s), the segments they fall into (-1 = none) and how often those are repeated.

        The phase is a time in the drive's period, or from the segment's start, freed of the rounding that a large
        virtual time brings.
        """
        playback = self._playback
        segments, repeats = np.full(times.size, -1), np.ones(times.size, np.intp)
        if playback is None:
            return np.zeros_like(times), segments, repeats
        if playback.lengths is None:
            return self._snapped(times % playback.period, playback.period), segments, repeats
        starts, segments = self._starts.latest(times)
        phases = self._snapped(np.where(segments < 0, 0.0, times - np.nan_to_num(starts)), math.inf)
        if playback.runs_on:
            period = playback.lengths[-1] / playback.sample_rate
            last = segments == len(playback.lengths) - 1
            begins = phases + acquisition.start_s - self.parameters.light_delay_s
            ends = begins + acquisition.samples / acquisition.sample_rate + _ONSET_S
            covering = np.maximum(1, np.ceil(ends / period))
            onset = (begins < _ONSET_S) & (covering * playback.lengths[-1] < _LONGEST_ONSET)
            repeats = np.where(last, np.where(onset, covering, 0), 1).astype(np.intp)
            phases = np.where(last & ~onset, self._snapped(phases % period, period), phases)
        return phases, segments, repeats

    def _snapped(self, phases: NDArray[np.float64], period: float) -> NDArray[np.float64]:
        """Phases on a fine grid, or on the edges that triggers come from where they are near one."""
        snapped = np.rint(phases / _PHASE_STEP_S) * _PHASE_STEP_S
        marks = np.concatenate([self._marker_phases, self._light_phases])
        if marks.size:
            away = np.abs(phases[:, None] - marks)
            if math.isfinite(period):
                away = np.minimum(away, period - away)
            nearest = away.argmin(axis=1)
            close = away[np.arange(phases.size), nearest] < _SAME_PHASE_S
            snapped = np.where(close, marks[nearest], snapped)
        return snapped

    def _trigger_phases(self, playback: Playback, condition: TriggerCondition) -> NDArray[np.float64]:
        if condition.source == AUX:
            if not playback.marker_low_v < condition.level_v < playback.marker_high_v:
                return np.empty(0)
            return triggers.marker_edges(playback.marker, rising=condition.rising) / playback.sample_rate
        points = math.ceil(playback.period / self.parameters.record_step_s)
        period = Acquisition((condition.source,), points / playback.period, points, 0.0)
        step = self._wander_step(self.clock.now)
        optics = self._light_path.optics(self._setting(period.channels, step, None, 1, lit=True))
        clean, _ = self._light_path.sampled(
            optics, period, self._pictures.latched(self.clock.now)[np.newaxis], phase_s=0.0, shift_s=0.0
        )
        trace = np.minimum(clean[0, 0] + optics.laws[3, 0], np.float32(self.parameters.detector_limit_v))
        self._light_phases = (
            triggers.level_crossings(trace, condition.level_v, rising=condition.rising) / period.sample_rate
        )
        return self._light_phases
