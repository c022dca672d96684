"""Hardware-timed bursts: the DMD plays pictures, its sync output triggers the AWG, the AWG's marker the oscilloscope.

Software only loads and collects, so the DMD's own rate is the limit.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.errors import InstrumentError, NoTrigger
from instruments.interfaces import BurstDmd
from instruments.values import Drive, Frames, Timebase
from protocols.base import Part, ProtocolError, Record, Shot
from protocols.means import averaged
from protocols.patterns import Patterns

SETTLED_PERIODS = 2
"""Of the periods the AWG plays at each trigger, those that pass before the frame: fibre and chip then carry light of
the running drive only, as if it had played for ever. As many follow as the frame lasts."""
LONGEST_BURST = 2000
"""Frames of one burst by default: storing one takes as long as playing the next, and an interrupted run waits for no
more."""
UPLOAD_BLOCK = 250


def frame_start_s(dmd: BurstDmd, drive: Drive, window_s: float) -> float:
    """How long after its trigger, the end of the DMD's pulse, a frame of a burst begins, s.

    Raises:
        ProtocolError: a frame of `window_s` would last into the next picture.
    """
    start_s = SETTLED_PERIODS * drive.period_s
    end_s, picture_s = dmd.pulse_s + start_s + window_s, dmd.picture_period_s
    if round(end_s - picture_s, 12) > 0:
        raise ProtocolError(
            f"window = {window_s * 1e6:g} us: in a burst a frame would end {end_s * 1e6:g} us after its picture began, "
            f"and a picture lasts {picture_s * 1e6:g} us: choose a shorter window, or timing = 'software'"
        )
    return start_s


def shots_a_burst(averages: int, longest_burst: int | None) -> int:
    """How many shots a burst has at most, each the mean of so many triggers; None: as many as `LONGEST_BURST` frames.

    It has fewer where the oscilloscope's memory holds fewer frames.
    """
    return longest_burst or max(1, LONGEST_BURST // averages)


def burst_dmd(bench: Bench) -> BurstDmd:
    """The DMD of a bench that is wired for bursts.

    Raises:
        ProtocolError: the station says that it is not, or its DMD cannot play from memory.
    """
    if not bench.wiring.burst:
        raise ProtocolError(
            f"{bench.source}: timing = 'burst' needs wiring.burst = true, and so does a scene that changes (DMD sync "
            f"to AWG trigger, AWG marker to scope): wire it, or measure still images with timing = 'software'"
        )
    if not isinstance(bench.dmd, BurstDmd):
        raise ProtocolError(
            f"{bench.source}: this DMD cannot play from its memory, as bursts and scenes need: measure still images "
            f"with timing = 'software'"
        )
    return bench.dmd


def load_pictures(bench: Bench, mirrors: Iterable[NDArray[np.uint8]], count: int) -> None:
    """Put pictures into the memory of the bench's DMD as `BurstDmd.load` does; its observer follows the upload.

    Raises:
        OutOfRange: more than its capacity.
        ProtocolError: the bench has no such memory.
    """
    dmd, progress = burst_dmd(bench), partial(bench.observer.uploading, "DMD patterns")
    with bench.observer.step("upload"):
        dmd.load(mirrors, count, progress=progress)


class PictureMemory:
    """The shots in the DMD's memory: all of them if they fit, otherwise as many as fit, one part after the other."""

    def __init__(self, bench: Bench, patterns: Patterns, shots: Sequence[Shot]) -> None:
        """Load what can be loaded once for all passes."""
        self._bench = bench
        self._patterns = patterns
        self._shots = shots
        capacity = burst_dmd(bench).capacity()
        self.parts = [range(first, min(first + capacity, len(shots))) for first in range(0, len(shots), capacity)]
        self._loaded: range | None = None
        self.load(self.parts[0])

    def load(self, part: range) -> None:
        """Have the shots of `part` in memory."""
        if part != self._loaded:
            load_pictures(self._bench, self._blocks(part), len(part))
            self._loaded = part

    def _blocks(self, part: range) -> Iterator[NDArray[np.uint8]]:
        """Each is drawn while the one before goes to the DMD."""
        blocks = (
            self._patterns.block(self._shots[first : min(first + UPLOAD_BLOCK, part.stop)])
            for first in range(part.start, part.stop, UPLOAD_BLOCK)
        )
        with ThreadPoolExecutor(1, thread_name_prefix="drawing") as beside:
            drawn = beside.submit(next, blocks, None)
            while (block := drawn.result()) is not None:
                drawn = beside.submit(next, blocks, None)
                yield block


def measure_bursts(
    bench: Bench,
    dmd: BurstDmd,
    memory: PictureMemory,
    part: Part,
    drive: Drive,
    timebase: Timebase,
    *,
    averages: int = 1,
    finer: int = 1,
    longest_burst: int | None = None,
) -> Iterator[Record]:
    """The shots of `part`, burst by burst, none of more than `longest_burst` shots; None: of `LONGEST_BURST` frames.

    For a mean of `averages` triggers the pictures of a burst are played as often, in one go; its codes are so many
    times `finer`.

    Raises:
        InstrumentError: a frame is missing, or came at the wrong time.
        ProtocolError: a frame would last into the next picture, or the oscilloscope cannot hold those of one mean.
    """
    window_s = timebase.samples / timebase.sample_rate
    start_s = frame_start_s(dmd, drive, window_s)
    periods = math.ceil(round(window_s / drive.period_s, 9))
    bench.load_drive(drive, periods_per_trigger=SETTLED_PERIODS + periods)
    bench.play_drive()
    bench.configure(replace(timebase, delay_s=start_s), part.pass_.patching)
    dmd.hold()
    if averages > (most := bench.scope.most_frames()):
        raise ProtocolError(
            f"averages = {averages}: a burst has all triggers of a picture, and the scope's memory holds {most} frames "
            f"of this window: choose fewer, or a shorter window"
        )
    longest = min(shots_a_burst(averages, longest_burst), most // averages)
    for held in memory.parts:
        for burst_of in stretches([shot.index for shot in part.shots if shot.index in held], longest):
            memory.load(held)
            count, first = len(burst_of), burst_of.start - held.start
            play = partial(dmd.play, first, count, dmd.picture_period_s, rounds=averages)
            burst = played(bench, averages * count, play)
            check_times(burst, averages * count, dmd.picture_period_s)
            rounds = [burst.part(begin, begin + count) for begin in range(0, averages * count, count)]
            yield Record(part.pass_, burst_of.start, averaged(rounds, finer))


def played(bench: Bench, frames: int, play: Callable[[], None]) -> Frames:
    """The burst of so many frames whose pictures `play` has the DMD show.

    Raises:
        NoTrigger: frames are missing; the message names the cables that start them.
    """
    try:
        return bench.capture_burst(frames, play)
    except NoTrigger as error:
        source = bench.wiring.trigger.source
        raise NoTrigger(
            f"{error}; frames of a burst need both cables, DMD frame sync -> AWG trigger input and AWG marker -> "
            f"scope {source if source == 'AUX' else f'CH{source}'}"
        ) from None


def stretches(indices: Sequence[int], longest: int) -> Iterator[range]:
    """Ascending `indices` as ranges without gaps, none of more than `longest`."""
    start = 0
    for place in range(1, len(indices) + 1):
        if place == len(indices) or indices[place] != indices[place - 1] + 1 or place - start == longest:
            yield range(indices[start], indices[place - 1] + 1)
            start = place


def check_times(burst: Frames, count: int, period_s: float) -> None:
    """Compare number and time stamps of the frames with the pictures that were played, one every `period_s`.

    Raises:
        InstrumentError: a frame is missing, or two are not one picture apart.
    """
    if burst.time_s.shape != (count,):
        raise InstrumentError(f"scope: {burst.time_s.size} frames for {count} pictures: check the trigger wiring")
    late = np.abs(np.diff(burst.time_s) - period_s) > period_s / 2
    if late.any():
        frame = int(np.argmax(late)) + 1
        gap = burst.time_s[frame] - burst.time_s[frame - 1]
        raise InstrumentError(
            f"scope: frame {frame} came {gap * 1e6:.1f} us after the one before, pictures are "
            f"{period_s * 1e6:g} us apart: a trigger was missed or came twice; check its wiring and levels"
        )
