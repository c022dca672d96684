"""Test, then train: nothing is recognised because it was learnt, and what cannot be judged is said."""

import numpy as np
import pytest

from labctl.analysis.prequential import FOLLOWING, FROZEN, READOUTS, prequential
from labctl.errors import AnalysisError


def drifting(shots: int) -> tuple[np.ndarray, np.ndarray]:
    """Four classes about centres that turn by half a circle over all shots."""
    generator = np.random.default_rng(3)
    labels = generator.integers(0, 4, shots)
    angle = np.linspace(0, np.pi, shots) + labels * np.pi / 2
    centres = 3 * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    return centres + 0.7 * generator.normal(size=(shots, 2)), labels


def test_those_that_follow_keep_what_frozen_ones_lose() -> None:
    features, labels = drifting(3000)
    found = prequential(features, labels, np.arange(3000), first=300)
    assert found.places.tolist() == list(range(300, 3000))
    assert found.right.keys() == READOUTS.keys()
    for name in FOLLOWING:
        assert found.right[name][-500:].mean() > 0.95
    for name in FROZEN:
        assert found.right[name][-500:].mean() < 0.1


def test_an_image_counts_when_it_is_shown_for_the_first_time_only() -> None:
    features, labels = drifting(40)
    twice, groups = np.repeat(features, 2, axis=0), np.repeat(np.arange(40), 2)
    found = prequential(twice, np.repeat(labels, 2), groups, first=31)
    assert found.places.tolist() == list(range(32, 80, 2)), "the shot after the first 31 repeats their last"
    assert all(right.shape == (24,) for right in found.right.values())


@pytest.mark.parametrize(
    ("labels", "groups", "told"),
    [
        (np.arange(40) % 2, np.arange(40) % 20, "all images after the first 20 shots were shown before"),
        (np.arange(40) // 20, np.arange(40), "class 1 is missing among the 20 shots"),
        (
            np.zeros(40, int),
            np.arange(40),
            "of one class among the 20 shots to begin with: acquire images of other classes too",
        ),
    ],
)
def test_what_cannot_be_judged_is_said(labels: np.ndarray, groups: np.ndarray, told: str) -> None:
    with pytest.raises(AnalysisError, match=told):
        prequential(drifting(40)[0], labels, groups, first=20)
