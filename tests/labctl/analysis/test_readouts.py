import numpy as np
from sklearn.datasets import load_digits

from labctl.analysis.evaluation import validate
from labctl.analysis.readouts import softmax_classifier, softmax_readout
from labctl.analysis.splits import random_splits


def test_the_rows_of_real_digits_are_read_like_traces() -> None:
    """An 8 x 8 image as eight ports of eight samples: logistic regression is known to reach about 96 %."""
    images, labels = load_digits(return_X_y=True)
    frames = images.reshape(-1, 8, 8).astype(np.int8)
    readout = softmax_readout(ports=None, window_s=0.32e-9, sample_interval_s=40e-12)
    splits = list(random_splits(labels, np.arange(labels.size), splits=3, seed=1))
    with_windows = validate(frames, labels, splits, readout=readout)
    assert with_windows.scores.mean() > 0.94
    plain = validate(frames.reshape(-1, 64).astype(np.float32), labels, splits)
    np.testing.assert_array_equal(plain.scores, with_windows.scores)


def test_the_classifier_is_the_declared_one() -> None:
    parameters = softmax_classifier().get_params()
    assert parameters["softmaxregression__C"] == 1.0
    assert parameters["softmaxregression__max_iter"] == 1000
