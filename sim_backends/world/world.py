"""Where physics meets the instruments: their settings go in, volts at the oscilloscope's inputs come out.

The world knows what is on the wires and in the fibres, never why: no label, no image but mirror bits, no experiment.
The wires: DMD frame synch -> generator's trigger input A, generator's marker 1 -> oscilloscope's AUX input and DMD's
trigger input. Every random number of a record is a function of the twin's seed, the instruments' state when the
trigger comes (the pattern on the mirrors, not the ones before or after it in a projection), the acquisition and how
many triggers were recorded before: since the world began, or, where noise is "by-state", in that state since a setting
was last changed. Byte-equality holds on one machine with one number of BLAS threads; matrix shapes are kept fixed so
that the number of triggers in a record changes nothing.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from time import perf_counter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics.launch import Launch
from sim_backends.optics.mirrors import on_counts
from sim_backends.parameters import Parameters
from sim_backends.world.keyed_random import derived, digest, encoded, encoded_name, generator, named
from sim_backends.world.light_path import Light, LightPath, snapped
from sim_backends.world.pictures import FLOATING, Pictures, Sight
from sim_backends.world.receivers import Alike, Device, ProcessorReceivers, Receivers
from sim_backends.world.segments import DEFAULT_LEVEL_V, SegmentStarts
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
from sim_backends.world.triggers import marker_edges
from sim_backends.world.twin import Setting

CHANNELS = (1, 2, 3, 4)
Noise = Literal["by-trigger", "by-state"]
"""New for every trigger, as on a bench; or the same whenever a state is set anew, whatever was measured before."""
_SHIFT_STEP_S = 2.5e-12
_ONSET_S = 15e-9  # longer than fibre, chip and filters remember, an oscilloscope's bandwidth limit left out
_LONGEST_ONSET = 2**22  # samples of a repeated segment that are followed from its first one on


LONGEST_S = 2.0**18
"""Of virtual time, three days. Later times would be rounded to 58 ps, by which the same light would not be the same."""


class ClockEnded(Exception):
    """A simulated bench has come to the end of its clock: one line that says what to do."""


class VirtualClock:
    """Virtual time of a bench: `now`, in seconds since it was switched on; waiting costs nothing else."""

    def __init__(self) -> None:
        self.now = 0.0

    def advance(self, seconds: float) -> None:
        """Let `seconds` of virtual time pass.

        Raises:
            ValueError: `seconds` is negative or not a number.
            ClockEnded: that is after `LONGEST_S`.
        """
        if not seconds >= 0:
            raise ValueError(f"the virtual clock cannot advance by {seconds} s: give a time of at least 0")
        if self.now + seconds > LONGEST_S:
            raise ClockEnded(
                "the clock of the simulated bench ends after three days, beyond which it could not tell picoseconds: "
                "start the simulated bench anew"
            )
        self.now += seconds


class World:
    """The bench's light, from the laser to the oscilloscope's inputs, under the settings of the instruments.

    Attributes:
        receivers: What makes noise and codes.
        fallback: Why the processor computes it although a graphics card was asked for; empty where that is not so.
    """

    def __init__(
        self,
        parameters: Parameters | None = None,
        *,
        twin_seed: int = 1,
        noise: Noise = "by-trigger",
        device: Device = "cpu",
    ) -> None:
        began = perf_counter()
        self.parameters = parameters or Parameters()
        self.twin_seed = twin_seed
        self.clock = VirtualClock()
        self._light_path = LightPath(self.parameters, twin_seed)
        self.receivers, self.fallback = _receivers(device, self._light_path, self.parameters)
        self._drift_step_s = self.parameters.drift_step_s
        self._laser: Emission | None = None
        self._launch = Launch()
        self._emission: Emission | None = None  # of the laser as the launch leaves it
        self._lit_from_s = 0.0
        self._playback: Playback | None = None
        self._starts: SegmentStarts | None = None  # of a triggered playback
        self._period = 0.0  # of the playback (s)
        self._edges: dict[bool, NDArray[np.float64]] = {}  # phases of the marker's edges, rising and falling (s)
        self._trigger_input = (DEFAULT_LEVEL_V, True)
        self._projection: Projection | None = None
        self._patching: dict[int, int] = {}
        self._ports: dict[int, int] = {}  # whose light each channel sees
        self._pictures = Pictures(
            self._light_path.amplitudes,
            leaves_s=self.parameters.mirror_leaves_s,
            arrives_s=self.parameters.mirror_arrives_s,
        )
        self._state: bytes | None = None  # names everything but the pictures
        self._by_state = noise == "by-state"
        self._recorded: Counter[bytes] = Counter()  # of every pattern, in this state
        self._triggers = 0  # recorded since the world began
        self._marker_phases = self._light_phases = np.empty(0)
        self.physics_seconds = perf_counter() - began

    def emit(self, emission: Emission | None, *, lit_from_s: float = 0.0) -> None:
        """Laser output; None is dark. Light starts at virtual time `lit_from_s` (a tuning laser is dark until then)."""
        self._laser = emission if emission is not None and emission.power_w > 0 else None
        self._launch_light()
        self._lit_from_s = lit_from_s

    @property
    def laser_light(self) -> Emission | None:
        """What leaves the laser now, in front of modulator and fibre; None: it is dark."""
        return self._laser if self.clock.now >= self._lit_from_s else None

    def amplify(self, power_w: float) -> None:
        """An amplifier with this output power in the place of the booster behind the modulator; 0: it is off."""
        self._launch = replace(self._launch, amplified_w=power_w)
        self._launch_light()

    def attenuate(self, attenuation_db: float) -> None:
        """An attenuator between booster or amplifier and fibre; infinity: it is shut."""
        self._launch = replace(self._launch, attenuation_db=attenuation_db)
        self._launch_light()

    @property
    def amplified_power_w(self) -> float:
        """What leaves the amplifier (W); 0 without light."""
        laser = self.laser_light
        return 0.0 if laser is None else self._launch.amplified_power_w(self.parameters, laser.power_w)

    def play(self, playback: Playback | None) -> None:
        """Generator output; None leaves the modulator idle and the marker without edges."""
        if playback == self._playback:
            return
        self._playback, self._starts, self._edges, self._marker_phases = playback, None, {}, np.empty(0)
        if playback is not None:
            self._period = playback.period
            markers = [playback.segment(number)[1] for number in range(len(playback.lengths or (0,)))]
            self._edges = {
                rising: np.concatenate([marker_edges(marker, rising=rising) for marker in markers])
                / playback.sample_rate
                + playback.marker_delay_s
                for rising in (True, False)
            }
            self._marker_phases = np.unique(np.concatenate([[0.0], *self._edges.values()]))
            if playback.lengths is not None:
                level_v, rising = self._trigger_input
                self._starts = SegmentStarts(
                    playback, level_v, rising=rising, projection=self._projection, now_s=self.clock.now
                )
        self._changed()

    def trigger_awg(self) -> None:
        """An edge at the generator's trigger input A now: a software or internal trigger."""
        number = self._starts.edge(self.clock.now) if self._starts else None
        if number is not None and self._playback is not None and self._playback.segment(number)[1].any():
            self._pictures.advance(self.clock.now)

    def awg_trigger_level(self, level_v: float, *, rising: bool) -> None:
        """Which edge of the DMD's frame synch pulse (0 and 3.3 V) the generator's input A takes; 1.4 V rising at first.

        A level the pulse does not cross takes none.
        """
        self._trigger_input = level_v, rising
        if self._starts:
            self._starts.heed(level_v, rising=rising, now_s=self.clock.now)

    def show(self, mirrors: NDArray[np.uint8] | None) -> None:
        """Latch a pattern: packed bits (768, 128), 1 = towards the collecting fibre; None lets the mirrors float.

        It stays; the frame synch output is silent.

        Raises:
            ValueError: not (768, 128) bytes.
        """
        began = perf_counter()
        self._synchronise(None)
        self._latch(None if mirrors is None else on_counts(mirrors[np.newaxis]), None)
        self.physics_seconds += perf_counter() - began

    def project(self, projection: Projection) -> None:
        """Play pictures one after another on the virtual clock; after the last one of a finite projection it stays.

        Raises:
            ValueError: counts of another shape, or none; no picture time.
        """
        counts, every_s = projection.counts, projection.picture_time_s
        if counts.ndim != 2 or len(counts) == 0 or not every_s > 0:
            raise ValueError(
                f"projection: counts {counts.shape} every {every_s} s: "
                "give mirrors on in every superpixel (n, 784) and a time above 0"
            )
        began = perf_counter()
        self._latch(counts, projection)
        self._synchronise(projection)
        self.physics_seconds += perf_counter() - began

    def hold(self) -> None:
        """Stop a projection: the picture of now stays, the frame synch output is silent."""
        self._synchronise(None)
        if self._pictures.hold(self.clock.now):
            self._recount()

    def pictures_shown(self) -> int:
        """How many pictures of the present projection have been latched, repetitions counted."""
        return self._pictures.latched_count(self.clock.now)

    def patch(self, patching: Mapping[int, int]) -> None:
        """Connect oscilloscope channels to ports: 0 is the collecting fibre itself, past the chip.

        A channel is dark if nothing is connected to it, or the input port, or if the fibre is unplugged from the chip.

        Raises:
            ValueError: a channel outside 1..4 or a port the chip does not have.
        """
        ports, entrance = self.parameters.chip_ports, self.parameters.chip_input_port
        for channel, port in patching.items():
            if channel not in CHANNELS or not BYPASS <= port <= ports:
                raise ValueError(f"patching {channel} -> {port}: channels are 1..4, ports 0..{ports}")
        if dict(patching) != self._patching:
            self._patching = dict(patching)
            lit = (BYPASS,) if BYPASS in patching.values() else range(1, ports + 1)
            self._ports = {channel: port for channel, port in patching.items() if port in lit and port != entrance}
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
        playback, times = self._playback, np.empty(0)
        if playback is None or (
            condition.source == AUX and not playback.marker_low_v < condition.level_v < playback.marker_high_v
        ):
            return None
        if self._starts is None:
            if condition.source == AUX:
                phases = np.sort(self._edges[condition.rising] % self._period)
            else:
                phases = self._crossings(condition)
            if phases.size:
                times = upcoming(phases, self._period, after=after_s, count=count, holdoff=holdoff_s)
        elif condition.source == AUX:
            late_s = playback.marker_delay_s
            times = late_s + _segment_edges(self._starts, condition.rising, count, after_s - late_s, holdoff_s)
        self.physics_seconds += perf_counter() - began
        return times if times.size else None

    def record(
        self,
        acquisition: Acquisition,
        trigger_times: NDArray[np.float64],
        *,
        setting: bytes = b"",
        whole: Acquisition | None = None,
    ) -> Record:
        """Sample the light after each of `trigger_times`, (T,) s.

        Every trigger sees the pattern that is on the mirrors then, and the light of the segment that plays then.
        `setting` names what else the oscilloscope's noise depends on, its vertical settings for instance. `whole` spans
        all points that `further` may be asked for, where these are more than those of `acquisition`.
        """
        began = perf_counter()
        times, whole = np.asarray(trigger_times, np.float64), whole or acquisition
        begins_s, ends_s = whole.start_s, whole.start_s + whole.samples / whole.sample_rate
        sight = self._pictures.sight(times, begins_s=begins_s, ends_s=ends_s)
        direct = self.parameters.light_path == "direct"  # past the mirrors: what they show is no part of the state
        keys = self._keys([FLOATING] * times.size if direct else sight.names, acquisition, setting)
        white, lateness, offsets = self.receivers.drawn(keys, acquisition)
        coarse = np.rint(offsets / _SHIFT_STEP_S) * _SHIFT_STEP_S
        lateness += offsets - coarse
        cuts = self._pictures.stretches(times, begins_s=begins_s, ends_s=ends_s)
        stretches = []
        for first_s, last_s in pairwise(cuts.tolist()):
            if len(cuts) > 2:
                sight = self._pictures.sight(times, begins_s=first_s, ends_s=last_s)
            lights = [
                (light, np.array(rows), self._under(light, acquisition.channels))
                for light, rows in self._alike(times, coarse, whole, sight).items()
            ]
            detected = partial(self._detected, lights, sight, lateness)
            stretches.append((last_s if last_s < ends_s else math.inf, detected))
        further = partial(self._further, keys, stretches)
        if len(stretches) > 1:
            self.physics_seconds += perf_counter() - began
            return Record(further(acquisition), offsets, keys, further)
        volts = detected(acquisition, white)
        self.physics_seconds += perf_counter() - began
        return Record(volts, offsets, keys, further)

    def _detected(
        self,
        lights: Sequence[tuple[Light, NDArray[np.intp], Setting]],
        sight: Sight,
        lateness: NDArray[np.float64],
        acquisition: Acquisition,
        white: Any,
    ) -> NDArray[np.float32]:
        """Volts of all triggers, group by group of those that see the same light."""
        volts = np.empty((lateness.size, len(acquisition.channels), acquisition.samples), np.float32)
        for light, rows, setting in lights:
            behind = replace(setting, bandwidth_hz=acquisition.bandwidth_hz)
            self.receivers.detect(white, Alike(rows, lateness, acquisition, behind, light, sight), volts)
        return volts

    def _further(
        self,
        keys: Sequence[bytes],
        stretches: Sequence[tuple[float, Callable[[Acquisition, Any], NDArray[np.float32]]]],
        part: Acquisition,
    ) -> NDArray[np.float32]:
        """Volts of other points behind the same triggers, with noise of their own, stretch by stretch."""
        began, first, volts = perf_counter(), 0, []
        self._light_path.grid(part, 0.0)  # what is too long is refused as a whole
        for ends_s, detected in stretches:
            last = max(first, round(min(part.samples, (ends_s - part.start_s) * part.sample_rate)))
            if last > first:
                at_s = part.start_s + first / part.sample_rate
                piece = replace(part, start_s=at_s, samples=last - first)
                own = derived(keys, "further", float(at_s))
                volts.append(detected(piece, self.receivers.white(own, piece)))
            first = last
        self.physics_seconds += perf_counter() - began
        return volts[0] if len(volts) == 1 else np.concatenate(volts, axis=-1)

    def _latch(self, counts: NDArray[np.uint16] | None, projection: Projection | None) -> None:
        if self._pictures.latch(counts, projection, self.clock.now):
            self._recount()

    def _synchronise(self, projection: Projection | None) -> None:
        self._projection = projection
        if self._starts:
            self._starts.project(projection, self.clock.now)

    def _launch_light(self) -> None:
        laser, emission = self._laser, None
        if laser is not None and (transmission := self._launch.transmission(self.parameters, laser.power_w)) > 0:
            emission = replace(laser, power_w=laser.power_w * transmission)
        if emission != self._emission:
            self._emission = emission
            self._changed()

    def _changed(self) -> None:
        self._state = None
        self._recount()

    def _recount(self) -> None:
        self._recorded.clear()
        self._light_phases = np.empty(0)

    def _keys(self, shown: list[bytes], acquisition: Acquisition, setting: bytes) -> tuple[bytes, ...]:
        """Noise keys of triggers that come while the patterns named `shown` are latched; counts them."""
        if self._state is None:
            patched = (f"{channel}:{port}" for channel, port in sorted(self._patching.items()))
            self._state = digest(self._setting(CHANNELS, 0, None, 1, lit=True).key, *patched)
        before, behind = encoded(self.twin_seed, self._state), encoded(acquisition.digest, setting)
        frames = {name: encoded_name(named(before + encoded_name(name) + behind)) for name in dict.fromkeys(shown)}
        keys = []
        for name in shown:
            keys.append(named(frames[name] + encoded(self._recorded[name] if self._by_state else self._triggers)))
            self._recorded[name] += 1
            self._triggers += 1
        return tuple(keys)

    def _setting(
        self, channels: tuple[int, ...], step: int, segment: int | None, repeats: int, *, lit: bool
    ) -> Setting:
        ports = tuple(map(self._ports.get, channels))
        return Setting(self._emission if lit else None, self._playback, ports, step, segment, repeats)

    def _under(self, light: Light, channels: tuple[int, ...]) -> Setting:
        """What the instruments fix for triggers that see this light."""
        segment = light.segment if light.segment >= 0 else None
        return self._setting(channels, light.step, segment, light.repeats, lit=light.lit)

    def _crossings(self, condition: TriggerCondition) -> NDArray[np.float64]:
        """Phases (s) at which the light on a channel triggers."""
        setting = self._setting((condition.source,), self._drift_step(self.clock.now), None, 1, lit=True)
        shown = self._pictures.latched(self.clock.now)
        self._light_phases = self._light_path.crossings(setting, shown, condition.level_v, rising=condition.rising)
        return self._light_phases

    def _drift_step(self, time_s: float) -> int:
        return math.floor(time_s / self._drift_step_s)

    def _alike(
        self, times: NDArray[np.float64], coarse: NDArray[np.float64], acquisition: Acquisition, sight: Sight
    ) -> dict[Light, list[int]]:
        """Triggers that see the same light, on whatever patterns of one scene."""
        phases, segments, repeats = self._phases(times, acquisition)
        steps = np.floor(times / self._drift_step_s).astype(np.int64)
        lit = times >= self._lit_from_s
        columns = (steps, segments, repeats, phases, coarse, sight.scene, sight.age_s, lit)
        groups: dict[tuple[Any, ...], list[int]] = {}
        for row, seen in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
            groups.setdefault(seen, []).append(row)
        return {Light(*seen): rows for seen, rows in groups.items()}

    def _phases(
        self, times: NDArray[np.float64], acquisition: Acquisition
    ) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:
        """Phases of triggers (s), the segments they fall into (-1 = none) and how often those are repeated.

        The phase is a time in the drive's period, or from the segment's start, freed of the rounding that a large
        virtual time brings.
        """
        playback, marks = self._playback, np.concatenate([self._marker_phases, self._light_phases])
        segments, repeats = np.full(times.size, -1), np.ones(times.size, np.intp)
        if playback is None:
            return np.zeros_like(times), segments, repeats
        if self._starts is None:
            return snapped(times % self._period, self._period, marks), segments, repeats
        starts, segments = self._starts.latest(times)
        phases = snapped(np.where(segments < 0, 0.0, times - np.nan_to_num(starts)), math.inf, marks)
        if playback.lengths is not None and playback.runs_on:
            period = playback.lengths[-1] / playback.sample_rate
            last = segments == len(playback.lengths) - 1
            begins = phases + acquisition.start_s - self.parameters.light_delay_s - playback.skew_s
            remembered_s = _ONSET_S + 1 / acquisition.bandwidth_hz
            ends = begins + acquisition.samples / acquisition.sample_rate + remembered_s
            covering = np.maximum(1, np.ceil(ends / period))
            onset = (begins < remembered_s) & (covering * playback.lengths[-1] < _LONGEST_ONSET)
            repeats = np.where(last, np.where(onset, covering, 0), 1).astype(np.intp)
            phases = np.where(last & ~onset, snapped(phases % period, period, marks), phases)
        return phases, segments, repeats


def _receivers(device: Device, light_path: LightPath, parameters: Parameters) -> tuple[Receivers, str]:
    """On a graphics card if that is asked for and can be; else by the processor, and why."""
    missing = ""
    if device == "cuda":
        try:
            from sim_backends.world.card import CardReceivers, unusable
        except ModuleNotFoundError:
            missing = "torch is not installed"
        except (ImportError, OSError, AttributeError, ValueError, RuntimeError) as error:  # an incomplete package
            missing = f"torch does not load ({' '.join(str(error).split())})"
        else:
            if not (missing := unusable()):
                return CardReceivers(light_path, parameters), ""
    return ProcessorReceivers(light_path, parameters), missing


def _segment_edges(
    starts: SegmentStarts, rising: bool, count: int, after_s: float, holdoff_s: float
) -> NDArray[np.float64]:
    """Marker edges of segments, and then those of a last one that repeats."""
    times = starts.marker_edges(count, rising=rising, after_s=after_s, holdoff_s=holdoff_s)
    last = starts.repetition(rising=rising) if len(times) < count else None
    if last is None:
        return np.array(times)
    earliest = max(after_s, last.counted_s, times[-1] + holdoff_s if times else after_s)
    more = upcoming(last.edges, last.period, after=earliest - last.began_s, count=count - len(times), holdoff=holdoff_s)
    return np.concatenate([times, last.began_s + more])


def upcoming(
    phases: NDArray[np.float64], period: float, *, after: float, count: int, holdoff: float
) -> NDArray[np.float64]:
    """The next `count` times of events that happen at `phases` of every period.

    Args:
        phases: at least one, s, sorted, within the period.
        period: s.
        after: the first time is at or after this (s).
        count: how many.
        holdoff: each time is at least this much later than the one before (s).
    """
    slack = 1e-6 * period  # rounding of a large virtual time must not lose an event
    if phases.size == 1:
        first = np.ceil((after - slack - phases[0]) / period)
        every = max(1.0, np.ceil((holdoff - slack) / period))
        return np.asarray((first + every * np.arange(count)) * period + phases[0])
    times = np.empty(count)
    earliest = after - slack
    for number in range(count):
        cycle = np.floor(earliest / period)
        candidates = ((cycle + np.arange(2))[:, None] * period + phases).ravel()
        times[number] = candidates[np.searchsorted(candidates, earliest)]
        earliest = times[number] + max(holdoff - slack, slack)
    return times
