"""What records say of themselves: late, frozen, not shown, without light; and what is noise alone."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.engine.alike import alike_by
from labctl.engine.likeness import Finding, Likeness
from protocols.base import Images, Shot, ShotKind

PORTS, SAMPLES, EVERY = 4, 50, 10
NOISE, LIGHT = 2.0, 25.0
DIGITISER = 1.63
"""Noise in codes of a channel that has no other, before rounding: 5.5 effective bits."""


def plan(images: int) -> list[Shot]:
    """A reference and a dark shot after every few images; the first image is the reference."""
    shots: list[Shot] = []
    for image in range(images):
        shots.append(Shot(len(shots), ShotKind.IMAGE, image, image % 2, image))
        if image % EVERY == EVERY - 1:
            shots.append(Shot(len(shots), ShotKind.REFERENCE, 0, 0, 0))
            shots.append(Shot(len(shots), ShotKind.DARK, -1, -1, -1))
    return shots


def pictures(count: int) -> Images:
    images = np.random.default_rng(1).random((count, 12, 12)) < 0.3
    return Images(images, np.arange(count) % 2, np.arange(count))


def records(shots: Sequence[Shot], *, samples: int = SAMPLES, light: float = LIGHT) -> NDArray[np.int8]:
    """Each picture has a trace of its own, a dark shot none; all have noise."""
    generator = np.random.default_rng(2)
    traces = generator.normal(0, light, (len(shots), PORTS, samples))
    shown = [np.zeros((PORTS, samples)) if shot.kind is ShotKind.DARK else traces[shot.dataset_index] for shot in shots]
    noisy = np.array(shown) + generator.normal(0, NOISE, (len(shots), PORTS, samples))
    return np.clip(np.rint(noisy), -128, 127).astype(np.int8)


def examined(shots: Sequence[Shot], codes: NDArray[np.int8], at_once: int = 20) -> Finding | None:
    found = Likeness(shots, alike_by(pictures(len(shots))))
    for first in range(0, len(codes), at_once):
        if (finding := found.examine(first, codes[first : first + at_once])) is not None:
            return finding
    return None


SHOTS = plan(100)
RIGHT = records(SHOTS)


def again(codes: NDArray[np.int8]) -> NDArray[np.int8]:
    """The same traces with other noise."""
    return np.clip(codes + np.rint(np.random.default_rng(3).normal(0, NOISE, codes.shape)), -128, 127).astype(np.int8)


@pytest.mark.parametrize("at_once", [1, 20, 1000])
@pytest.mark.parametrize(("samples", "light"), [(50, LIGHT), (2, LIGHT), (50, 4 * NOISE), (1, 4 * NOISE)])
def test_noise_is_not_taken_for_anything_else(samples: int, light: float, at_once: int) -> None:
    assert examined(SHOTS, records(SHOTS, samples=samples, light=light), at_once) is None


@pytest.mark.parametrize("photons", [0.3, 1.0, 3.0, 5.0, 10.0, 30.0])
@pytest.mark.parametrize("at_once", [1, 1000])
def test_noise_of_few_photons_is_not_taken_for_other_pictures(photons: float, at_once: int) -> None:
    """Darkness is without noise, and records of one picture differ nearly as much as those of others."""
    generator = np.random.default_rng(9)
    light = photons * generator.exponential(size=(len(SHOTS), PORTS, SAMPLES))
    shown = [np.zeros_like(light[0]) if shot.kind is ShotKind.DARK else light[shot.dataset_index] for shot in SHOTS]
    codes = generator.poisson(np.array(shown)) * (10 / photons)
    assert examined(SHOTS, np.clip(np.rint(codes), -128, 127).astype(np.int8), at_once) is None


def test_bright_pictures_that_are_nearly_the_same_are_not_told_apart_where_the_light_varies() -> None:
    """As of cracks in a wall: nearly all of the light is in every picture, and its power varies from shot to shot."""
    generator = np.random.default_rng(7)
    wall = generator.uniform(60, 100, (1, PORTS, SAMPLES))
    power = generator.normal(1, 0.02, (len(SHOTS), 1, 1))
    lit = np.array([shot.kind is not ShotKind.DARK for shot in SHOTS])[:, np.newaxis, np.newaxis]
    own = records(SHOTS, light=6 * NOISE)
    assert examined(SHOTS, np.clip(np.rint(own / 4 + lit * power * wall), -128, 127).astype(np.int8)) is None


def test_a_picture_with_hardly_a_pixel_is_not_taken_for_a_dark_one() -> None:
    images = pictures(len(SHOTS))
    images.images[31] = False
    images.images[31, 4, 4:7] = True
    shot = next(shot for shot in SHOTS if shot.kind is ShotKind.IMAGE and shot.dataset_index == 31)
    codes = RIGHT.copy()
    codes[shot.index] = np.rint(np.random.default_rng(8).normal(0, NOISE, codes[0].shape))
    assert Likeness(SHOTS, alike_by(images)).examine(0, codes) is None
    assert examined(SHOTS, codes) is not None, "a picture with many pixels is not dark"


def test_a_channel_that_freezes() -> None:
    codes = RIGHT.copy()
    codes[50:, 2] = codes[50, 2]
    finding = examined(SHOTS, codes)
    assert finding is not None
    assert finding.first <= 51
    assert "channel 3 of the pass gave byte-identical traces at shots 50 to 51" in finding.text


def test_few_samples_may_repeat_themselves_by_chance() -> None:
    codes = records(SHOTS, samples=1)
    codes[50, 1] = codes[49, 1]
    assert examined(SHOTS, codes) is None
    codes[50:, 1] = codes[50, 1]
    assert examined(SHOTS, codes) is not None


def test_all_channels_together_are_told_at_once() -> None:
    codes = records(SHOTS, samples=3)
    codes[50] = codes[49]
    finding = examined(SHOTS, codes)
    assert finding is not None
    assert "all channels gave byte-identical traces at shots 49 to 50" in finding.text
    codes[50, 1] += 1
    assert examined(SHOTS, codes) is None, "three channels of three samples are so by chance, once in a while"


def test_repetitions_that_are_not_in_a_row_do_not_add_up() -> None:
    codes = records(SHOTS, samples=8)
    codes[52, 1], codes[55, 1] = codes[51, 1], codes[54, 1]
    assert examined(SHOTS, codes) is None
    codes[53, 1] = codes[52, 1]
    assert examined(SHOTS, codes) is not None


def test_a_channel_without_light_repeats_itself_more_often_than_the_others() -> None:
    codes = records(SHOTS, samples=8)
    codes[:, 2] = np.rint(np.random.default_rng(5).normal(0, DIGITISER, codes[:, 2].shape))
    codes[71, 2] = codes[70, 2]
    assert examined(SHOTS, codes) is None, f"{0.17**8:.1g} a record, and a run has many"


@pytest.mark.parametrize("since", [1, 47])
def test_records_that_come_one_shot_late(since: int) -> None:
    codes = RIGHT.copy()
    codes[since:] = RIGHT[since - 1 : -1]
    codes[since] = again(codes[since])
    finding = examined(SHOTS, codes)
    assert finding is not None
    assert finding.first <= since
    assert not finding.shots


@pytest.mark.parametrize("shot", [15, 40, 71, 95])
def test_a_picture_that_was_not_shown(shot: int) -> None:
    codes = RIGHT.copy()
    codes[shot] = again(codes[shot - 1])
    finding = examined(SHOTS, codes)
    assert finding is not None
    assert shot in finding.shots or (SHOTS[shot].kind is not ShotKind.IMAGE and finding.first <= shot)
    confirmed = Likeness(SHOTS, alike_by(pictures(len(SHOTS))))
    confirmed.measured_again(finding)
    assert not finding.shots or confirmed.examine(0, codes) is None, "measured again, it is as it is"


def test_a_shot_that_is_dark() -> None:
    codes = RIGHT.copy()
    codes[50] = noise()[50]
    finding = examined(SHOTS, codes)
    assert finding is not None
    assert finding.shots == (50,)


def test_equal_pictures_may_have_equal_records() -> None:
    codes = RIGHT.copy()
    codes[50] = again(codes[49])
    images = pictures(len(SHOTS))
    images.images[SHOTS[50].dataset_index] = images.images[SHOTS[49].dataset_index]
    assert Likeness(SHOTS, alike_by(images)).examine(0, codes) is None


def test_mirrors_that_stand_still() -> None:
    finding = examined(SHOTS, np.array([again(RIGHT[0])] * len(SHOTS)) + noise())
    assert finding is not None
    assert "the mirrors stand still" in finding.text


def test_no_light() -> None:
    finding = examined(SHOTS, noise())
    assert finding is not None
    assert "by noise alone" in finding.text


@pytest.mark.parametrize("at_once", [1, 20, 1000])
@pytest.mark.parametrize("since", range(36, 96))
def test_light_that_goes_out(since: int, at_once: int) -> None:
    """At the latest from the first shot that should have had light."""
    unlit = next(shot.index for shot in SHOTS[since:] if shot.kind is not ShotKind.DARK)
    codes = RIGHT.copy()
    codes[since:] = noise()[since:]
    finding = examined(SHOTS, codes, at_once)
    assert finding is not None
    assert since - 2 * (EVERY + 2) < finding.first <= unlit


@pytest.mark.parametrize("times_noise", [2.5, 4.0])
def test_one_bright_picture_among_faint_ones_is_light(times_noise: float) -> None:
    codes = noise()
    codes[7] += np.int8(times_noise * np.sqrt(2) * NOISE)
    assert examined(SHOTS, codes) is None


def noise() -> NDArray[np.int8]:
    drawn = np.random.default_rng(4).normal(0, NOISE, RIGHT.shape)
    return np.rint(drawn).astype(np.int8)


def test_a_reference_that_strays_is_still_its_own() -> None:
    """Jitter and gain are common to a record: it is nearer to no other picture, and not as far as others are."""
    shot = next(shot.index for shot in SHOTS[50:] if shot.kind is ShotKind.REFERENCE)
    codes = RIGHT.copy()
    strays = np.random.default_rng(6).normal(0, 0.68 * LIGHT, codes[shot].shape)
    codes[shot] = np.clip(codes[shot] + np.rint(strays), -128, 127)
    assert examined(SHOTS, codes) is None


@pytest.mark.parametrize("off", [-1, 1])
def test_a_reference_among_pictures_nearly_like_it_is_told_from_those_beside_it(off: int) -> None:
    """Records that come late or early differ from the reference by less than pictures do as a rule."""
    alike = [shot.index - 1 for shot in SHOTS if shot.kind is ShotKind.REFERENCE and shot.index > 30]
    codes = RIGHT.copy().astype(np.float64)
    generator = np.random.default_rng(10)
    for shot in alike:
        codes[shot] = RIGHT[0] + generator.normal(0, 0.4 * LIGHT, codes[shot].shape)
    right = np.clip(np.rint(codes), -128, 127).astype(np.int8)
    assert examined(SHOTS, right) is None
    late = np.roll(right, -off, axis=0)
    late[:40] = right[:40]
    finding = examined(SHOTS, late)
    assert finding is not None
    assert finding.first <= 40


def test_where_records_come_near_one_another_by_chance_none_is_held_against_the_one_before() -> None:
    codes = RIGHT.copy()
    near, later = (
        next(shot.index for shot in SHOTS[first:] if {shot.kind, SHOTS[shot.index - 1].kind} == {ShotKind.IMAGE})
        for first in (20, 30)
    )
    codes[near] = np.rint(again(codes[near - 1]) + np.random.default_rng(12).normal(0, 1.75 * NOISE, codes[near].shape))
    assert examined(SHOTS, codes, 1000) is None
    codes[later] = again(codes[later - 1])
    assert examined(SHOTS, codes, 1000) is None


def test_what_was_doubted_is_measured_again_and_held_against_what_was_before() -> None:
    late = RIGHT.copy()
    late[47:] = RIGHT[46:-1]
    late[47] = again(late[47])
    likeness = Likeness(SHOTS, alike_by(pictures(len(SHOTS))))
    finding = likeness.examine(0, late)
    assert finding is not None
    assert finding.told_by is not None
    likeness.measured_again(finding)
    assert likeness.examine(finding.first, RIGHT[finding.first :]) is None
    likeness.measured_again(finding)
    same = likeness.examine(finding.first, late[finding.first :])
    assert same is not None
    assert same.told_by == finding.told_by
