"""The acquisition system of the virtual oscilloscope: arming, waiting for triggers, taking, keeping and handing over.

The digitiser's noise of a frame comes from that frame's own key, so that the number of triggers which are digitised
together changes no byte. Source: instrument facts 2.5, 2.6, 2.8 and 2.10.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from time import perf_counter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics.receiver import digitiser_noise_codes
from sim_backends.scpi.commands import Command
from sim_backends.scpi.messages import Chunk
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.oscilloscope.fastframe import READY_S, SUMMARY_FRAMES, FastFrame
from sim_backends.virtual.oscilloscope.horizontal import Horizontal, Records
from sim_backends.virtual.oscilloscope.instrument import Oscilloscope
from sim_backends.virtual.oscilloscope.mathematics import Math, Reference
from sim_backends.virtual.oscilloscope.modes import (
    NO_CODES,
    Codes,
    Kept,
    Mode,
    aligned,
    finished,
    kept,
    run_on,
    summarised,
)
from sim_backends.virtual.oscilloscope.plan import Plan, planned
from sim_backends.virtual.oscilloscope.transfer import Preamble, Trace, Transfer
from sim_backends.virtual.oscilloscope.trigger import Trigger
from sim_backends.virtual.oscilloscope.vertical import CHANNELS, Channel, Vertical
from sim_backends.world.keyed_random import derived
from sim_backends.world.receivers import FrontEnd
from sim_backends.world.signals import Acquisition, Record
from sim_backends.world.world import World

ARM_S = 20e-3  # recalled: from RUN until the acquisition system waits for a trigger
READ_S = 5e-3  # recalled: a record of some thousand points from acquisition memory to the network
AUTO_TRIGGER_S = 0.1  # recalled: AUTO mode waits this long for a trigger before it does without
TRIGGERS_LOOKED_UP = 10_000  # at once, while FastFrame runs until it is stopped
SAMPLES_AT_ONCE = 2**22  # of all channels together; bounds the memory, not the result


@dataclass(eq=False)
class Progress:
    """An acquisition under way: what has been recorded of it.

    times: (triggers,) s, virtual, of each time that triggers were taken. offsets: how far from a sample (s). goes_on:
    whether it began with `frames`, the running average of the acquisition before. others: digitises the points behind
    those of `frames`, (channels, triggers, samples), where these are not all.
    """

    plan: Plan
    times: list[NDArray[np.float64]] = field(default_factory=list)
    offsets: list[NDArray[np.float64]] = field(default_factory=list)
    frames: Kept = field(default_factory=list)
    missing: int = 0
    goes_on: bool = False
    others: Callable[[], Codes] | None = None

    def __post_init__(self) -> None:
        self.missing = self.plan.triggers
        self.goes_on = bool(self.frames)

    def add(self, codes: Codes, offsets: NDArray[np.float64]) -> None:
        """Keep codes (channels, triggers, samples) and sub-sample times (s) of some triggers."""
        plan = self.plan
        if plan.aligned:
            codes, offsets = aligned(codes, offsets, plan.sampled.sample_rate), np.zeros_like(offsets)
        self.offsets.append(offsets)
        if plan.mode == "SAMple":
            self.frames.append(codes)
        elif self.goes_on:
            self.frames = run_on(self.frames, codes, plan.triggers)
        else:
            self.frames = kept(plan.mode, self.frames, codes, plan.acquisition.samples)

    def codes(self, points: int) -> Codes:
        """(channels, frames, samples) of what there is, so many points or more; at least one trigger must have come."""
        if self.others is not None and points > self.frames[0].shape[-1]:
            self.frames, self.others = [np.concatenate([self.frames[0], self.others()], axis=-1)], None
        if self.plan.mode != "SAMple":
            triggers = self.plan.triggers if self.goes_on else sum(times.size for times in self.times)
            return finished(self.plan.mode, self.frames, triggers)
        if len(self.frames) > 1:  # one array from now on: an acquisition is read many times
            self.frames = [np.concatenate(self.frames, axis=1)]
        return self.frames[0]


class AcquisitionSystem(Oscilloscope):
    """Settings, triggers and records of an oscilloscope; a model adds the commands and what sets it apart."""

    PLANNED_BY: ClassVar[frozenset[Command]]  # what changes how samples are taken
    RECORDS: ClassVar[Records]
    PREAMBLE: ClassVar[type[Preamble]] = Preamble
    FULL_BANDWIDTH_HZ: ClassVar[float]
    BITS: ClassVar[int]  # of its digitiser

    def __init__(self, world: World, section: Mapping[str, Any] | None = None, *, effective_bits: float) -> None:
        super().__init__(world, section)
        self._digitiser_noise = digitiser_noise_codes(effective_bits, self.BITS)
        self._shown: Progress | None = None
        self._traces: dict[int, Trace] = {}
        self.references = {number: Reference() for number in CHANNELS.values()}

    def reset(self) -> None:
        """`*RST`: factory settings."""
        bandwidth_hz = self.FULL_BANDWIDTH_HZ
        self.channels = {
            number: Channel(selected=number == 1, bandwidth_hz=bandwidth_hz) for number in CHANNELS.values()
        }
        self.horizontal = Horizontal(self.RECORDS)
        self.frames = FastFrame()
        self.trigger = Trigger()
        self.mode = Mode()
        self.transfer = Transfer()
        self.math = {number: Math() for number in CHANNELS.values()}
        for reference in self.references.values():
            reference.selected = False
        self._planned: Plan | None = None
        self._running = False
        self._ready_s = 0.0  # triggers before this virtual time are none of the acquisition under way
        self._progress: Progress | None = None
        self._rolling: NDArray[np.float64] = np.empty(0)
        self.forget_acquisitions("ALL")

    def changed(self, command: Command) -> None:
        """Plan anew after a setting; with more than two channels on, the highest sample rate is shared out."""
        if command in self.PLANNED_BY:
            selected = sum(channel.selected for channel in self.channels.values())
            self.horizontal.settle(channels=selected, frames=self.frames.on)
            self._planned = None

    @property
    def plan(self) -> Plan:
        """What the present settings sample, and when."""
        if self._planned is None:
            frames = self.frame_count if self.frames.on else None
            self._planned = planned(self.channels, self.horizontal, self.trigger, self.mode, frames)
        return self._planned

    @property
    def frame_count(self) -> int:
        """Frames to take, at most what the memory holds at the present length; -222 beyond that."""
        return min(self.frames.count, self._room())

    @frame_count.setter
    def frame_count(self, count: int) -> None:
        if count > self._room():
            raise ScpiError(-222, f"{count} frames, the memory holds {self._room()}")
        self.frames.count = count

    def most_frames(self) -> int:
        """`HORizontal:FASTframe:MAXFRames?`: what the acquisition memory holds at the present length."""
        return self.RECORDS.longest // self.horizontal.record_length

    def _room(self) -> int:
        return max(1, self.most_frames() - (0 if self.frames.summary == "NONe" else SUMMARY_FRAMES))

    # --- run control

    @property
    def acquiring(self) -> bool:
        """Whether the acquisition system runs; setting it starts a new acquisition or stops."""
        self.pending()
        return self._running

    @acquiring.setter
    def acquiring(self, run: bool) -> None:
        if run:
            self._acquisitions = self._frames_acquired = 0
            self._running = True
            self.world.clock.advance(READY_S if self.frames.on else ARM_S)
            self._ready_s, self._progress, self._rolling = self.world.clock.now, None, np.empty(0)
            if not self.frames.on:  # FastFrame is ready for its first trigger now: let clients start the burst
                self.pending()
        elif self._running:
            if self.mode.stop_after == "RUNSTop":
                self._look()  # the screen has shown acquisitions until now: the last one stays
            elif self._until_stopped:
                self._take_last_frames()
            self._running = False

    def pending(self) -> bool:
        """Whether a single acquisition waits for its triggers; takes those that come."""
        if not self._running or self.mode.stop_after == "RUNSTop":
            return False
        if self._until_stopped:
            self._follow()
            return True
        self._running = not self._look()
        return self._running

    @property
    def _until_stopped(self) -> bool:
        return self.frames.on and self.frames.sequence == "LAST" and self.mode.stop_after == "SEQuence"

    def _look(self) -> bool:
        """Take the triggers that come; False if the acquisition waits for more."""
        progress = self._under_way()
        while self._progress is progress:
            times = self._upcoming(progress.missing, self._ready_s)
            if times is None:
                self._ready_s = max(self._ready_s, self.world.clock.now)
                if self.trigger.mode == "NORMal":
                    return False
                self.world.clock.advance(AUTO_TRIGGER_S)
                times = self._untriggered(progress.missing)
            self._take(times)
        return True

    def _under_way(self) -> Progress:
        if self._progress is None:
            before: Kept = []
            if self.mode.stop_after == "RUNSTop":
                self._ready_s = max(self._ready_s, self.world.clock.now)
                shown = self._shown if self._acquisitions and self.plan.mode == "AVErage" else None
                before = shown.frames if shown is not None and shown.plan is self.plan else []
            self._progress = Progress(self.plan, frames=before)
        return self._progress

    def _upcoming(self, count: int, after_s: float) -> NDArray[np.float64] | None:
        condition, spacing_s = self.plan.condition, self.plan.spacing_s
        if condition is None:
            return self.trigger.upcoming(self.world, count, spacing_s, after_s)
        return self.world.next_triggers(condition, count, spacing_s, after_s=after_s)

    def _untriggered(self, count: int) -> NDArray[np.float64]:
        return self.world.clock.now + self.plan.spacing_s * np.arange(count, dtype=np.float64)

    def _take(self, times: NDArray[np.float64]) -> None:
        """Record after each of `times`; the acquisition is complete with its last trigger, or where memory gives out.

        Raises:
            MemoryError: there is none for it; the acquisition is given up.
        """
        progress = self._under_way()
        try:
            if progress.plan.pointwise and self.transfer.last < progress.plan.acquisition.samples:
                self._take_first_points(progress, times)
            else:
                for codes, offsets in self._digitised(progress.plan, times):
                    progress.add(codes, offsets)
        except MemoryError:  # perhaps some of `times` were added: nothing of it is shown
            self._running, self._progress, self._traces = False, None, {}
            self._shown = None if self._shown is progress else self._shown
            raise
        progress.times.append(times)
        progress.missing -= times.size
        self._ready_s = float(times[-1]) + self.plan.spacing_s
        acquisition = progress.plan.acquisition
        end_s = float(times[-1]) + acquisition.start_s + acquisition.samples / acquisition.sample_rate
        self.world.clock.advance(max(0.0, end_s - self.world.clock.now))
        self._acquisitions += 0 if self.frames.on else times.size
        self._frames_acquired += times.size
        self._traces = {}
        self._shown = progress
        self._sent_new = False
        if progress.missing <= 0:
            self._acquisitions += self.frames.on
            self._progress = None

    def _follow(self) -> None:
        """While FastFrame runs until it is stopped: note the triggers that have come by now."""
        while True:
            times = self._upcoming(TRIGGERS_LOOKED_UP, self._ready_s)
            come = np.empty(0) if times is None else times[times <= self.world.clock.now]
            if come.size == 0:
                return
            self._rolling = np.concatenate([self._rolling, come])[-self.frame_count :]
            self._frames_acquired += come.size
            self._ready_s = float(come[-1]) + self.plan.spacing_s

    def _take_last_frames(self) -> None:
        """Record the last frames before the stop; the next ones if there was none."""
        self._follow()
        times = self._rolling if self._rolling.size else self._upcoming(self.frame_count, self._ready_s)
        if times is not None:
            counted = self._frames_acquired
            self._take(times)
            self._frames_acquired = max(counted, times.size)
        self._progress = None

    def trigger_state(self) -> str:
        """`TRIGger:STATE?`: what the front panel shows."""
        if self.pending():
            return "READY"
        if not self._running:
            return "SAVE"
        if self._upcoming(1, self.world.clock.now) is not None:
            return "TRIGGER"
        return "AUTO" if self.trigger.mode == "AUTO" else "READY"

    def force_trigger(self, _word: str) -> None:
        """`TRIGger FORCe`: take what is there now, one frame of FastFrame, if an acquisition waits."""
        if not self.pending():
            return
        self._take(self._untriggered(1 if self.frames.on else self._under_way().missing))
        self._running = self._progress is not None or self._until_stopped

    def count_acquisitions(self) -> int:
        """`ACQuire:NUMACq?`: acquisitions since RUN; FastFrame's many frames are one."""
        self.pending()
        return self._acquisitions

    def count_frames(self) -> int:
        """`ACQuire:NUMFRAMESACQuired?`: frames since RUN in a FastFrame single sequence, otherwise acquisitions."""
        self.pending()
        single_sequence = self.frames.on and self.mode.stop_after == "SEQuence"
        return self._frames_acquired if single_sequence else self._acquisitions

    def busy(self) -> bool:
        """`BUSY?`."""
        return self.acquiring

    # --- from volts to codes

    def _take_first_points(self, progress: Progress, times: NDArray[np.float64]) -> None:
        """Digitise the points that are to be sent, the others when they are: a record begins at hundreds of points."""
        plan = progress.plan
        first, behind = _parts(plan.acquisition, self.transfer.last)
        record = self.world.record(first, times, setting=plan.verticals_key, whole=plan.acquisition)
        progress.add(self._codes(record, plan.verticals), record.trigger_offset_s)

        def others() -> Codes:
            keys = tuple(derived(record.keys, "others"))
            return self._codes(replace(record, volts=record.further(behind), keys=keys), plan.verticals)

        progress.others = others

    def _digitised(self, plan: Plan, times: NDArray[np.float64]) -> Iterator[tuple[Codes, NDArray[np.float64]]]:
        """Codes (channels, triggers, samples) and trigger offsets (triggers,) in s, for as many as fit at once."""
        sampled, inputs = plan.sampled, [(vertical.deskew_s, vertical.limit_hz) for vertical in plan.verticals]
        narrowest_hz = min((limit_hz for _, limit_hz in inputs), default=math.inf)
        drawn = sampled.samples + math.ceil(sampled.sample_rate / narrowest_hz)  # what is narrow has noise from before
        step = max(1, SAMPLES_AT_ONCE // max(1, len(inputs) * drawn))
        for first in range(0, times.size if inputs else 0, step):
            last = max(inputs)
            own_times, spanned = times[first : first + step], _spanned(sampled, *inputs)
            record = self.world.record(_through(sampled, *last), own_times, setting=plan.verticals_key, whole=spanned)
            codes = self._codes(record, plan.verticals)
            for another in set(inputs) - {last}:  # channels with other times or bandwidths, behind the same triggers
                rows = [row for row, own in enumerate(inputs) if own == another]
                part, keys = _through(sampled, *another), tuple(derived(record.keys, "deskew", *another))
                other = replace(record, volts=record.further(part)[:, rows], keys=keys)
                codes[rows] = self._codes(other, [plan.verticals[row] for row in rows])
            yield codes, record.trigger_offset_s

    def _codes(self, record: Record, verticals: Sequence[Vertical]) -> Codes:
        """Codes (channels, triggers, samples)."""
        began = perf_counter()
        seen = [_seen(record.volts[:, channel], vertical) for channel, vertical in enumerate(verticals)]
        front_ends = [FrontEnd(*vertical[:3]) for vertical in verticals]
        codes = self.world.receivers.digitised(record.keys, seen, front_ends, self._digitiser_noise, self.BITS)
        self.world.physics_seconds += perf_counter() - began
        return codes

    # --- handing over

    def trace(self, number: int) -> Trace | None:
        """What was last acquired of a channel."""
        shown = self._shown
        if shown is None or number not in shown.plan.acquisition.channels:
            return None
        wanted = min(self.transfer.last, shown.plan.acquisition.samples)
        if not self._traces or self._traces[number].codes.shape[-1] < wanted:
            codes, plan, offsets = shown.codes(wanted), shown.plan, np.concatenate(shown.offsets)
            if self.frames.on and self.frames.summary != "NONe" and shown.missing <= 0:
                codes = summarised(codes, self.frames.summary, fine=self.frames.sixteen_bit)
            if plan.mode in ("AVErage", "ENVelope"):
                offsets = offsets.mean(keepdims=True)
            times = np.concatenate(shown.times)[: codes.shape[1]]
            for channel, own, vertical in zip(plan.acquisition.channels, codes, plan.verticals, strict=True):
                self._traces[channel] = Trace(channel, own, plan, vertical, times, offsets)
        return self._traces[number]

    def acquired_trace(self, number: int) -> Trace:
        """What was last acquired of a channel; 2241 if there is nothing."""
        self.pending()
        trace = self.trace(number)
        if trace is None:
            raise ScpiError(2241, f"CH{number}: nothing acquired")
        return trace

    def shown(self, source: str) -> bool:
        """Whether a channel, a computed or a stored waveform is on."""
        kinds: dict[str, dict[int, Any]] = {"CH": self.channels, "MATH": self.math, "REF": self.references}
        return bool(kinds[source[:-1]][int(source[-1])].selected)

    def acquired(self, source: str) -> Trace:
        """The whole waveform of a channel, an expression or a reference; 2241 if there is none."""
        kind, number = source[:-1], int(source[-1])
        if kind == "CH":
            self.pending()
            if self._shown is not None and self._shown.others is not None:
                self._shown.codes(self.RECORDS.longest)
                self._traces = {}
            return self.acquired_trace(number)
        if kind == "MATH":
            return self.math[number].trace(self.acquired)
        stored = self.references[number].trace
        if stored is None:
            raise ScpiError(2241, f"{source}: nothing stored")
        return stored

    def look_again(self) -> int:
        """While the oscilloscope runs freely, begin with a new acquisition; returns how many triggers were recorded."""
        if not self.pending() and self._running:
            self._look()
        return self._frames_acquired

    def curve(self) -> list[Chunk]:
        """`CURVe?`: the points of every source; 2244 if one is off, 2241 if there is nothing to send.

        While the oscilloscope runs freely, each transfer begins with a new acquisition.
        """
        for source in self.transfer.sources:
            if not self.shown(source):
                raise ScpiError(2244, source)
        self.look_again()
        reply: list[Chunk] = []
        for source in self.transfer.sources:
            trace = self.acquired_trace(CHANNELS[source]) if source in CHANNELS else self.acquired(source)
            reply += [b",", *trace.curve(self.transfer)]
        self._sent_new = True
        self.world.clock.advance(READ_S)
        return reply[1:]

    @property
    def preamble(self) -> Preamble:
        """The preamble of the first source; before its first acquisition, of what the settings lead to expect."""
        self.pending()
        source = self.transfer.sources[0]
        if source not in CHANNELS:
            if not self.shown(source):
                raise ScpiError(2244, source)
            return self.PREAMBLE(self.acquired(source), self.transfer)
        number = CHANNELS[source]
        trace = self.trace(number)
        if trace is None:
            vertical, now_s = self.channels[number].vertical, np.array([self.world.clock.now])
            trace = Trace(number, NO_CODES, self.plan, vertical, now_s, np.zeros(1))
        return self.PREAMBLE(trace, self.transfer)

    def forget_acquisitions(self, _word: str) -> None:
        """`CLEAR ALL`."""
        self._traces, self._shown = {}, None
        self._sent_new = True
        self._acquisitions = self._frames_acquired = 0


@lru_cache(maxsize=16)
def _through(acquisition: Acquisition, deskew_s: float, limit_hz: float) -> Acquisition:
    """What an input samples that is so late and so narrow."""
    return replace(acquisition, start_s=acquisition.start_s + deskew_s, bandwidth_hz=limit_hz)


@lru_cache(maxsize=16)
def _spanned(acquisition: Acquisition, *inputs: tuple[float, float]) -> Acquisition:
    """What all inputs sample together, each so late and so narrow."""
    late_s = [deskew_s for deskew_s, _ in inputs]
    more = math.ceil((max(late_s) - min(late_s)) * acquisition.sample_rate)
    first = _through(acquisition, min(late_s), min(limit_hz for _, limit_hz in inputs))
    return replace(first, samples=acquisition.samples + more)


@lru_cache(maxsize=16)
def _parts(whole: Acquisition, points: int) -> tuple[Acquisition, Acquisition]:
    """The first points of an acquisition, and the others."""
    start_s = whole.start_s + points / whole.sample_rate
    return replace(whole, samples=points), replace(whole, samples=whole.samples - points, start_s=start_s)


def _seen(volts: NDArray[np.float32], vertical: Vertical) -> NDArray[np.float32]:
    """What reaches the digitiser of one channel, in volts in front of its attenuator."""
    if vertical.grounded:
        return np.zeros_like(volts)
    if vertical.attenuation != 1:
        volts = volts * np.float32(vertical.attenuation)
    return -volts if vertical.inverted else volts
