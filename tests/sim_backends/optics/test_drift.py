import math

import numpy as np
import pytest

from sim_backends.optics.drift import OrnsteinUhlenbeck


def test_what_does_not_drift_stays() -> None:
    drawn = OrnsteinUhlenbeck.draw(np.random.default_rng(1), np.array([1.0, 3.0]), math.inf)
    np.testing.assert_array_equal(drawn.at(0.0), drawn.at(1e6))
    np.testing.assert_array_equal(OrnsteinUhlenbeck.constant(np.ones(2)).at(5.0), [1, 1])


@pytest.mark.parametrize("begin", [0.0, 10.0, 1e5])
@pytest.mark.parametrize("later", [0.001, 0.01, 0.1, 0.5, 1.0, 2.0])
def test_the_correlation_falls_exponentially(begin: float, later: float) -> None:
    """What is lost of it over short times is most of what a drift does: 20 values of each of 2000 processes."""
    drawn = OrnsteinUhlenbeck.draw(np.random.default_rng(2), np.ones(2000), 1.0)
    times = begin + 7.3 * np.arange(20)
    lost = np.mean([np.abs(drawn.at(time + later) - drawn.at(time)) ** 2 for time in times]) / 2
    assert lost == pytest.approx(-math.expm1(-later), rel=0.03)


def test_its_values_do_not_depend_on_when_they_are_asked_for() -> None:
    times = np.random.default_rng(4).uniform(0, 100, 50)
    first, again = (OrnsteinUhlenbeck.draw(np.random.default_rng(5), np.ones(3), 1.0) for _ in range(2))
    forwards = [first.at(time) for time in np.sort(times)]
    backwards = [again.at(time) for time in np.sort(times)[::-1]]
    np.testing.assert_array_equal(forwards, backwards[::-1])


def test_the_next_value_depends_on_the_last_alone() -> None:
    """Markov's property: given the value at a time, earlier ones say nothing of later ones."""
    drawn = OrnsteinUhlenbeck.draw(np.random.default_rng(6), np.ones(40_000), 1.0)
    earlier, now, later = (drawn.at(time) for time in (31.6, 31.9, 32.4))
    kept = math.exp(-0.3), math.exp(-0.5)
    before, after = earlier - kept[0] * now, later - kept[1] * now
    norm = np.linalg.norm(before) * np.linalg.norm(after)
    assert abs(np.vdot(before, after)) / norm < 4 / math.sqrt(before.size)


def test_the_rms_is_what_was_asked_for_at_any_time() -> None:
    drawn = OrnsteinUhlenbeck.draw(np.random.default_rng(3), np.full(4000, 0.5), 1.0)
    for time_s in (0.0, 3.0, 1000.0):
        assert np.sqrt(np.mean(np.abs(drawn.at(time_s)) ** 2)) == pytest.approx(0.5, rel=0.05)
