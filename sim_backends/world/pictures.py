"""What the mirrors show and when: scenes of pictures on the virtual clock, with what was there before them."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics import mirrors
from sim_backends.world.keyed_random import digest
from sim_backends.world.signals import OutOfMemory, Projection

FLOATING = digest("floating")

_SLACK_S = 20e-12  # rounding of a large virtual time must not miss a latch
_AGE_STEP_S = 1e-12
_KEPT_SCENES = 16
_KEPT_PROJECTIONS = 2
"""Of the scenes that are kept: a projection can have thousands of pictures, each as large as a record."""

Amplitudes = Callable[[NDArray[np.float32]], NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class Sight:
    """What each of a record's triggers sees: rows of its scene's `amplitudes` and `names`.

    scenes: the scenes there are. scene: of each trigger. shown: latched when the trigger comes: what the record is
    named by. after: seen at the record's end. before: seen until the mirrors move. age_s: from the latch of `after` to
    the trigger (s), infinite where they stand still throughout.
    """

    scenes: tuple["Scene", ...]
    scene: NDArray[np.int64]
    shown: NDArray[np.int64]
    after: NDArray[np.int64]
    before: NDArray[np.int64]
    age_s: NDArray[np.float64]

    @property
    def names(self) -> list[bytes]:
        """Digest of the pattern that is latched when each trigger comes."""
        return [
            self.scenes[scene].names[row] for scene, row in zip(self.scene.tolist(), self.shown.tolist(), strict=True)
        ]


@dataclass(frozen=True, eq=False)
class Scene:
    """One pattern, or a projection's patterns, in the speckle basis. Row 0 is what the mirrors showed before.

    from_s: since when. shown: pictures until the last one stays, repetitions counted; infinite for a loop. state:
    names the pictures and their timing, but not when they started. amplitudes: (1 + n, r). names: one digest a row.
    latched_s: in slave mode, when pictures were latched so far, `trigger_delay_s` after each edge. lit_s: finite where
    a dark phase follows so long after each latch: its row then stands behind that of each picture, and counts as a
    picture of its own in `number`.
    """

    from_s: float
    start_s: float
    picture_time_s: float
    shown: float
    state: bytes
    names: tuple[bytes, ...]
    amplitudes: NDArray[np.float32]
    latched_s: list[float] | None = field(default=None)
    trigger_delay_s: float = 0.0
    lit_s: float = math.inf

    @cached_property
    def still(self) -> bool:
        """Whether it is one picture that stays."""
        return len(self.names) == 2 and self.latched_s is None

    @property
    def shortest_s(self) -> float:
        """The shortest time that a picture, or the dark behind it, stays (s)."""
        if math.isinf(self.lit_s):
            return self.picture_time_s
        return min(self.lit_s, self.picture_time_s - self.lit_s)

    def row(self, times: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Rows latched at `times` (s), rows before them, and when they were latched (s)."""
        number = self.number(times)
        return self._row(number), self._row(number - 1), self._latch_s(number)

    def shown_at(self, times: NDArray[np.float64]) -> NDArray[np.int64]:
        """Rows latched at `times` (s)."""
        return self._row(self.number(times))

    def advance(self, time_s: float) -> None:
        """An edge at the trigger input: in slave mode it latches the next picture, if the last one is old enough."""
        if self.latched_s is None:
            return
        earliest = self.latched_s[-1] + self.picture_time_s if self.latched_s else self.start_s
        latch_s = time_s + self.trigger_delay_s
        if latch_s >= earliest - _SLACK_S and len(self.latched_s) < self.shown:
            self.latched_s.append(latch_s)

    def number(self, times: NDArray[np.float64]) -> NDArray[np.int64]:
        """Number of the picture latched at each of `times`, counted from 0 through all repetitions; -1: none yet.

        Where there are dark phases, the number of its row.
        """
        if self.latched_s is not None:
            latched = np.searchsorted(np.array(self.latched_s), times + _SLACK_S, side="right") - 1.0
        elif self.still:
            latched = np.where(times < self.start_s - _SLACK_S, -1.0, 0.0)
        else:
            latched = np.floor((times - self.start_s + _SLACK_S) / self.picture_time_s)
        picture = np.asarray(np.minimum(np.maximum(latched, -1.0), self.shown - 1), np.int64)
        if math.isinf(self.lit_s):
            return picture
        dark = (picture >= 0) & (times - self._picture_s(picture) >= self.lit_s - _SLACK_S)
        return np.where(picture < 0, -1, 2 * picture + dark)

    def pictures(self, time_s: float) -> int:
        """How many pictures have been latched by `time_s`."""
        number = int(self.number(np.array([time_s]))[0])
        return number + 1 if math.isinf(self.lit_s) else number // 2 + 1

    def _row(self, number: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.where(number < 0, 0, 1 + number % (len(self.names) - 1))

    def _latch_s(self, number: NDArray[np.int64]) -> NDArray[np.float64]:
        if math.isinf(self.lit_s):
            return self._picture_s(number)
        return self._picture_s(number // 2) + np.where(number % 2, self.lit_s, 0.0)

    def _picture_s(self, picture: NDArray[np.int64]) -> NDArray[np.float64]:
        """When pictures of these numbers were latched (s)."""
        if self.latched_s is not None:
            known = np.array([-math.inf, *self.latched_s])
            return np.asarray(known[np.maximum(picture + 1, 0)], np.float64)
        latch = self.start_s + (0.0 if self.still else np.maximum(picture, 0) * self.picture_time_s)
        return np.where(picture < 0, -math.inf, latch)


def still_scene(from_s: float, before: bytes, state: bytes, amplitudes: NDArray[np.float32]) -> Scene:
    """One picture named `state`, latched at `from_s`, after one named `before`; amplitudes (2, r) of both."""
    return Scene(
        from_s=from_s,
        start_s=from_s,
        picture_time_s=math.inf,
        shown=1,
        state=state,
        names=(before, state),
        amplitudes=amplitudes,
    )


class Pictures:
    """The scenes of the mirrors, the latest ones kept: a record may be of what was a while ago."""

    def __init__(self, amplitudes: Amplitudes, *, leaves_s: float, arrives_s: float) -> None:
        self._amplitudes = amplitudes
        self._leaves_s, self._arrives_s = leaves_s, arrives_s
        names, floating = self._named(None)
        nothing = still_scene(-math.inf, names[0], names[0], np.repeat(floating, 2, axis=0))
        self._scenes = deque([nothing], maxlen=_KEPT_SCENES)

    def latch(self, counts: NDArray[np.uint16] | None, projection: Projection | None, now_s: float) -> bool:
        """Show pictures, (n, 784) mirrors on, as `projection` says or one for good; whether that is another state."""
        present = self._scenes[-1]
        if counts is not None and projection is not None and math.isfinite(projection.lit_s):
            counts = np.stack([counts, np.zeros_like(counts)], axis=1).reshape(-1, counts.shape[1])
        names, amplitudes = self._named(counts)
        state = state_of(names, projection)
        still = len(names) == 1 and (projection is None or not projection.triggered)
        if still and present.still and state == present.state:
            return False
        name, standing = self.standing(now_s)
        rows = np.concatenate([standing[np.newaxis], amplitudes])
        if projection is None:
            scene = still_scene(now_s, name, state, rows)
        else:
            scene = Scene(
                from_s=now_s,
                start_s=projection.start_s,
                picture_time_s=projection.picture_time_s,
                shown=math.inf
                if projection.loop
                else len(projection.counts) * projection.repeats - projection.left_out,
                state=state,
                names=(name, *names),
                amplitudes=rows,
                latched_s=[] if projection.triggered else None,
                trigger_delay_s=projection.trigger_delay_s,
                lit_s=projection.lit_s,
            )
        self._keep(scene)
        return state != present.state

    def hold(self, now_s: float) -> bool:
        """Keep the picture of now for good; whether that is another state."""
        present = self._scenes[-1]
        if present.still:
            return False
        after, before, latch = present.row(np.array([now_s]))
        name = present.names[after[0]]
        rows = present.amplitudes[[before[0], after[0]]]
        self._keep(replace(still_scene(now_s, present.names[before[0]], name, rows), start_s=float(latch[0])))
        return bool(name != present.state)

    def latched_count(self, now_s: float) -> int:
        """How many pictures of the present scene have been latched."""
        return self._scenes[-1].pictures(now_s)

    def advance(self, now_s: float) -> None:
        """An edge at the trigger input: in slave mode it latches the next picture."""
        self._scenes[-1].advance(now_s)

    def standing(self, time_s: float) -> tuple[bytes, NDArray[np.float32]]:
        """Name of the picture latched at `time_s`, and amplitudes (r,) of where the mirrors are on their way to it."""
        scene = self._scenes[-1]
        after, before, latch = scene.row(np.array([time_s]))
        moved = mirrors.moved_fraction(time_s - latch, leaves=self._leaves_s, arrives=self._arrives_s)[0]
        old, new = scene.amplitudes[before[0]], scene.amplitudes[after[0]]
        return scene.names[after[0]], old + np.float32(moved) * (new - old) if moved < 1 else new

    def latched(self, time_s: float) -> NDArray[np.float32]:
        """Amplitudes (r,) of the picture latched at `time_s`."""
        scene = self._scenes[-1]
        amplitudes: NDArray[np.float32] = scene.amplitudes[scene.shown_at(np.array([time_s]))[0]]
        return amplitudes

    def sight(self, times: NDArray[np.float64], *, begins_s: float, ends_s: float) -> Sight:
        """What triggers at `times` see in records from `begins_s` to `ends_s` after them.

        They see at most one change of the picture, the last one: see `stretches`.

        Raises:
            OutOfMemory: one of them came before the scenes that are kept.
        """
        scenes = tuple(self._scenes)
        if times.size and times.min() < scenes[0].from_s - _SLACK_S:
            raise OutOfMemory("what the mirrors showed at a trigger is no longer known: read frames sooner")
        begin = np.array([scene.from_s for scene in scenes[1:]])
        number = np.searchsorted(begin, times + _SLACK_S, side="right").astype(np.int64)
        shown, after, before = np.zeros((3, times.size), np.int64)
        age = np.zeros(times.size)
        for scene in set(number.tolist()):
            rows = number == scene
            shown[rows] = scenes[scene].shown_at(times[rows])
            after[rows], before[rows], latch = scenes[scene].row(times[rows] + max(0.0, ends_s) - self._leaves_s)
            age[rows] = np.rint((times[rows] - latch) / _AGE_STEP_S) * _AGE_STEP_S
        moving = (after != before) & (age + min(0.0, begins_s) < self._arrives_s)
        return Sight(scenes, number, shown, after, before, np.where(moving, age, math.inf))

    def stretches(self, times: NDArray[np.float64], *, begins_s: float, ends_s: float) -> NDArray[np.float64]:
        """Where records from `begins_s` to `ends_s` after `times` are cut (s), so that no part sees two changes.

        The ends are among it.
        """
        longest, first_s, last_s = math.inf, begins_s - self._arrives_s, ends_s - self._leaves_s
        for scene in self._scenes:
            if last_s - first_s < scene.shortest_s:  # as nearly every record
                continue
            if np.any(scene.number(times + last_s) - scene.number(times + first_s) > 1):
                longest = min(longest, scene.shortest_s + self._leaves_s - self._arrives_s)
        parts = math.ceil((ends_s - begins_s) / max(longest, self._leaves_s))
        return np.linspace(begins_s, ends_s, max(1, parts) + 1)

    def _keep(self, scene: Scene) -> None:
        """From now on it is the latest; the oldest ones are forgotten."""
        self._scenes.append(scene)
        projections = [place for place, one in enumerate(self._scenes) if not one.still]
        for _ in range(projections[-_KEPT_PROJECTIONS] if len(projections) > _KEPT_PROJECTIONS else 0):
            self._scenes.popleft()

    def _named(self, counts: NDArray[np.uint16] | None) -> tuple[tuple[bytes, ...], NDArray[np.float32]]:
        """Names and amplitudes (n, r) of pictures; None is floating mirrors."""
        if counts is None:
            return (FLOATING,), self._amplitudes(np.zeros((1, mirrors.SIDE**2), np.float32))
        return tuple(digest(row.tobytes()) for row in counts), self._amplitudes(mirrors.fraction(counts))


def state_of(names: tuple[bytes, ...], projection: Projection | None) -> bytes:
    """Digest of pictures and timing, without when they started: one picture is named by its mirrors alone."""
    if projection is None or (len(names) == 1 and not projection.triggered):
        return names[0]
    return digest(
        *names,
        float(projection.picture_time_s),
        float(projection.synch_delay_s),
        projection.loop,
        projection.repeats,
        projection.triggered,
        *((projection.left_out,) if projection.left_out else ()),
        *((float(projection.trigger_delay_s),) if projection.trigger_delay_s else ()),
        *((projection.lit_s,) if math.isfinite(projection.lit_s) else ()),
    )
