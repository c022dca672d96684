import numpy as np
import pytest

from labctl.analysis.signal_quality import drift, no_codes


def test_codes_are_counted_over_all_blocks() -> None:
    codes = np.random.default_rng(1).integers(-100, 90, (6, 2, 40), np.int8)
    codes[:, 1] = 5
    found = no_codes(2, codes.dtype).with_more(codes[:4]).with_more(codes[4:])
    assert found.first_code[[0, -1]].tolist() == [-128, 127]
    np.testing.assert_array_equal(found.counts[0], np.bincount(codes[:, 0].ravel().astype(int) + 128, minlength=256))
    assert found.counts[1, 133] == 240
    np.testing.assert_allclose(found.used, [(int(codes[:, 0].max()) - int(codes[:, 0].min()) + 1) / 256, 1 / 256])


def test_codes_of_sixteen_bits_are_counted_in_256_bins() -> None:
    found = no_codes(1, np.dtype("int16"))
    assert found.used.tolist() == [0.0]
    found = found.with_more(np.array([[[-32768, -32513, 32767]]], np.int16))
    assert (found.counts[0, 0], found.counts[0, 255], found.counts.sum()) == (2, 1, 3)
    assert found.used.tolist() == [1.0]


def test_drift_tells_level_from_shape() -> None:
    first = np.sin(np.arange(50.0))
    records = np.stack([[first, np.zeros(50)], [2 * first + 3, np.ones(50)], [-first, np.zeros(50)]])
    found = drift(records)
    np.testing.assert_allclose(found.level[:, 0], records[:, 0].mean(axis=1))
    np.testing.assert_allclose(found.correlation[:, 0], [1, 1, -1])
    assert np.isnan(found.correlation[:, 1]).all()
    noise = np.random.default_rng(1).normal(size=(2, 1, 20_000))
    assert drift(noise).correlation[1, 0] == pytest.approx(0, abs=0.05)
