"""Are records those of their shots? Told from the records of a pass alone, where no setting of an instrument shows it.

Two records of one picture differ by noise, two of different pictures by much more, and a dark record is flat. How much
is noise, two dark records tell: whatever was shown, it was the same both times. Each channel is measured by its own
noise, so that one without light does not hide what another one shows. A record of the reference is held against its
neighbours: what it is rather like is the same whatever the noise. Where noise hides the pictures in all channels, or
chance would often make two of them look alike, nothing is said.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from instruments.values import Codes
from labctl.engine.alike import LIT, Alike, Unlike
from labctl.engine.darkness import LEAST_NOISE, SURE, Darkness, Known, within_noise
from labctl.engine.record_differences import (
    mean,
    mean_squares,
    median_and_scatter,
    part_of,
    quantile,
    rms,
    times_noise,
    variation,
)
from labctl.engine.repetition import UNLIKELY, Repetition
from protocols.base import Shot, ShotKind

CONTRAST = 6.0
"""Times the noise that different pictures must differ by, as a rule: below, records do not tell pictures apart. And all
but `FEW` of them by half of it: where single photons come, records of two pictures that hold none are alike."""
FEW, NOT_A_FEW = 0.1, 0.25
STEADY = 0.1
"""Part of the light that different pictures must differ by as well: power, gain and the trigger's jitter are common to
a record and vary by hundredths of the light, which no dark record shows."""
FEWEST_VALUES, FEWEST_OF_ONE_SHOT = 40, 80
"""Of a record, below which chance decides whether it looks like another one; and where one shot alone is judged."""
RATHER = 2.0
"""Times nearer that another record must be than its own, for a record to be taken for one of that picture."""
OTHER = 0.6
"""Part of what different pictures differ by, beyond which two records are not of one picture."""
STILL_USUAL_TIMES = 1.4
"""So many times what records of the reference differ by as a rule are still usual: where light of few photons makes
them differ nearly as much as those of different pictures."""
STRAYS = 5.0
"""Standard deviations by which the rms of a record's noise may stray: of n samples, every other one independent, by
1 / sqrt(n) of itself. Single photons make it stray further; then by as many of what references differed by so far."""
LIT_ALIKE = 0.7
"""Part of a record with light that a dark one holds where it is not dark."""
FLAT = 3.0
"""Times that a record with light varies more from sample to sample than a dark one."""
HARDLY = 1.1
"""Times the noise that records with light differ from dark ones at most where there is no light."""
MOST_VALUES = 256
"""Of each channel and record, which are looked at: enough to tell pictures apart, however long the record."""
MOST_PAIRS = 0.9
"""Part of the pairs of references that differ by no more than what light is taken to add to noise."""
REMEMBERED = 256
"""Differences between pictures that what is usual is taken from."""
ENOUGH = 3
"""Differences that what is usual is taken from at least."""
LATE = "bench: {}: pictures or records come late; switch oscilloscope and DMD off and on"
NOT_SHOWN = "dmd: shot {}: its record is {}, within noise: its picture was not shown{}; switch the DMD off and on"
DARK, BEFORE = ("dark", ", or has hardly a lit pixel"), ("that of the shot before", "")
STUCK = "dmd: dark shot {} is lit as the shot before: the mirrors stand still, or light passes them by; restart the DMD"
NO_LIGHT = "bench: records with light differ from dark ones by noise alone: check laser, fibres and DMD"
WENT_OUT = "bench: reference shot {} and the one before it are dark, earlier ones were not: check laser, fibres and DMD"

Records = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Two of them, shape (channels, samples)."""


class Finding(NamedTuple):
    """What is wrong, and from which shot on it may have been.

    shots: those that are meant, where single ones are: they may be so by chance, and then they are so again. told_by:
    the shot whose record tells that all since may be wrong, where chance may have made it look so.
    """

    first: int
    text: str
    shots: tuple[int, ...] = ()
    told_by: int | None = None


class Likeness:
    """Holds the records of a pass, as they come, against one another."""

    def __init__(self, shots: Sequence[Shot], alike: Alike) -> None:
        """Of a pass that measures `shots`."""
        self._shots = shots
        self._alike = alike
        self._confirmed: set[int] = set()  # shots that were measured again, and are as they are
        self._dark = np.array([shot.kind is ShotKind.DARK for shot in shots], np.bool_)
        self._lit = np.array([shot.kind in LIT for shot in shots], np.bool_)
        self._picture = np.array([shot.dataset_index for shot in shots], np.int64)
        references = [shot.dataset_index for shot in shots if shot.kind is ShotKind.REFERENCE]
        self._repeated = self._lit & np.isin(self._picture, references[:1])
        self._repetition = Repetition()
        self._last: Known | None = None
        self._darkness = Darkness()
        self._reference: Known | None = None
        self._followed: tuple[Known, Known] | None = None  # the references that came last, if unusual
        self._pending: Finding | None = None  # not said before it is known how much references differ
        # Of each channel, shape (channels,):
        self._noise_of_light = np.zeros(1)  # variance that the reference's light adds to that of a difference
        self._light = np.ones(1)  # of the reference, codes
        self._lit_level = np.zeros(1)  # mean code of the records with light that came last
        self._usual: NDArray[np.float64] | None = None  # mean squares of what different pictures differ by
        self._differ_usually = (np.empty(0), np.empty(0), (math.nan, math.nan))  # of usual and noise
        self._lit_once = False  # a record was further from darkness than chance takes it
        self._agreed = 0  # the last shot whose record showed again what one before had shown
        self._repeats: list[float] = []  # by how much records of the reference differed
        self._repeats_of_light: list[float] = []  # the same, of the root of the light of both
        self._of_doubted: list[tuple[float, float]] = []  # of both, those of pairs that are doubted
        self._from_darkness: list[float] = []  # times the noise that records of the reference differed from dark ones
        self._lit_until = 0  # the last reference that was lit
        self._unlit: list[float] = []  # as `_from_darkness`, of those since
        self._pairs: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []  # of references: what differs, levels
        self._from_before = Unlike(shots, alike, lambda shot: shots[shot - 1])
        self._from_dark = Unlike(shots, alike, lambda shot: replace(shots[shot], kind=ShotKind.DARK))
        self._unjudged: list[tuple[NDArray[Any], ...]] = []  # shots, what they differ by from those before, mean codes

    def examine(self, first: int, codes: Codes) -> Finding | None:
        """Take the records of the shots from `first` on, shape (shots, channels, samples); what is wrong with them."""
        part = codes[:, :, :: max(1, codes.shape[2] // MOST_VALUES)]
        follows = self._last is not None and self._last.shot == first - 1
        if self._last is not None and follows:
            part = np.concatenate([self._last.values[np.newaxis], part])
        begin = first - int(follows)
        self._last = Known(begin + len(part) - 1, part[-1])
        if (repeated := self._repetition.examine(begin, part)) is not None:
            return Finding(*repeated)
        return self._pictures(begin, part.astype(np.float32), new=first - begin)

    def measured_again(self, finding: Finding) -> None:
        """What was measured since a finding is measured again, and single shots that it meant are as they then are."""
        self._confirmed.update(finding.shots)
        self._repetition = Repetition()
        self._last = self._followed = self._pending = None
        for part, of_light in self._of_doubted:
            self._repeats.remove(part)
            self._repeats_of_light.remove(of_light)
        self._of_doubted = []
        self._unlit = []
        self._unjudged = []
        self._agreed = min(self._agreed, finding.first)
        self._darkness.forget(finding.first)
        if self._reference is not None and self._reference.shot >= finding.first:
            self._reference = None

    def _pictures(self, begin: int, values: NDArray[np.float32], *, new: int) -> Finding | None:
        """Records that come late, or whose picture was not shown; the first `new` of them was taken before."""
        if values[0].size < FEWEST_VALUES:
            return None
        end = begin + len(values)
        lit, dark = self._lit[begin:end], self._dark[begin:end]
        differences = mean_squares(np.diff(values, axis=0))
        pictures = np.where(dark, -1, self._picture[begin:end])
        levels = values.mean(axis=2)
        if lit.any():
            self._lit_level = levels[lit].mean(axis=0)
        other = (lit | dark)[1:] & (lit | dark)[:-1] & (pictures[1:] != pictures[:-1])
        usual = differences[other & lit[1:] & lit[:-1]]
        self._usual = usual if self._usual is None else np.append(self._usual, usual, axis=0)[-REMEMBERED:]
        judge = begin + 1 + np.flatnonzero(other), differences[other], ((levels[1:] + levels[:-1]) / 2)[other]
        if self._dark.any():  # without a dark shot nothing ever is judged
            self._unjudged.append(judge)
        if (finding := self._sure_of(self._lit_in_the_dark(begin, values), ends=False)) is not None:
            return finding
        repeated = self._repeated[begin:end]
        for place in new + np.flatnonzero((dark | repeated | np.append(False, repeated[:-1]))[new:]):
            record = Known(begin + int(place), values[place])
            finding = self._after_reference(record)
            if finding is None and dark[place]:
                finding = self._of_dark(record)
            if finding is None and repeated[place]:
                finding = self._of_reference(record, values[place - 1] if place else None)
            if (finding := self._sure_of(finding, ends=record.shot == len(self._shots) - 1)) is not None:
                return finding
        return self._not_shown(begin, values)

    def _sure_of(self, finding: Finding | None, *, ends: bool) -> Finding | None:
        """What is found, as soon as it is known that light of few photons does not make it look so.

        That is when references have told how much they differ, or a second thing is found before; at the latest when
        the pass `ends`. What chance never does is said at once.
        """
        if finding is not None and finding.told_by is None:
            return finding
        pending, self._pending = self._pending, None
        if (finding is None and pending is None) or self._hidden:
            return None
        if ends or len(self._repeats) >= ENOUGH:
            return pending or finding
        if pending is not None and finding is not None:
            return pending
        self._pending = pending or finding
        return None

    def _lit_in_the_dark(self, begin: int, values: NDArray[np.float32]) -> Finding | None:
        """A dark record that holds the shot before it; or one with light, where the next has none that should."""
        lit, dark = self._lit[begin : begin + len(values)], self._dark[begin : begin + len(values)]
        late = np.flatnonzero(dark[:-1] & lit[1:])
        flat, following = variation(values[late]), variation(values[late + 1])
        swapped = flat > FLAT * following
        others = lit & ~np.append(False, dark[:-1])  # what follows a dark shot is dark where all come late
        usually = float(np.quantile(variation(values[others]), NOT_A_FEW)) if swapped.any() and others.any() else 0.0
        for place in late[swapped & (FLAT * flat > usually) & (usually > FLAT * following)]:
            shot = begin + int(place)
            what = LATE.format(f"dark shot {shot} is lit and the next is not")
            return Finding(self._agreed, what, told_by=shot + 1)
        darkened = np.flatnonzero(lit[:-1] & dark[1:])
        darkened = darkened[variation(values[darkened]) > FLAT * LEAST_NOISE]
        for place in darkened[part_of(values[darkened], values[darkened + 1]) > LIT_ALIKE]:
            return Finding(self._agreed, STUCK.format(begin + place + 1))
        return None

    def _of_dark(self, record: Known) -> Finding | None:
        """Learns what is noise: two dark records differ by it, and each varies by it from sample to sample.

        A dark record that differs from the one before as different pictures do is lit, or the other one was.
        """
        pair = self._darkness.take(record)
        if pair is not None and self._tells_apart(self._darkness.noise) and self._part_of_usual(pair) > OTHER:
            codes = f"{rms(pair):.1f} codes"
            what = f"dark shot {record.shot} differs from the one before by {codes}, as different pictures do"
            return Finding(self._agreed, LATE.format(what), told_by=record.shot)
        self._darkness.learn(record, pair)
        return None

    def _of_reference(self, record: Known, before: NDArray[np.float32] | None) -> Finding | None:
        """A record of the reference picture that is rather one of the shot before, or of any other picture."""
        shot, values = record
        times = self._darkness.times_from(values)
        if within_noise(times, values.size):
            self._unlit.append(times)
            return self._of_unlit_reference(shot, before)
        known, self._reference = self._reference, record
        if self._darkness.record is not None:
            self._from_darkness = [*self._from_darkness, *self._unlit, times][-REMEMBERED:]
            self._unlit = []
            self._lit_until = shot
        if known is None:
            return None
        own = mean_squares(values - known.values)
        self._pairs = [*self._pairs, (own, mean(values))][-REMEMBERED:]
        if self._darkness.record is None or not self._tells_apart(self._darkness.noise):
            return None
        part = float(self._part_of_usual(own))
        learned = len(self._repeats) >= ENOUGH
        of_light = part / math.sqrt(self._differ((values, known.values))[1])
        usual = (
            part <= _still_usual(self._repeats, values.size)
            or of_light <= _still_usual(self._repeats_of_light, values.size)
            or self._hidden
        )
        beside = () if before is None or self._repeated[shot - 1] else ((before, values), (before, known.values))
        wrong = not usual and (
            (learned and part > OTHER) or any(self._is_rather(pair, (values, known.values)) for pair in beside)
        )
        if wrong and learned:
            return self._not_of_reference(known, record)
        self._repeats = [*self._repeats, part][-REMEMBERED:]
        self._repeats_of_light = [*self._repeats_of_light, of_light][-REMEMBERED:]
        if wrong:
            self._of_doubted.append((part, of_light))
            return self._not_of_reference(known, record)
        if part <= OTHER:
            self._agreed = shot
        self._followed = None if usual else (known, record)
        return None

    def _of_unlit_reference(self, shot: int, before: NDArray[np.float32] | None) -> Finding | None:
        """A dark record of the reference: light went out, if the lit picture before is dark too, as no reference was.

        Until a reference is lit again, it tells nothing of what light of few photons looks like.
        """
        usually = quantile(self._from_darkness, FEW) if self._from_darkness else 0.0
        both = before is not None and self._lit[shot - 1] and self._darkness.holds(before)
        if not both or usually < CONTRAST or self._hidden:
            return None
        return Finding(self._lit_until, WENT_OUT.format(shot), told_by=shot)

    def _after_reference(self, record: Known) -> Finding | None:
        """The record after one of the reference picture is rather the one that this should have been."""
        followed, self._followed = self._followed, None
        if followed is None or followed[1].shot != record.shot - 1 or self._repeated[record.shot]:
            return None
        known, reference = followed
        rather = self._is_rather((record.values, known.values), (reference.values, known.values))
        return self._not_of_reference(known, reference) if rather else None

    def _not_of_reference(self, known: Known, record: Known) -> Finding:
        codes = f"{rms(mean_squares(record.values - known.values)):.1f} codes"
        what = f"shots {known.shot} and {record.shot} have one picture and differ by {codes}, as others do"
        return Finding(min(self._agreed, known.shot), LATE.format(what), told_by=record.shot)

    def _is_rather(self, other: Records, own: Records) -> bool:
        """Whether two records differ by less than two of one picture, which share one record with them.

        The ratio of the likelihoods, where every other sample is independent and their noise unknown, is the ratio of
        the differences to the power of half the number of samples. Noise of few photons is more where light is more:
        so differences must be in that ratio by themselves, and of the root of their light.
        """
        times = max(RATHER, UNLIKELY ** (-2 / own[0].size))
        (near, its_light), (far, light) = self._differ(other), self._differ(own)
        return bool(far > times * near and far / math.sqrt(light) > times * near / math.sqrt(its_light))

    def _differ(self, pair: Records) -> tuple[float, float]:
        """By how many times the noise two records differ, and the light of both, at least one noise."""
        one, other = pair
        light = (mean(one + other) / 2 - self._darkness.level) / self._darkness.noise
        return float(times_noise(mean_squares(one - other), self._darkness.noise)), max(float(mean(light)), 1.0)

    def _learn_noise_of_light(self, dark: NDArray[np.float32]) -> None:
        """As most pairs of references have it: power, gain and the trigger's jitter are common to a record, and chance
        makes few of them much alike in two records.
        """
        if not self._pairs:
            return
        differences, levels = (np.array(parts) for parts in zip(*self._pairs, strict=True))
        self._light = np.maximum((levels - dark.mean(axis=1)).mean(axis=0), LEAST_NOISE)
        self._noise_of_light = np.quantile(
            np.maximum(differences - self._darkness.noise**2, 0), MOST_PAIRS, axis=0, method="higher"
        )

    def _not_shown(self, begin: int, values: NDArray[np.float32]) -> Finding | None:
        """A record that is of the picture before its own, or of none; or all are of one."""
        if self._darkness.record is None or self._usual is None or not len(self._usual):
            return None
        dark = self._darkness.record.values
        shots, differences, levels = (np.concatenate(parts) for parts in zip(*self._unjudged, strict=True))
        self._unjudged = []
        lit = np.flatnonzero(self._lit[begin : begin + len(values)])
        from_dark = times_noise(mean_squares(values[lit] - dark), self._darkness.most_noise)
        by_chance = math.exp(STRAYS * math.sqrt(2 / values[0].size))  # times one record's noise that another has
        from_quietest = times_noise(mean_squares(values[lit] - dark), self._darkness.least_noise)
        self._lit_once = self._lit_once or bool((from_quietest > by_chance).any())
        if not self._lit_once and self._agreed == 0 and lit.size > 2 and np.median(from_dark) <= HARDLY:
            return Finding(0, NO_LIGHT)
        if values[0].size < FEWEST_OF_ONE_SHOT or not self._tells_apart(self._darkness.most_noise) or self._hidden:
            return None
        self._learn_noise_of_light(dark)
        allowed = 1 + SURE / math.sqrt(values[0].size)
        faint = CONTRAST / self._differ_by(self._darkness.most_noise)[1]  # less light than this may be hidden by noise
        # A brighter picture's noise is not foretold from a faint reference.
        light = np.clip((levels - dark.mean(axis=1)) / self._light, 0, 1)
        noise = times_noise(self._darkness.most_noise**2 + self._noise_of_light * light, self._darkness.most_noise)
        from_before = times_noise(differences, self._darkness.most_noise) / (allowed * noise)
        dark_ones = self._from_dark.unlike(begin + lit, from_dark / allowed, faint)
        found = dict.fromkeys(dark_ones, DARK)
        found |= dict.fromkeys(self._from_before.unlike(shots, from_before, faint), BEFORE)
        for shot in self._confirmed:
            found.pop(shot, None)
        if not found:
            return None
        first = min(found)
        return Finding(first, NOT_SHOWN.format(first, *found[first]), tuple(sorted(found)))

    @property
    def _hidden(self) -> bool:
        """Whether light of few photons hides its pictures: then no record is `RATHER` times nearer to its own picture.

        Records of the reference differ by so much of what different pictures do, as a rule or not seldom; or not a few
        of them hold no photon.
        """
        if len(self._repeats) < ENOUGH:
            return False
        median, scatter = median_and_scatter(self._repeats)
        return bool(median + scatter > 1 / RATHER or quantile(self._from_darkness, NOT_A_FEW) < CONTRAST)

    def _differ_by(self, noise: NDArray[np.float64]) -> tuple[float, float]:
        """By how many times the noise records of different pictures differ, all but `FEW` of them and half of them, at
        least; nan as long as nobody knows.
        """
        if self._usual is None or len(self._usual) < ENOUGH:
            return math.nan, math.nan
        usual, against, differ = self._differ_usually
        if usual is not self._usual or against is not noise:
            times = times_noise(self._usual, noise)
            differ = quantile(times, FEW), quantile(times, 0.5)
            self._differ_usually = self._usual, noise, differ
        return differ

    def _part_of_usual(self, difference: NDArray[np.float64]) -> NDArray[np.float64]:
        """The difference of two records, or of pairs of them, of what those of different pictures differ by."""
        return times_noise(difference, self._darkness.noise) / self._differ_by(self._darkness.noise)[1]

    def _tells_apart(self, noise: NDArray[np.float64]) -> bool:
        """Whether records of different pictures differ by more than those of one; False as long as nobody knows."""
        least = max(CONTRAST, STEADY * float(times_noise((self._lit_level - self._darkness.level) ** 2, noise)))
        nearly_all, half = self._differ_by(noise)
        return half >= least and nearly_all >= CONTRAST / 2


def _still_usual(repeats: list[float], size: int) -> float:
    """What records of the reference, of `size` samples, may differ by, where others did by `repeats`."""
    median, scatter = median_and_scatter(repeats or [0.0])
    strays = max(STILL_USUAL_TIMES, 1 + STRAYS / math.sqrt(size))
    return max(strays * median, median + STRAYS * scatter)
