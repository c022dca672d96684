"""What a channel plays, compiled: the path through the steps of a sequence, cut where it waits for a trigger.

A sequence's steps lead from one to the next in a fixed order, so its path is a piece that is played once and then a
loop, or an end. What is over before anyone can look (a piece in front of a loop that no trigger begins) is left out.
Behind the last step a cycle is complete: it begins again, in the triggered mode with the next trigger.
Source: instrument facts 1.6 and 1.7; the end of a cycle is recalled.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a.waveforms import Waveform

MOST_ITEMS = 2**20
LONGEST_PLAYBACK = 2**26  # samples of one channel that the simulation plays
UNROLLED_SEGMENTS, UNROLLED_SAMPLES = 1024, 2**22  # how far a loop behind a triggered beginning is written out
SILENCE = 64  # samples of 0 V that stand for the end of a sequence


@dataclass(frozen=True)
class Item:
    """A waveform played `repeats` times at a step (from 1; 0 without a sequence), `wait`ing for an input before."""

    step: int
    wait: str | None
    waveform: Waveform
    component: str = "I"
    repeats: int = 1

    @property
    def samples(self) -> int:
        """Samples in all."""
        return self.repeats * self.waveform.length


@dataclass(frozen=True)
class Stage:
    """One step ready to be played: a waveform, or the stages of a sub-sequence.

    Attributes:
        repeats: None for ever.
        following: Index (from 0) of the stage that follows; None: the end; behind the last: the cycle is complete.
    """

    step: int
    wait: str | None
    waveform: Waveform | None
    within: tuple["Stage", ...]
    component: str
    repeats: int | None
    following: int | None


@dataclass(frozen=True, eq=False)
class Schedule:
    """Segments, each started by a trigger at the input of `waits`; no waits: the one segment repeats for ever.

    Equal to itself alone: what is compiled again is played from its beginning.

    Attributes:
        segments: What is played; an empty segment is the end: 0 V.
        steps: the step that waits in front of each segment.
        runs_on: the last segment repeats for ever.
    """

    segments: tuple[tuple[Item, ...], ...]
    waits: tuple[str, ...] = ()
    steps: tuple[int, ...] = ()
    runs_on: bool = False

    def lengths(self) -> tuple[int, ...]:
        """Samples of each segment."""
        return tuple(sum(item.samples for item in segment) or SILENCE for segment in self.segments)


def path(stages: Sequence[Stage], start: int, *, again: bool) -> tuple[list[Item], int | None]:
    """The items played from stage `start` on, and the index among them that the path returns to (None: it ends).

    A complete cycle begins `again`, or ends. -225 if the path is too long to be simulated.
    """
    items: list[Item] = []
    seen: dict[int, int] = {}
    at: int | None = start
    while at is not None and (again or at < len(stages)):
        at = at if at < len(stages) else 0
        if at in seen:
            return items, seen[at]
        stage, seen[at] = stages[at], len(items)
        played, back = _played(stage)
        if back is not None:
            return items + played, len(items) + back
        items += played
        if len(items) > MOST_ITEMS:
            raise ScpiError(-225, f"a sequence of more than {MOST_ITEMS} parts")
        at = stage.following
    return items, None


def _played(stage: Stage) -> tuple[list[Item], int | None]:
    if stage.waveform is not None:
        item = Item(stage.step, stage.wait, stage.waveform, stage.component, stage.repeats or 1)
        return ([item], None) if stage.repeats is not None else ([item, replace(item, wait=None)], 1)
    once, back = path(stage.within, 0, again=False)
    once = [replace(item, step=stage.step) for item in once]
    first = replace(once[0], wait=stage.wait or once[0].wait)
    if back is not None:
        return [first, *once[1:], *once[back:]], len(once)
    if stage.repeats is None:
        return [first, *once[1:], *once], len(once)
    if stage.repeats * len(once) > MOST_ITEMS:
        raise ScpiError(-225, f"a sequence of more than {MOST_ITEMS} parts")
    return [first, *once[1:], *once * (stage.repeats - 1)], None


def schedule(stages: Sequence[Stage], start: int, mode: str, trigger_input: str) -> Schedule | None:
    """What is played from stage `start` on in a run mode (CONTinuous, TRIGgered, TCONtinuous); None: nothing any more.

    Raises:
        ScpiError: -225, too long to be simulated.
    """
    first = stages[0]
    if mode == "TRIGgered":
        stages = [replace(first, wait=first.wait or trigger_input), *stages[1:]]
    items, back = path(stages, start, again=True)
    if mode == "TCONtinuous" and items:
        items, back = _begun_by_trigger(items, back, trigger_input)
    found = _cut(items, back)
    if found is not None and sum(found.lengths()) > LONGEST_PLAYBACK:
        raise ScpiError(-225, f"{sum(found.lengths())} samples, {LONGEST_PLAYBACK} are the most that are simulated")
    return found


def _begun_by_trigger(items: list[Item], back: int | None, trigger_input: str) -> tuple[list[Item], int | None]:
    """The same path, whose beginning waits the first time only."""
    begun = [replace(items[0], wait=items[0].wait or trigger_input), *items[1:]]
    return (begun + items[back:], len(items)) if back is not None else (begun, None)


def _cut(items: list[Item], back: int | None) -> Schedule | None:
    once, loop = (items, []) if back is None else (items[:back], items[back:])
    if any(item.wait for item in loop):
        if any(item.wait for item in once):
            samples = max(1, sum(item.samples for item in loop))
            rounds = max(1, min(UNROLLED_SEGMENTS // len(loop), UNROLLED_SAMPLES // samples))
            return _segments(once + loop * rounds, [])
        return _segments(loop, loop)
    if not any(item.wait for item in once):
        return Schedule((tuple(loop),)) if loop else None
    found = _segments(once, [])
    last = found.segments[-1]
    if _alike(last, loop):
        return replace(found, runs_on=True)
    if loop:
        return replace(found, segments=(*found.segments[:-1], tuple(loop)), runs_on=True)
    return Schedule((*found.segments, ()), (*found.waits, found.waits[-1]), (*found.steps, 0), runs_on=True)


def _alike(items: Sequence[Item], others: Sequence[Item]) -> bool:
    return [replace(item, wait=None) for item in items] == [replace(item, wait=None) for item in others]


def _segments(items: Sequence[Item], cycle: Sequence[Item]) -> Schedule:
    """Cut where items wait; what comes before the first wait follows the last segment when `cycle` is played again."""
    begins = [index for index, item in enumerate(items) if item.wait]
    ends = [*begins[1:], len(items)]
    parts = [tuple(items[begin:end]) for begin, end in zip(begins, ends, strict=True)]
    parts[-1] += tuple(cycle[: begins[0]])
    waits, steps = zip(*((items[index].wait or "", items[index].step) for index in begins), strict=True)
    return Schedule(tuple(parts), waits, steps)


def rendered(found: Schedule, bits: int, mark: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """All segments after one another: what the DAC puts out (-1..1), and where the marker bit `mark` is set."""
    pieces: dict[tuple[Waveform, str], tuple[NDArray[np.float32], NDArray[np.bool_]]] = {}
    samples: list[NDArray[np.float32]] = []
    marks: list[NDArray[np.bool_]] = []
    for segment in found.segments:
        for item in segment:
            key = (item.waveform, item.component)
            if key not in pieces:
                pieces[key] = item.waveform.converted(bits, item.component), item.waveform.markers & mark != 0
            samples += [pieces[key][0]] * item.repeats
            marks += [pieces[key][1]] * item.repeats
        if not segment:
            samples.append(np.zeros(SILENCE, np.float32))
            marks.append(np.zeros(SILENCE, np.bool_))
    return (samples[0], marks[0]) if len(samples) == 1 else (np.concatenate(samples), np.concatenate(marks))
