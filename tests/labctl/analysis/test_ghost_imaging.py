import numpy as np
import pytest
from sklearn.base import clone

from labctl.analysis.ghost_imaging import GhostImaging
from labctl.errors import AnalysisError
from protocols.reference_picture import random_patterns

SHAPE = (10, 10)
SAMPLES = 200


def light(generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Fields of every pixel with a grain of some pixels (samples, pixels), and that of a reference (samples,)."""
    rough = generator.normal(size=(SAMPLES, *SHAPE)) + 1j * generator.normal(size=(SAMPLES, *SHAPE))
    kernel = np.exp(-((np.arange(10)[:, None] - np.arange(10)) ** 2) / 2)
    fields = np.einsum("sij,ik,jl->skl", rough, kernel, kernel).reshape(SAMPLES, -1)
    return fields, 300 * (generator.normal(size=SAMPLES) + 1j * generator.normal(size=SAMPLES))


def beat(pictures: np.ndarray, fields: np.ndarray, reference: np.ndarray) -> np.ndarray:
    field = pictures.reshape(len(pictures), -1) @ fields.T
    return np.asarray(np.abs(field + reference) ** 2 - np.abs(field) ** 2 - np.abs(reference) ** 2)


def blocks(generator: np.random.Generator, count: int) -> np.ndarray:
    images = np.zeros((count, *SHAPE), bool)
    for image in images:
        top, left = generator.integers(0, 5, 2)
        image[top : top + 5, left : left + 4] = True
    return images


def test_the_difference_of_intensities_is_linear_in_the_picture() -> None:
    generator = np.random.default_rng(1)
    fields, reference = light(generator)
    one, other = random_patterns(1, 2, SHAPE)
    both = beat(np.stack([one & ~other, other & ~one, one ^ other]), fields, reference)
    assert np.allclose(both[0] + both[1], both[2])
    # Without the reference it is not: intensities of two halves do not add up.
    halves = [np.abs((part.ravel()) @ fields.T) ** 2 for part in (one & ~other, other & ~one, one ^ other)]
    assert not np.allclose(halves[0] + halves[1], halves[2], rtol=0.1)


def test_images_come_back_that_nothing_was_trained_on() -> None:
    generator = np.random.default_rng(2)
    fields, reference = light(generator)
    patterns, images = random_patterns(2, 150, SHAPE), blocks(generator, 10)
    seen, unseen = beat(patterns, fields, reference), beat(images, fields, reference)
    noise = 0.05 * seen.std()
    imaging = GhostImaging().fit(seen + generator.normal(0, noise, seen.shape), patterns)
    found = imaging.predict(unseen + generator.normal(0, noise, unseen.shape))
    assert found.shape == images.shape
    assert np.sqrt(np.mean((found - images) ** 2)) < 0.6 * images.std()
    assert imaging.pattern_rmse_ < 0.5


def test_units_of_what_is_seen_do_not_matter() -> None:
    generator = np.random.default_rng(3)
    patterns, fields = random_patterns(3, 60, SHAPE), light(generator)
    seen = beat(patterns, *fields) + generator.normal(0, 100, (60, SAMPLES))
    volts, millivolts = GhostImaging().fit(seen, patterns), GhostImaging().fit(1000 * seen, patterns)
    assert (volts.penalty_, volts.strength_) == (millivolts.penalty_, millivolts.strength_)
    assert np.allclose(volts.predict(seen[:2]), millivolts.predict(1000 * seen[:2]), atol=1e-6)


def test_a_dead_sample_does_no_harm() -> None:
    generator = np.random.default_rng(4)
    patterns = random_patterns(4, 60, SHAPE)
    seen = beat(patterns, *light(generator)) + generator.normal(0, 100, (60, SAMPLES))
    seen[:, 7] = 0
    assert np.isfinite(clone(GhostImaging()).fit(seen, patterns).predict(seen[:2])).all()


def test_what_does_not_fit_is_refused() -> None:
    patterns = random_patterns(1, 20, SHAPE)
    with pytest.raises(AnalysisError, match="hold out a part"):
        GhostImaging(held_out=0).fit(np.ones((20, 5)), patterns)
    with pytest.raises(AnalysisError, match="hold out a part"):
        GhostImaging().fit(np.ones((19, 5)), patterns)
    fitted = GhostImaging().fit(np.random.default_rng(1).normal(size=(20, 5)), patterns)
    with pytest.raises(AnalysisError, match="measure both alike"):
        fitted.predict(np.ones((1, 4)))
