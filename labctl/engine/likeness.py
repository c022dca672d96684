"""Are records those of their shots? Told from the records of a pass alone, where no setting of an instrument shows it.

A channel of noisy codes never repeats itself; two records of one picture differ by noise, two of different pictures by
much more, and a dark record is flat. How much is noise, two dark records tell: whatever was shown, it was the same both
times. Each channel is measured by its own noise, so that one without light does not hide what another one shows. Where
noise hides the pictures in all of them nothing is said.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from instruments.values import Codes
from protocols.base import Images, Inputs, Shot, ShotKind

UNLIKELY = 1e-7
"""How improbable it must be that channels repeat themselves by chance."""
REPEATED = 0.17
"""Part of the samples that repeat themselves at least: 1 / (2 s sqrt pi), where noise is the digitiser's alone.

Of 5.5 effective bits it has s = 1.65 codes, rounding included (IEEE 1241); light and more noise only make it less.
"""
CONTRAST = 6.0
"""Times the noise that different pictures must differ by, as a rule: below, records do not tell pictures apart."""
CONTRAST_LIT = 3.0
"""Times the noise of their own light that they must differ by, for a shot to be held against the one before."""
STEADY = 0.1
"""Part of the light that different pictures must differ by as well: power, gain and the trigger's jitter are common to
a record and vary by hundredths of the light, which no dark record shows."""
SURE = 2.5
"""Standard deviations by which two records of one picture may differ more than noise has it."""
FEWEST_VALUES, FEWEST_OF_ONE_SHOT = 40, 80
"""Of a record, below which chance decides whether it looks like another one; and where one shot alone is judged."""
OTHER = 0.6
"""Part of what different pictures differ by, beyond which two records are not of one picture."""
UNUSUAL, UNUSUAL_TIMES, STILL_USUAL_TIMES = 0.35, 3.0, 1.4
"""So is one beyond a smaller part that also differs by so many times what the records of one picture did before; where
light of few photons makes those differ nearly as much, so many times that are still usual."""
STRAYS = 5.0
"""Standard deviations by which the rms of a record's noise may stray: of n samples, every other one independent, by
1 / sqrt(n) of itself."""
LIT_ALIKE = 0.7
"""Part of a record with light that a dark one holds where it is not dark."""
FLAT = 3.0
"""Times that a record with light varies more from sample to sample than a dark one."""
NEARLY = 0.25
"""Part of the lit pixels by which two images must differ for their records to be told apart for sure."""
HARDLY = 1.1
"""Times the noise that records with light differ from dark ones at most where there is no light."""
LEAST_NOISE = 0.5
"""Codes that quantisation alone makes two records differ by."""
MOST_VALUES = 256
"""Of each channel and record, which are looked at: enough to tell pictures apart, however long the record."""
MOST_PAIRS = 0.9
"""Part of the pairs of references that differ by no more than what light is taken to add to noise."""
REMEMBERED = 256
"""Differences between pictures that what is usual is taken from."""
LIT = (ShotKind.IMAGE, ShotKind.REFERENCE)
LATE = "bench: {}: pictures or records come late; switch oscilloscope and DMD off and on"
NOT_SHOWN = "dmd: shot {}: its record {}, within noise: its picture was not shown; switch the DMD off and on"
STRAYED = (
    "dmd: shot {}: its record differs from those of its picture at shots {} and {}: its picture was not shown; switch "
    "the DMD off and on"
)
STUCK = "dmd: dark shot {} is lit as the shot before: the mirrors stand still, or light passes them by; restart the DMD"
NO_LIGHT = "bench: records with light differ from dark ones by noise alone: check laser, fibres and DMD"

Alike = Callable[[Shot, Shot, float], bool]
"""Whether two shots show nearly the same, or differ by less than a part of the pixels that images usually have lit."""


class Finding(NamedTuple):
    """What is wrong, and from which shot on it may have been.

    shots: those that are meant, where single ones are: they may be so by chance, and then they are so again. by_chance:
    so may be all that was measured since.
    """

    first: int
    text: str
    shots: tuple[int, ...] = ()
    by_chance: bool = False


class Likeness:
    """Holds the records of a pass, as they come, against one another."""

    def __init__(self, shots: Sequence[Shot], alike: Alike, confirmed: Collection[int] = ()) -> None:
        """Of a pass that measures `shots`; those `confirmed` were as they are when they were measured before."""
        self._shots = shots
        self._alike = alike
        self._confirmed = np.array(sorted(confirmed), np.int64)
        self._dark = np.array([shot.kind is ShotKind.DARK for shot in shots], np.bool_)
        self._lit = np.array([shot.kind in LIT for shot in shots], np.bool_)
        self._picture = np.array([shot.dataset_index for shot in shots], np.int64)
        references = [shot.dataset_index for shot in shots if shot.kind is ShotKind.REFERENCE]
        self._repeated = self._lit & np.isin(self._picture, references[:1])
        self._last: tuple[int, Codes] | None = None
        self._frozen = np.empty(0, np.int64)  # records in a row that each channel repeated itself
        self._equal, self._compared = 0.0, 1.0  # samples that repeated themselves, of how many
        self._reference_record: tuple[int, NDArray[np.float32]] | None = None
        self._dark_record: NDArray[np.float32] | None = None
        # Of each channel, shape (channels,):
        self._noise = self._most_noise = np.ones(1)  # of the difference of two dark records, as they say, and at most
        self._noise_of_light = np.zeros(1)  # variance that the reference's light adds to that of a difference
        self._light = np.ones(1)  # of the reference, codes
        self._lit_level = np.zeros(1)  # mean code of the records with light that came last
        self._usual: NDArray[np.float64] | None = None  # mean squares of what different pictures differ by
        self._agreed = 0  # the last shot whose record showed again what one before had shown
        self._repeats: list[float] = []  # by how much records of the reference differed
        self._pairs: list[
            tuple[NDArray[np.float64], NDArray[np.float64]]
        ] = []  # of references: differences, mean codes
        self._doubted: tuple[int, NDArray[np.float32]] | None = None  # the first record of the reference, and its shot
        self._strayed: tuple[int, NDArray[np.float32]] | None = (
            None  # the reference before one that differs, and its shot
        )
        self._unjudged: list[tuple[NDArray[Any], ...]] = []  # shots, what they differ by from those before, mean codes

    def examine(self, first: int, codes: Codes) -> Finding | None:
        """Take the records of the shots from `first` on, shape (shots, channels, samples); what is wrong with them."""
        follows = self._last is not None and self._last[0] == first - 1
        if self._last is not None and follows:
            codes = np.concatenate([self._last[1][np.newaxis], codes])
        begin = first - int(follows)
        self._last = begin + len(codes) - 1, codes[-1]
        part = codes[:, :, :: max(1, codes.shape[2] // MOST_VALUES)]
        return self._repetition(begin, part) or self._pictures(begin, part.astype(np.float32), new=first - begin)

    def _repetition(self, begin: int, codes: Codes) -> Finding | None:
        """A channel that gives the same codes again and again, more often than noise would; or all of them at once."""
        equal = codes[1:] == codes[:-1]
        whole = equal.all(axis=2)
        likely = codes.shape[2] * math.log(max(REPEATED, self._equal / self._compared))
        self._equal += float(np.count_nonzero(equal))
        self._compared += equal.size
        if self._frozen.size != codes.shape[1] or not whole.any():
            self._frozen = np.zeros(codes.shape[1], np.int64)
        for shot, again in enumerate(whole, begin + 1) if whole.any() else ():
            self._frozen = np.where(again, self._frozen + 1, 0)
            chance = self._frozen * likely
            if again.all():  # the noise of channels is independent
                chance = np.full_like(chance, chance.sum())
            stuck = np.flatnonzero(chance < math.log(UNLIKELY))
            if stuck.size:
                since = shot - int(self._frozen[stuck].max())
                which = "all channels" if stuck.size == codes.shape[1] else f"channel {stuck[0] + 1} of the pass"
                return Finding(
                    since + 1,
                    f"scope: {which} gave byte-identical traces at shots {since} to {shot}: it did not acquire anew; "
                    f"check its trigger",
                )
        return None

    def _pictures(self, begin: int, values: NDArray[np.float32], *, new: int) -> Finding | None:
        """Records that come late, or whose picture was not shown; the first `new` of them was taken before."""
        if values[0].size < FEWEST_VALUES:
            return None
        end = begin + len(values)
        lit, dark = self._lit[begin:end], self._dark[begin:end]
        late = np.flatnonzero(dark[:-1] & lit[1:])
        flat, following = _varies(values[late]), _varies(values[late + 1])
        for place in late[(flat > FLAT * following) & (following > 0)]:
            return Finding(
                self._agreed, LATE.format(f"dark shot {begin + place} is lit and the next is not"), by_chance=True
            )
        differences = _squares(np.diff(values, axis=0))
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
        darkened = np.flatnonzero(lit[:-1] & dark[1:])
        for place in darkened[_part_of(values[darkened], values[darkened + 1]) > LIT_ALIKE]:
            return Finding(self._agreed, STUCK.format(begin + place + 1))
        for place in new + np.flatnonzero((dark | self._repeated[begin:end])[new:]):
            shown_again = self._of_dark if dark[place] else self._of_reference
            if (finding := shown_again(begin + int(place), values[place])) is not None:
                return finding
        return self._not_shown(begin, values)

    def _of_dark(self, shot: int, values: NDArray[np.float32]) -> Finding | None:
        """Learns what is noise: two dark records differ by it, and each varies by it from sample to sample.

        A dark record that differs from the one before as different pictures do is lit, or the other one was.
        """
        varies = 2 * values.var(axis=1, dtype=np.float64)
        known, self._dark_record = self._dark_record, values
        pair = varies if known is None else _squares(values - known)
        if known is not None and self._tells_apart(self._noise) and self._part_of_usual(pair) > OTHER:
            what = f"dark shot {shot} differs from the one before by {_rms(pair):.1f} codes, as different pictures do"
            return Finding(self._agreed, LATE.format(what))
        least = LEAST_NOISE**2
        self._noise = np.sqrt(np.maximum(np.minimum(pair, varies), least))
        self._most_noise = np.sqrt(np.maximum(np.maximum(pair, varies), least))
        return None

    def _of_reference(self, shot: int, values: NDArray[np.float32]) -> Finding | None:
        """A record of the reference picture that is of another one.

        Where already the first two differ, the third says whether one of them is wrong, or none is: that noise of the
        light itself, which darkness does not show, makes all three differ nearly as pictures do. Where a later one
        differs, the next says whether that one alone does, which may be chance, or all that come.
        """
        known, self._reference_record = self._reference_record, (shot, values)
        if known is None:
            return None
        difference = _squares(values - known[1])
        self._pairs = [*self._pairs, (difference, values.mean(axis=1))][-REMEMBERED:]
        if self._dark_record is None or not self._tells_apart(self._noise):
            return None
        part = float(self._part_of_usual(difference))
        if self._hidden:
            self._repeats = [*self._repeats, part][-REMEMBERED:]
            return None
        if self._doubted is not None:
            (before, first), self._doubted = self._doubted, None
            parts = [float(self._part_of_usual(_squares(one - first))) for one in (known[1], values)]
            if max(*parts, part) <= STILL_USUAL_TIMES * min(*parts, part):
                self._repeats = [*parts, part]
                return None
            what = f"the reference at shots {before} to {shot} is of one picture and differs as others do"
            return Finding(self._agreed, LATE.format(what), by_chance=True)
        if part > OTHER and not self._repeats and bool(self._repeated[shot + 1 :].any()):
            self._doubted = known
            return None
        if self._strayed is not None:
            (before, earlier), self._strayed = self._strayed, None
            if self._is_another(float(self._part_of_usual(_squares(values - earlier))), values.size):
                what = f"shots {before}, {known[0]} and {shot} have one picture and differ as others do"
                return Finding(self._agreed, LATE.format(what), by_chance=True)
            self._agreed = shot
            if not (alone := self._unconfirmed(np.array([known[0]]))):
                return None
            return Finding(known[0], STRAYED.format(known[0], before, shot), tuple(alone))
        if self._is_another(part, values.size):
            if self._repeats and bool(self._repeated[shot + 1 :].any()):
                self._strayed = known
                return None
            codes = f"{_rms(difference):.1f} codes"
            what = f"shots {known[0]} and {shot} have one picture and differ by {codes}, as others do"
            return Finding(self._agreed, LATE.format(what), by_chance=True)
        self._agreed = shot
        self._repeats = [*self._repeats, part][-REMEMBERED:]
        return None

    def _is_another(self, part: float, size: int) -> bool:
        """Whether records of the reference, of so many samples, that differ by `part` are of two pictures."""
        usually = float(np.median(self._repeats)) if self._repeats else 0.0
        still = max(STILL_USUAL_TIMES, 1 + STRAYS / math.sqrt(size))
        unusual = len(self._repeats) > 2 and part > max(UNUSUAL, UNUSUAL_TIMES * usually)
        return part > max(OTHER, still * usually) or unusual

    def _learn_noise_of_light(self, dark: NDArray[np.float32]) -> None:
        """As most pairs of references have it: power, gain and the trigger's jitter are common to a record, and chance
        makes few of them much alike in two records.
        """
        if not self._pairs:
            return
        differences, levels = (np.array(parts) for parts in zip(*self._pairs, strict=True))
        alike = self._part_of_usual(differences) <= OTHER
        if alike.any():
            self._light = np.maximum((levels[alike] - dark.mean(axis=1)).mean(axis=0), LEAST_NOISE)
            added = np.maximum(differences[alike] - self._noise**2, 0)
            self._noise_of_light = np.quantile(added, MOST_PAIRS, axis=0, method="higher")

    def _not_shown(self, begin: int, values: NDArray[np.float32]) -> Finding | None:
        """A record that is of the picture before its own, or of none; or all are of one."""
        if self._dark_record is None or self._usual is None or not len(self._usual):
            return None
        shots, differences, levels = (np.concatenate(parts) for parts in zip(*self._unjudged, strict=True))
        self._unjudged = []
        lit = np.flatnonzero(self._lit[begin : begin + len(values)])
        from_dark = _times(_squares(values[lit] - self._dark_record), self._most_noise)
        if self._agreed == 0 and lit.size > 2 and float(np.median(from_dark)) <= HARDLY:
            return Finding(0, NO_LIGHT)
        if values[0].size < FEWEST_OF_ONE_SHOT or not self._tells_apart(self._most_noise) or self._hidden:
            return None
        self._learn_noise_of_light(self._dark_record)
        allowed = 1 + SURE / math.sqrt(values[0].size)
        usual = self._as_a_rule(self._most_noise)
        faint = CONTRAST / usual  # less light than this may be hidden by noise
        # A brighter picture's noise is not foretold from a faint reference.
        light = np.clip((levels - self._dark_record.mean(axis=1)) / self._light, 0, 1)
        noise = _times(self._most_noise**2 + self._noise_of_light * light, self._most_noise)
        differs = _times(differences, self._most_noise)
        found = {
            shot: "is that of the shot before"
            for shot in self._unconfirmed(shots[(differs <= allowed * noise) & (usual >= CONTRAST_LIT * noise)])
            if not self._alike(self._shots[shot - 1], self._shots[shot], faint)
        }
        found |= {
            shot: "is dark"
            for shot in self._unconfirmed(begin + lit[from_dark <= allowed])
            if not self._alike(replace(self._shots[shot], kind=ShotKind.DARK), self._shots[shot], faint)
        }
        if not found:
            return None
        first = min(found)
        return Finding(first, NOT_SHOWN.format(first, found[first]), tuple(sorted(found)))

    def _unconfirmed(self, shots: NDArray[Any]) -> list[int]:
        found: list[int] = np.setdiff1d(shots.astype(np.int64), self._confirmed).tolist()
        return found

    @property
    def _hidden(self) -> bool:
        """Whether light of few photons hides its pictures: each record of the reference differs as others' do."""
        return len(self._repeats) > 2 and float(np.median(self._repeats)) > OTHER

    def _as_a_rule(self, noise: NDArray[np.float64]) -> float:
        """By how many times the noise records of different pictures differ; nan as long as nobody knows."""
        return math.nan if self._usual is None or len(self._usual) < 3 else float(np.median(_times(self._usual, noise)))

    def _part_of_usual(self, difference: NDArray[np.float64]) -> NDArray[np.float64]:
        """The difference of two records, or of pairs of them, of what those of different pictures differ by."""
        return _times(difference, self._noise) / self._as_a_rule(self._noise)

    def _tells_apart(self, noise: NDArray[np.float64]) -> bool:
        """Whether records of different pictures differ by more than those of one; False as long as nobody knows."""
        dark = 0.0 if self._dark_record is None else self._dark_record.mean(axis=1)
        return self._as_a_rule(noise) >= max(CONTRAST, STEADY * float(_times((self._lit_level - dark) ** 2, noise)))


def alike_by(inputs: Inputs) -> Alike:
    """Whether two shots show nearly the same: by their images, where there are any; otherwise all may be alike."""
    if not isinstance(inputs, Images):
        return lambda _one, _other, _faint: True
    places = {int(index): place for place, index in enumerate(inputs.indices)}
    usual = float(np.median(np.count_nonzero(inputs.images, axis=(1, 2))))

    def pixels(shot: Shot) -> NDArray[np.bool_] | None:
        if shot.kind is ShotKind.DARK:
            return np.zeros(inputs.images.shape[1:], np.bool_)
        return inputs.images[places[shot.dataset_index]] if shot.kind in LIT and shot.dataset_index in places else None

    def alike(one: Shot, other: Shot, faint: float) -> bool:
        shown = pixels(one), pixels(other)
        if shown[0] is None or shown[1] is None:
            return True
        different, lit = np.count_nonzero(shown[0] ^ shown[1]), max(map(np.count_nonzero, (shown[0], shown[1])))
        return bool(different <= max(NEARLY * lit, faint * usual))

    return alike


def _part_of(lit: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.float64]:
    """How much of how records with light vary from sample to sample other ones hold: 1 if all, 0 if nothing."""
    lit, other = (values - values.mean(axis=2, keepdims=True) for values in (lit, other))
    varies = np.maximum(np.einsum("nij,nij->n", lit, lit), 1e-9)
    return np.asarray(np.einsum("nij,nij->n", lit, other) / varies, np.float64)


def _varies(values: NDArray[np.float32]) -> NDArray[np.float64]:
    """By how much records vary from sample to sample, in the mean of their channels."""
    return np.asarray(values.std(axis=-1).mean(axis=-1), np.float64)


def _squares(values: NDArray[np.float32]) -> NDArray[np.float64]:
    """Mean squares of the samples of each channel."""
    return np.asarray(np.einsum("...ij,...ij->...i", values, values) / values.shape[-1], np.float64)


def _times(squares: NDArray[np.float64], noise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rms over the channels of records, each by its own noise."""
    return np.asarray(np.sqrt((squares / noise**2).mean(axis=-1)), np.float64)


def _rms(squares: NDArray[np.float64]) -> float:
    """Over channels and samples of a record, in codes."""
    return math.sqrt(squares.mean())
