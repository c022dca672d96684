import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.datasets import load_digits

from labctl.analysis.dynamic import (
    periodic_windows,
    settled_windows,
    short_time_correlation,
    sliding_probabilities,
    switch_index,
    switch_time,
)
from labctl.analysis.readouts import softmax_classifier, softmax_readout
from labctl.errors import AnalysisError


@given(st.integers(1, 20), st.integers(1, 12), st.integers(0, 9), st.integers(21, 90))
def test_windows_step_by_the_period(period: int, window: int, start: int, samples: int) -> None:
    record = np.random.default_rng(1).normal(size=(3, samples))
    windows, starts = periodic_windows(record, period=period, window=window, start=start)
    assert starts.tolist() == [k for k in range(start, samples, period) if k + window <= samples]
    np.testing.assert_array_equal(windows, [record[:, k : k + window] for k in starts])
    windows[:] = 0
    assert record.all()


def test_windows_of_a_periodic_record_are_equal() -> None:
    record = np.tile(np.random.default_rng(2).normal(size=(5, 16)), 10)
    windows, starts = periodic_windows(record, period=16, window=14, start=1)
    assert len(starts) == 10
    np.testing.assert_array_equal(windows, windows[:1].repeat(10, axis=0))
    np.testing.assert_allclose(short_time_correlation(windows, windows[3]), 1)


def test_windows_that_do_not_fit_are_refused() -> None:
    record = np.zeros((2, 10))
    with pytest.raises(AnalysisError, match="record longer"):
        periodic_windows(record, period=5, window=11)
    for wrong in ({"period": 0, "window": 3}, {"period": 3, "window": 0}, {"period": 3, "window": 3, "start": -1}):
        with pytest.raises(AnalysisError, match="lengths above zero"):
            periodic_windows(record, **wrong)
    with pytest.raises(AnalysisError, match=r"give \(ports, samples\)"):
        periodic_windows(record[0], period=3, window=3)


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 100), st.floats(-100, 100))
def test_correlation_is_pearsons(seed: int, gain: float, level: float) -> None:
    generator = np.random.default_rng(seed)
    windows, reference = generator.normal(size=(4, 3, 5)), generator.normal(size=(3, 5))
    expected = [np.corrcoef(window.ravel(), reference.ravel())[0, 1] for window in windows]
    np.testing.assert_allclose(short_time_correlation(windows, reference), expected)
    np.testing.assert_allclose(short_time_correlation(gain * windows + level, reference), expected, atol=1e-6)
    np.testing.assert_allclose(short_time_correlation(-reference[np.newaxis], reference), -1)


def test_correlation_of_codes_darkness_and_shapes() -> None:
    codes = np.array([[[-128, 127, 127]], [[5, 5, 5]]], np.int8)
    np.testing.assert_allclose(short_time_correlation(codes, codes[0]), [1, 0])
    np.testing.assert_array_equal(short_time_correlation(codes, codes[1]), [0, 0])
    with pytest.raises(AnalysisError, match="cut both alike"):
        short_time_correlation(codes, codes[0, :, :2])


def test_a_readout_of_still_images_sees_the_switch() -> None:
    images, labels = load_digits(n_class=3, return_X_y=True)
    readout = softmax_readout(ports=None, window_s=0.32e-9, sample_interval_s=40e-12)
    readout.fit(images[:400].reshape(-1, 8, 8), labels[:400])
    known = readout.predict(images[400:].reshape(-1, 8, 8))
    one, two = (images[400:][(labels[400:] == label) & (known == label)] for label in (1, 2))
    scene = np.concatenate([one[:10], two[:15]]).reshape(-1, 8, 8)  # a row of the image on each port
    record = np.pad(scene, ((0, 0), (0, 0), (0, 4))).swapaxes(0, 1).reshape(8, -1)
    windows, starts = periodic_windows(record, period=12, window=8)
    probabilities = sliding_probabilities(readout, windows)
    assert probabilities.shape == (25, 3)
    np.testing.assert_allclose(probabilities.sum(axis=1), 1)
    assert switch_index(probabilities, 2) == 10
    assert switch_time(probabilities, starts, new=2, sample_interval_s=40e-12) == pytest.approx(120 * 40e-12)
    flat = softmax_classifier().fit(images[:400], labels[:400])
    np.testing.assert_allclose(sliding_probabilities(flat, windows), probabilities, atol=0.05)  # as far as fits agree
    np.testing.assert_allclose(sliding_probabilities(flat[-1], windows).sum(axis=1), 1)


@given(st.lists(st.integers(0, 2), min_size=1, max_size=30))
def test_the_switch_is_where_the_new_class_begins_to_stay(shown: list[int]) -> None:
    probabilities = np.full((len(shown), 3), 0.2)
    probabilities[np.arange(len(shown)), shown] = 0.6
    index = switch_index(probabilities, 2)
    starts = 100 * np.arange(len(shown))
    if shown[-1] != 2:
        assert index is None
        assert switch_time(probabilities, starts, new=2, sample_interval_s=1e-9) is None
        return
    assert index is not None
    assert set(shown[index:]) == {2}
    assert index == 0 or shown[index - 1] != 2
    assert switch_time(probabilities, starts, new=2, sample_interval_s=1e-9) == pytest.approx(index * 1e-7)


def test_windows_with_light_of_both_images_belong_to_neither() -> None:
    starts = np.arange(0, 100, 10)
    before, after = settled_windows(
        starts, window=5, sample_interval_s=1e-9, leaves_s=34e-9, arrives_s=50e-9, memory_s=10e-9
    )
    assert starts[before].tolist() == [0, 10, 20]
    assert starts[after].tolist() == [60, 70, 80, 90]
    with pytest.raises(AnalysisError, match="in this order"):
        settled_windows(starts, window=5, sample_interval_s=1e-9, leaves_s=3e-9, arrives_s=2e-9, memory_s=0)
