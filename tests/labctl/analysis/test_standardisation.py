import numpy as np
import pytest
from sklearn.preprocessing import StandardScaler

from labctl.analysis.anomaly import CovarianceScore
from labctl.analysis.evaluation import validate
from labctl.analysis.online import OnlineClassifier
from labctl.analysis.readouts import softmax_classifier
from labctl.analysis.softmax import deviations
from labctl.analysis.standardisation import units

SHOTS = 500


def features(constant: float, kind: type[np.floating] = np.float64) -> np.ndarray:
    """Three features that vary, and the third of a dead port: of many equal values the mean is another by rounding."""
    found = np.random.default_rng(1).normal(0.3, 0.1, (SHOTS, 4)).astype(kind)
    found[:, 2] = constant
    return found


@pytest.mark.parametrize("kind", [np.float64, np.float32])
@pytest.mark.parametrize("constant", [0.0, 0.1, 0.3, -4.7e-3, 1e9])
def test_units_are_those_of_scikit_learn_and_nothing_else_changes(constant: float, kind: type[np.floating]) -> None:
    some = features(constant, kind)
    deviation = some.std(axis=0, dtype=np.float64)
    found = units(deviation, some[0], SHOTS)
    assert found[2] == 1
    varies = [0, 1, 3]
    np.testing.assert_array_equal(found[varies], deviation[varies])
    np.testing.assert_array_equal(deviations(some, [(np.arange(SHOTS), np.arange(1))])[0], found)
    np.testing.assert_allclose(found, StandardScaler().fit(some).scale_)


def test_a_dead_port_that_moves_by_little_is_not_abnormal() -> None:
    normal, moved = features(0.1), features(0.1 + 1e-6)
    score = CovarianceScore().fit(normal)
    np.testing.assert_allclose(score.score_samples(moved), score.score_samples(normal), rtol=1e-3)


def test_a_dead_port_that_moves_does_not_confuse_a_readout_that_follows() -> None:
    labels = np.arange(SHOTS) % 2
    shots, moved = features(0.1), features(0.1 + 1e-6)
    for some in (shots, moved):
        some[:, 0] += labels
    readout = OnlineClassifier().fit(shots, labels)
    assert np.mean(readout.follow(moved, labels) == labels) > 0.95


def test_what_is_constant_in_training_alone_is_as_in_the_readout_itself() -> None:
    labels = np.arange(SHOTS) % 2
    shots = features(0.1)
    shots[:, 0] += 0.1 * labels
    train, test = np.arange(400), np.arange(400, SHOTS)
    shots[test, 2] = 0.3
    alone = softmax_classifier().fit(shots[train], labels[train]).score(shots[test], labels[test])
    assert validate(shots, labels, [(train, test)]).scores[0] == pytest.approx(alone, abs=0.02)
