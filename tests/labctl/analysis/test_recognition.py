"""How well a run is recognised: the interval holds the truth as often as it says, whatever the splits repeat."""

import numpy as np
import pytest
from scipy.stats import norm

from labctl.analysis.intervals import interval
from labctl.analysis.recognition import Recognition, recognition
from labctl.errors import AnalysisError

DISTANCE = 0.9
TRUTH = float(norm.cdf(DISTANCE))
"""What the best readout of two classes reaches whose one sample is normal, at plus or minus the distance."""


def recognised(images: int, seed: int, *, shots: int = 1) -> Recognition:
    """Of shots of images that are one sample with something to say and one without; all of an image are alike."""
    generator = np.random.default_rng((images, seed))
    labels = generator.integers(0, 2, images)
    signal = DISTANCE * (2 * labels - 1) + generator.standard_normal(images)
    traces = np.stack([signal, generator.standard_normal(images)], axis=1)[:, np.newaxis, :]
    groups = np.repeat(np.arange(images), shots)
    return recognition(traces[groups], labels[groups], groups, sample_interval_s=40e-12)


def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    found = [recognised(20_000, seed) for seed in range(40)]
    held = np.mean([one.interval[0] <= TRUTH <= one.interval[1] for one in found])
    assert held > 0.95 - 3 * np.sqrt(0.95 * 0.05 / len(found)), "three standard errors"


def test_images_count_once_that_splits_test_again_or_a_run_shows_again() -> None:
    one, again = recognised(300, 1), recognised(300, 1, shots=3)
    assert one.images == again.images
    assert again.accuracy == pytest.approx(one.accuracy, abs=0.02)
    tested = round(300 * (1 - 0.9**10))
    assert again.images == pytest.approx(tested, abs=10)
    expected = interval(round(again.accuracy * again.images), again.images)
    assert np.diff(again.interval) == pytest.approx(np.diff(expected))


def test_a_window_of_nothing_is_refused() -> None:
    traces, labels = np.ones((40, 1, 2)), np.arange(40) % 2
    with pytest.raises(AnalysisError, match="window"):
        recognition(traces, labels, np.arange(40), sample_interval_s=40e-12, window_s=0.0)
