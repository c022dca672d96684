import math

import numpy as np
import pytest

from sim_backends.optics.drift import OrnsteinUhlenbeck


def test_what_does_not_drift_stays() -> None:
    drawn = OrnsteinUhlenbeck.draw(np.random.default_rng(1), np.array([1.0, 3.0]), math.inf)
    np.testing.assert_array_equal(drawn.at(0.0), drawn.at(1e6))
    np.testing.assert_array_equal(OrnsteinUhlenbeck.constant(np.ones(2)).at(5.0), [1, 1])


@pytest.mark.parametrize("later", [0.1, 0.5, 1.0, 2.0])
def test_the_correlation_falls_exponentially(later: float) -> None:
    drawn = OrnsteinUhlenbeck.draw(np.random.default_rng(2), np.ones(4000), 1.0)
    begin, end = drawn.at(10.0), drawn.at(10.0 + later)
    correlation = np.vdot(begin, end) / np.linalg.norm(begin) / np.linalg.norm(end)
    assert correlation == pytest.approx(math.exp(-later), abs=0.04)


def test_the_rms_is_what_was_asked_for_at_any_time() -> None:
    drawn = OrnsteinUhlenbeck.draw(np.random.default_rng(3), np.full(4000, 0.5), 1.0)
    for time_s in (0.0, 3.0, 1000.0):
        assert np.sqrt(np.mean(np.abs(drawn.at(time_s)) ** 2)) == pytest.approx(0.5, rel=0.05)
