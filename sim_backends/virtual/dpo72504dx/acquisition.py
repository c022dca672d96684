"""The acquisition system of the virtual oscilloscope: arming, waiting for triggers, taking and keeping records.

Source: instrument facts 2.5, 2.6 and 2.8.
"""

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.commands import Command
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.dpo72504dx.fastframe import READY_S, FastFrame
from sim_backends.virtual.dpo72504dx.horizontal import LONGEST_RECORD, RATES, Horizontal
from sim_backends.virtual.dpo72504dx.modes import Mode, Plan, Progress, summarised
from sim_backends.virtual.dpo72504dx.transfer import Trace
from sim_backends.virtual.dpo72504dx.trigger import Trigger
from sim_backends.virtual.dpo72504dx.vertical import CHANNELS, Channel
from sim_backends.virtual.instrument import VirtualInstrument
from sim_backends.world.signals import Acquisition

ARM_S = 20e-3  # recalled: from RUN until the acquisition system waits for a trigger
REARM_S = 10e-6  # recalled: dead time between the acquisitions of an average
FRAME_REARM_S = 3e-6  # recalled: dead time between the frames of FastFrame
AUTO_TRIGGER_S = 0.1  # recalled: AUTO mode waits this long for a trigger before it does without
TRIGGERS_LOOKED_UP = 10_000  # at once, while FastFrame runs until it is stopped


class AcquisitionSystem(VirtualInstrument):
    """Settings, triggers and records of an oscilloscope; a model adds the commands."""

    def reset(self) -> None:
        """`*RST`: factory settings."""
        self.channels = {number: Channel(selected=number == 1) for number in CHANNELS.values()}
        self.horizontal = Horizontal()
        self.frames = FastFrame()
        self.trigger = Trigger()
        self.mode = Mode()
        self._running = False
        self._ready_s = 0.0  # triggers before this virtual time are none of the acquisition under way
        self._progress: Progress | None = None
        self._rolling: NDArray[np.float64] = np.empty(0)
        self._traces: dict[int, Trace] = {}
        self._shown: Progress | None = None
        self.forget_acquisitions("ALL")

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
            self._begin()
            if not self.frames.on:  # FastFrame is ready for its first trigger now: let clients start the burst
                self.pending()
        elif self._running:
            if self.mode.stop_after == "RUNSTop":
                self._look()  # the screen has shown acquisitions until now: the last one stays
            elif self._until_stopped:
                self._take_last_frames()
            self._running = False

    def _begin(self) -> None:
        self._ready_s = self.world.clock.now
        self._progress = None
        self._rolling = np.empty(0)

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

    def waiting_for_trigger(self) -> bool:
        """`TRIGger:A:READY?`: whether a trigger would have been taken when this was asked."""
        waiting = self._running and self.mode.stop_after == "SEQuence"
        self.pending()
        return waiting if self.frames.on else self._running and waiting

    def trigger_state(self) -> str:
        """`TRIGger:STATE?`: what the front panel shows."""
        if self.pending():
            return "READY"
        if not self._running:
            return "SAVE"
        return "TRIGGER" if self._upcoming(1, self.world.clock.now) is not None else self._idle_state

    @property
    def _idle_state(self) -> str:
        return "AUTO" if self.trigger.mode == "AUTO" else "READY"

    def force_trigger(self, _word: str) -> None:
        """`TRIGger FORCe`: take what is there now, one frame of FastFrame, if an acquisition waits."""
        if not self.pending():
            return
        progress = self._under_way()
        wanted = 1 if self.frames.on else progress.missing
        self._take(self._untriggered(wanted))
        self._running = self._progress is not None or self._until_stopped

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
            self._progress = Progress(self._plan)
            if self.mode.stop_after == "RUNSTop":
                self._ready_s = max(self._ready_s, self.world.clock.now)
        return self._progress

    def _upcoming(self, count: int, after_s: float) -> NDArray[np.float64] | None:
        return self.trigger.upcoming(self.world, count, self._spacing, after_s)

    @property
    def _spacing(self) -> float:
        """Least time between two triggers (s)."""
        rearm = FRAME_REARM_S if self.frames.on else REARM_S
        return self.trigger.spacing(self.horizontal.duration_s + rearm)

    def _untriggered(self, count: int) -> NDArray[np.float64]:
        return self.world.clock.now + self._spacing * np.arange(count, dtype=np.float64)

    def _take(self, times: NDArray[np.float64]) -> None:
        """Record after each of `times`; the acquisition is complete with its last trigger."""
        progress = self._under_way()
        progress.add(self.world, times)
        self._ready_s = float(times[-1]) + self._spacing
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
            self._ready_s = float(come[-1]) + self._spacing

    def _take_last_frames(self) -> None:
        """Record the last frames before the stop; the next ones if there was none."""
        self._follow()
        times = self._rolling if self._rolling.size else self._upcoming(self.frame_count, self._ready_s)
        if times is not None:
            counted = self._frames_acquired
            self._take(times)
            self._frames_acquired = max(counted, times.size)
        self._progress = None

    @property
    def _plan(self) -> Plan:
        """What the present settings sample."""
        rate, at, mode = self.horizontal.sample_rate, self.horizontal.trigger_sample, self.actual_mode
        selected = [number for number, channel in self.channels.items() if channel.selected]
        return Plan(
            Acquisition(tuple(selected), rate, self.horizontal.record_length, -at / rate),
            at,
            tuple(self.channels[number].vertical for number in selected),
            mode,
            self.frame_count if self.frames.on else self.mode.triggers(mode),
            self.mode.synchronous,
        )

    @property
    def frame_count(self) -> int:
        """Frames to take, at most what the memory holds at the present length; -222 beyond that."""
        return min(self.frames.count, self.most_frames())

    @frame_count.setter
    def frame_count(self, count: int) -> None:
        if count > self.most_frames():
            raise ScpiError(-222, f"{count} frames, the memory holds {self.most_frames()}")
        self.frames.count = count

    def most_frames(self) -> int:
        """`HORizontal:FASTframe:MAXFRames?`: what the acquisition memory holds at the present length."""
        return LONGEST_RECORD // self.horizontal.record_length

    def forget_acquisitions(self, _word: str) -> None:
        """`CLEAR ALL`."""
        self._traces = {}
        self._shown = None
        self._sent_new = True
        self._acquisitions = self._frames_acquired = 0

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

    @property
    def actual_mode(self) -> str:
        """The mode really used."""
        return self.mode.actual(self.horizontal.sample_rate, frames=self.frames.on)

    def _trace(self, number: int) -> Trace | None:
        """What was last acquired of a channel."""
        shown = self._shown
        if shown is None or number not in shown.plan.acquisition.channels:
            return None
        if not self._traces:
            summary = self.frames.summary if self.frames.on and shown.missing <= 0 else "NONe"
            codes = summarised(shown.codes(), summary, fine=self.frames.sixteen_bit)
            offsets, times = shown.trigger_offsets(), shown.trigger_times()[: codes.shape[1]]
            numbers, verticals = shown.plan.acquisition.channels, shown.plan.verticals
            for channel, own, vertical in zip(numbers, codes, verticals, strict=True):
                self._traces[channel] = Trace(channel, own, shown.plan, vertical, times, offsets)
        return self._traces[number]

    def _acquired_trace(self, number: int) -> Trace:
        self.pending()
        trace = self._trace(number)
        if trace is None:
            raise ScpiError(2241, f"CH{number}: nothing acquired")
        return trace

    def changed(self, _command: Command) -> None:
        """With more than two channels on, the highest sample rate is shared out."""
        shared = sum(channel.selected for channel in self.channels.values()) > 2
        self.horizontal.highest_rate = RATES[1] if shared else RATES[0]
