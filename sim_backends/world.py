"""Where physics meets the instruments: their settings go in, volts at the oscilloscope's inputs come out.

The world knows what is on the wires and in the fibres, never why: no label, no image but mirror bits, no experiment.
Every random number of a record is a function of the twin's seed, the instruments' state, the acquisition and how many
triggers were recorded since that state was last changed. Byte-equality holds on one machine with one number of BLAS
threads; matrix shapes are kept fixed so that the number of triggers in a record changes nothing.
"""

import math
from collections.abc import Mapping
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from sim_backends import chance, triggers
from sim_backends.clock import VirtualClock
from sim_backends.light_path import LightPath, Setting
from sim_backends.optics import mirrors
from sim_backends.parameters import Parameters
from sim_backends.signals import AUX, BYPASS, Acquisition, Emission, Playback, Record, TriggerCondition

__all__ = ["AUX", "BYPASS", "Acquisition", "Emission", "Playback", "Record", "TriggerCondition", "World"]

CHANNELS = (1, 2, 3, 4)
_SHIFT_STEP_S = 2.5e-12
_PHASE_STEP_S = 1.25e-12
_SAME_PHASE_S = 15e-12

_Sight = tuple[int, float, float, float | None, bool]


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
        self._patching: dict[int, int] = {}
        self._counts: NDArray[np.uint16] | None = None
        self._shown_at_s = -math.inf
        self._patterns = np.zeros((2, mirrors.SIDE**2), np.float32)  # before and after the mirrors' last change
        self._amplitudes = self._light_path.amplitudes(self._patterns)
        self._state: bytes | None = None
        self._recorded = 0
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
        self._marker_phases = np.empty(0)
        if playback is not None:
            edges = [triggers.marker_edges(playback.marker, rising=rising) for rising in (True, False)]
            self._marker_phases = np.concatenate(edges) / playback.sample_rate
        self._changed()

    def show(self, mirrors: NDArray[np.uint8] | None) -> None:
        """Latch a pattern: packed bits (768, 128), 1 = towards the collecting fibre; None lets the mirrors float.

        Raises:
            ValueError: not (768, 128) bytes.
        """
        began = perf_counter()
        self._latch(mirrors)
        self.physics_seconds += perf_counter() - began

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
        return chance.generator(chance.digest(self.twin_seed, *purpose))

    def next_triggers(
        self, condition: TriggerCondition, count: int, holdoff_s: float = 0.0
    ) -> NDArray[np.float64] | None:
        """Times (s) of the next `count` triggers at or after now; None if none will ever come in this state."""
        began = perf_counter()
        phases = self._trigger_phases(condition)
        self.physics_seconds += perf_counter() - began
        if phases.size == 0 or self._playback is None:
            return None
        return triggers.upcoming(phases, self._playback.period, after=self.clock.now, count=count, holdoff=holdoff_s)

    def record(self, acquisition: Acquisition, trigger_times: NDArray[np.float64], *, setting: bytes = b"") -> Record:
        """Sample the light after each of `trigger_times`, (T,) s.

        `setting` names what else the oscilloscope's noise depends on, its vertical settings for instance.
        """
        began = perf_counter()
        frame = chance.digest(self.twin_seed, self._state_digest(), acquisition.digest, setting)
        keys = tuple(chance.digest(frame, self._recorded + number) for number in range(len(trigger_times)))
        self._recorded += len(trigger_times)
        shape = (len(trigger_times), len(acquisition.channels), acquisition.samples)
        offsets, lateness = np.zeros(shape[0]), np.empty(shape[0])
        volts = np.empty(shape, np.float32)
        for number, key in enumerate(keys):
            source = chance.generator(key)
            source.standard_normal(out=volts[number], dtype=np.float32)
            lateness[number] = self.parameters.trigger_jitter_s * source.standard_normal()
            if not self.parameters.shared_reference:
                offsets[number] = (source.random() - 0.5) / acquisition.sample_rate
        coarse = np.rint(offsets / _SHIFT_STEP_S) * _SHIFT_STEP_S
        lateness += offsets - coarse
        for sight, rows in self._alike(np.asarray(trigger_times, np.float64), coarse).items():
            self._expose(volts, rows, lateness, acquisition, sight)
        self.physics_seconds += perf_counter() - began
        return Record(volts, offsets, keys)

    def _expose(
        self,
        volts: NDArray[np.float32],
        rows: list[int],
        lateness: NDArray[np.float64],
        acquisition: Acquisition,
        sight: _Sight,
    ) -> None:
        """Turn unit noise in `volts[rows]` into noisy volts. Jitter enters by the trace's slope: first-order Taylor."""
        step, phase, shift, moving, lit = sight
        optics = self._light_path.optics(self._setting(acquisition.channels, step, lit=lit))
        clean, slope = self._light_path.sampled(
            optics, acquisition, self._amplitudes, phase_s=phase, shift_s=shift, moving_since_s=moving
        )
        floor, linear, quadratic, offset = optics.laws
        signal = np.maximum(clean, 0)
        deviation = np.sqrt(floor + signal * (linear + quadratic * signal))
        clean = clean + offset
        for row in rows:
            trace = volts[row]
            trace *= deviation
            trace += clean
            trace += np.float32(lateness[row]) * slope
            np.minimum(trace, np.float32(self.parameters.detector_limit_v), out=trace)

    def _latch(self, packed: NDArray[np.uint8] | None) -> None:
        counts = None if packed is None else mirrors.on_counts(packed)
        if counts is None or self._counts is None:
            if counts is self._counts:
                return
        elif np.array_equal(counts, self._counts):
            return
        constants = self.parameters
        since = np.asarray(self.clock.now - self._shown_at_s)
        moved = mirrors.moved_fraction(since, leaves=constants.mirror_leaves_s, arrives=constants.mirror_arrives_s)
        before, after = self._patterns
        new = np.zeros_like(after) if counts is None else mirrors.fraction(counts)
        self._patterns = np.stack([before + np.float32(moved) * (after - before) if moved < 1 else after, new])
        self._amplitudes = self._light_path.amplitudes(self._patterns)
        self._counts = counts
        self._shown_at_s = self.clock.now
        self._changed()

    def _changed(self) -> None:
        self._state = None
        self._recorded = 0
        self._light_phases = np.empty(0)

    def _state_digest(self) -> bytes:
        if self._state is None:
            self._state = chance.digest(
                self._setting(CHANNELS, 0, lit=True).key,
                *(f"{channel}:{port}" for channel, port in sorted(self._patching.items())),
                "floating" if self._counts is None else self._counts.tobytes(),
            )
        return self._state

    def _setting(self, channels: tuple[int, ...], step: int, *, lit: bool) -> Setting:
        ports = tuple(self._lit_port(channel) for channel in channels)
        return Setting(self._emission if lit else None, self._playback, ports, step)

    def _lit_port(self, channel: int) -> int | None:
        """The port whose light a channel sees; None: nothing connected, the input port, or the fibre is unplugged."""
        port = self._patching.get(channel)
        unplugged = port != BYPASS and BYPASS in self._patching.values()
        return None if unplugged or port == self.parameters.chip_input_port else port

    def _wander_step(self, time_s: float) -> int:
        constants = self.parameters
        wanders = constants.laser_wander_hz > 0 or constants.chip_wander_hz > 0
        return math.floor(time_s / constants.wander_step_s) if wanders else 0

    def _alike(self, times: NDArray[np.float64], coarse: NDArray[np.float64]) -> dict[_Sight, list[int]]:
        """Triggers that see the same light, by (wander step, phase, shift, mirrors' age if they move, laser lit)."""
        groups: dict[_Sight, list[int]] = {}
        shifts, phases = coarse.tolist(), self._phases(times).tolist()
        for row, (time, phase, shift) in enumerate(zip(times.tolist(), phases, shifts, strict=True)):
            age = time - self._shown_at_s
            moving = age if age < self.parameters.mirror_arrives_s else None
            sight = (self._wander_step(time), phase, shift, moving, time >= self._lit_from_s)
            groups.setdefault(sight, []).append(row)
        return groups

    def _phases(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Phases of triggers in the drive's period (s), freed of the rounding that a large virtual time brings."""
        if self._playback is None:
            return np.zeros_like(times)
        period = self._playback.period
        phases = times % period
        snapped = np.rint(phases / _PHASE_STEP_S) * _PHASE_STEP_S
        marks = np.concatenate([self._marker_phases, self._light_phases])
        if marks.size:
            away = np.abs((phases[:, None] - marks + period / 2) % period - period / 2)
            nearest = away.argmin(axis=1)
            close = away[np.arange(times.size), nearest] < _SAME_PHASE_S
            snapped = np.where(close, marks[nearest], snapped)
        return snapped

    def _trigger_phases(self, condition: TriggerCondition) -> NDArray[np.float64]:
        playback = self._playback
        if playback is None:
            return np.empty(0)
        if condition.source == AUX:
            if not playback.marker_low_v < condition.level_v < playback.marker_high_v:
                return np.empty(0)
            return triggers.marker_edges(playback.marker, rising=condition.rising) / playback.sample_rate
        points = math.ceil(playback.period / self.parameters.record_step_s)
        period = Acquisition((condition.source,), points / playback.period, points, 0.0)
        optics = self._light_path.optics(self._setting(period.channels, self._wander_step(self.clock.now), lit=True))
        clean, _ = self._light_path.sampled(
            optics, period, self._amplitudes, phase_s=0.0, shift_s=0.0, moving_since_s=None
        )
        trace = np.minimum(clean[0] + optics.laws[3, 0], np.float32(self.parameters.detector_limit_v))
        self._light_phases = (
            triggers.level_crossings(trace, condition.level_v, rising=condition.rising) / period.sample_rate
        )
        return self._light_phases
