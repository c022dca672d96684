"""Whether a picture that is measured again may be what it was."""

from dataclasses import replace

import numpy as np
import pytest

from instruments.errors import InstrumentError
from labctl.engine.light_check import REPEATS, first_of, refuse_changed_light, to_repeat
from protocols.base import Shot, ShotKind

IMAGE = Shot(0, ShotKind.IMAGE, 7, 0, 7)
REFERENCE = Shot(20, ShotKind.REFERENCE, 7, 0, 7)
DARK = Shot(21, ShotKind.DARK, -1, -1, -1)


def records(
    generator: np.random.Generator, light: np.ndarray[tuple[int, ...], np.dtype[np.float64]], noise: float, count: int
) -> np.ndarray[tuple[int, ...], np.dtype[np.int8]]:
    noisy = light + noise * generator.standard_normal((count, *light.shape))
    return np.clip(np.rint(noisy), -128, 127).astype(np.int8)


def test_the_last_reference_is_repeated_or_else_the_last_image() -> None:
    assert to_repeat([IMAGE, REFERENCE, DARK, Shot(22, ShotKind.IMAGE, 3, 1, 3)]) == REFERENCE
    assert to_repeat([IMAGE, DARK]) == IMAGE
    assert to_repeat([DARK]) is None
    assert to_repeat([Shot(0, ShotKind.SCENE, 1, 1, 1), Shot(1, ShotKind.SEQUENCE, 1, 1, 1)]) is None


def test_the_first_record_of_a_picture_is_of_that_picture() -> None:
    """In ghost imaging the number of a pattern may be the index of an image, and what is dark has that of a reference.

    Elsewhere a reference is an image that was shown before.
    """
    alone, pattern = Shot(2, ShotKind.IMAGE_ALONE, 7, 0, 7), Shot(0, ShotKind.PATTERN, -1, -1, 7)
    image = replace(IMAGE, index=3)
    assert first_of(image, [pattern, alone, image]) == image
    border = Shot(20, ShotKind.REFERENCE, -1, -1, -1)
    assert first_of(border, [replace(DARK, index=4), border]) == border
    assert first_of(REFERENCE, [Shot(0, ShotKind.IMAGE, 3, 1, 3), image, REFERENCE]) == image


@pytest.mark.parametrize("shape", [(4, 20), (1, 20), (4, 500)])
@pytest.mark.parametrize("noise", [0.1, 3.0])
def test_noise_is_accepted_whatever_it_draws_and_another_light_refused(shape: tuple[int, int], noise: float) -> None:
    generator = np.random.default_rng(1)
    refused = 0
    for _ in range(500):
        light, other = generator.uniform(-60, 60, (2, *shape))
        first, stored, *again = records(generator, light, noise, 2 + REPEATS)
        refuse_changed_light(REFERENCE, first, stored, np.stack(again))
        try:
            refuse_changed_light(REFERENCE, first, stored, records(generator, other, noise, REPEATS))
        except InstrumentError:
            refused += 1
    assert refused == 500


def test_a_bench_that_drifted_while_it_ran_may_have_drifted_on() -> None:
    generator = np.random.default_rng(2)
    light = generator.uniform(-60, 60, (4, 100))
    drifted = generator.uniform(-60, 60, (4, 100)) - light
    first = records(generator, light, 1.0, 1)[0]
    stored = records(generator, light + 0.1 * drifted, 1.0, 1)[0]
    again = records(generator, light + 0.25 * drifted, 1.0, REPEATS)
    refuse_changed_light(REFERENCE, first, stored, again)
    with pytest.raises(InstrumentError, match=r"bench: reference shot 20 is not what it was: .* begin a new run"):
        refuse_changed_light(REFERENCE, stored, stored, again)
