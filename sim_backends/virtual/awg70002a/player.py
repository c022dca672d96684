"""Playing on one channel of the virtual AWG: the schedule of its asset, triggers and jumps, the step it has come to.

A trigger that comes while a segment plays is ignored. Triggers at the inputs' connectors are the world's affair: the
player counts those that software gives.  Source: instrument facts 1.6 and 1.7.
"""

from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a.channels import Source
from sim_backends.virtual.awg70002a.schedule import Schedule, Stage, schedule
from sim_backends.virtual.awg70002a.sequences import SequenceEntry, SequenceList, target
from sim_backends.virtual.awg70002a.waveforms import SHORTEST, Waveform, WaveformList
from sim_backends.world.world import VirtualClock

STOPPED, WAITING, RUNNING = 0, 1, 2
INTERNAL = "ITRigger"


def playable(waveform: Waveform | None, what: str) -> Waveform:
    """A waveform that a channel can play: -221 for none, -222 for one that is too short."""
    if waveform is None:
        raise ScpiError(-221, f"{what} has no waveform")
    if waveform.length < SHORTEST:
        raise ScpiError(-222, f"{waveform.name} has {waveform.length} points, {SHORTEST} are the least")
    return waveform


def stages(
    sequence: SequenceEntry,
    track: int,
    component: str,
    waveforms: WaveformList,
    sequences: SequenceList,
    *,
    within: bool = False,
) -> list[Stage]:
    """The steps of a track, ready to be played; -221 for a step without a waveform or a sub-sequence in another."""
    found = []
    count = len(sequence.entries)
    for number, step in enumerate(sequence.entries, 1):
        asset, what = step.assets[track - 1], f"step {number} of {sequence.name}"
        waveform: Waveform | None = None
        inner: tuple[Stage, ...] = ()
        if step.subsequence:
            below = sequences.find(asset)
            if within or below is None or track > below.tracks:
                raise ScpiError(-221, f"{what} has no sub-sequence that can be played")
            inner = tuple(stages(below, track, component, waveforms, sequences, within=True))
        else:
            waveform = playable(waveforms.find(asset), what)
            waveform.component(component)
        wait = None if step.wait == "OFF" else step.wait
        goal = target(step.goto, number, count)
        following = None if goal is None else min(goal - 1, count)
        found.append(Stage(number, wait, waveform, inner, component, step.times, following))
    return found


class Player:
    """What one channel plays while the generator runs."""

    def __init__(self, source: Source, clock: VirtualClock) -> None:
        self.source = source
        self._clock = clock
        self.schedule: Schedule | None = None
        self.begin()

    def begin(self) -> None:
        """RUN: from the first step on."""
        self._start: int | None = 0
        self._key: tuple[object, ...] = ()
        self._triggers = 0
        self._busy_until_s = 0.0

    def arrange(self, waveforms: WaveformList, sequences: SequenceList, trigger_input: str) -> None:
        """Compile the channel's asset if it or how it is run has changed; ScpiError if it cannot be played."""
        source = self.source
        asset: tuple[object, ...] = (source.waveform, source.component)
        if source.sequence is not None:
            asset = (source.sequence, source.track, source.component, waveforms.version, sequences.version)
        key = (asset, source.run_mode, trigger_input, self._start)
        if key == self._key:
            return
        self._key, self.schedule, self._triggers = key, None, 0
        if self._start is None or not source.assigned:
            return
        if source.sequence is not None:
            steps = stages(source.sequence, source.track, source.component, waveforms, sequences)
        else:
            waveform = playable(source.waveform, f"channel {source.number}")
            steps = [Stage(0, None, waveform, (), source.component, 1, 1)]
        self.schedule = schedule(steps, min(self._start, len(steps) - 1), source.run_mode, trigger_input)

    @property
    def external(self) -> bool:
        """Whether everything that is waited for comes in at input A."""
        return self.schedule is not None and set(self.schedule.waits) == {"ATRigger"}

    def state(self) -> int:
        """WAITING or RUNNING; the end of a sequence still runs."""
        found = self.schedule
        if found is None or not found.waits or self._clock.now < self._busy_until_s or self._running_on():
            return RUNNING
        internal = found.runs_on and set(found.waits) == {INTERNAL}
        return RUNNING if internal else WAITING

    def trigger(self, name: str, sample_rate: float) -> bool:
        """A trigger at input `name`: whether it starts a segment. In a loop it may be an event that makes it jump."""
        found = self.schedule
        if found is None or self._clock.now < self._busy_until_s:
            return False
        if not found.waits or self._running_on():
            self._event(name, found)
            return False
        number = self._triggers % len(found.segments)
        if found.waits[number] != name:
            return False
        self._triggers += 1
        self._busy_until_s = self._clock.now + found.lengths()[number] / sample_rate
        return True

    def jump(self, where: int | str, sample_rate: float) -> None:
        """`JUMP:FORCe`: -221 unless a sequence is assigned, -222 beyond its last step."""
        sequence = self.source.sequence
        if sequence is None:
            raise ScpiError(-221, f"channel {self.source.number} plays no sequence")
        if where == "CURRent":
            where = max(1, self.step(sample_rate))
        goal = target(where, 1, len(sequence.entries))
        if goal is not None:
            _ = sequence.steps[goal]  # beyond the last: -222
        self._go(goal)

    def step(self, sample_rate: float) -> int:
        """The step that plays or waits now; 0 when there is none."""
        found = self.schedule
        if found is None:
            return 0
        segment = found.segments[-1]
        if not found.waits:
            total = found.lengths()[0]
            at = int(self._clock.now * sample_rate) % total
            for item in segment:
                at -= item.samples
                if at < 0:
                    return item.step
        elif not self._running_on():
            number = self._triggers % len(found.segments)
            if self._triggers == 0 or self._clock.now >= self._busy_until_s:
                return found.steps[number]
            segment = found.segments[number - 1]
        return segment[0].step if segment else 0

    def _running_on(self) -> bool:
        found = self.schedule
        return found is not None and found.runs_on and self._triggers >= len(found.segments)

    def _event(self, name: str, found: Schedule) -> None:
        sequence = self.source.sequence
        if sequence is None:
            return
        for item in found.segments[-1]:
            step = sequence.steps[item.step]
            if step.jump_input == name:
                self._go(target(step.jump_to, item.step, len(sequence.entries)))
                return

    def _go(self, goal: int | None) -> None:
        self._start = None if goal is None else goal - 1
        self._key, self._busy_until_s = (), 0.0
