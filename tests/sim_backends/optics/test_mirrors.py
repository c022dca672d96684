from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim_backends.optics import mirrors


def naive(packed: NDArray[np.uint8]) -> NDArray[np.float64]:
    bits = np.unpackbits(packed, axis=1)
    out = np.zeros((28, 28))
    for row in range(28):
        for column in range(28):
            block = bits[6 + 27 * row : 33 + 27 * row, 134 + 27 * column : 161 + 27 * column]
            out[row, column] = block.mean()
    return out.ravel()


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_on_fraction_is_the_mean_of_every_superpixel(seed: int, fill: float) -> None:
    bits = np.random.default_rng(seed).random((768, 1024)) < fill
    packed = np.packbits(bits, axis=1)
    np.testing.assert_allclose(mirrors.on_fraction(packed), naive(packed), atol=1e-6)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.tuples(st.integers(0, 2), st.integers(0, 767), st.integers(0, 1023)), max_size=3),
)
def test_pictures_of_superpixels_count_as_any_other(seed: int, stray: list[tuple[int, int, int]]) -> None:
    """Also with a few mirrors turned the other way, inside the square or beside it."""
    bits = np.zeros((3, 768, 1024), bool)
    pixels = np.random.default_rng(seed).random((3, 28, 28)) < 0.5
    bits[:, 6:762, 134:890] = pixels.repeat(27, axis=1).repeat(27, axis=2)
    for place in stray:
        bits[place] ^= True
    packed = np.packbits(bits, axis=2)
    expected = [np.rint(729 * naive(picture)) for picture in packed]
    assert np.array_equal(mirrors.on_counts(packed), expected)


def test_mirrors_outside_the_square_do_not_count() -> None:
    bits = np.ones((768, 1024), bool)
    bits[6:762, 134:890] = False
    assert not mirrors.on_counts(np.packbits(bits, axis=1)).any()
    assert (mirrors.on_counts(np.full((768, 128), 255, np.uint8)) == 729).all()


@pytest.mark.parametrize("wrong", [np.zeros((768, 1024), np.uint8), np.zeros((768, 128), np.int64)])
def test_other_layouts_are_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match="packed bits"):
        mirrors.on_counts(wrong)


def test_mirrors_leave_at_half_and_arrive_at_one_and_a_half_microseconds() -> None:
    time = np.array([0.0, 0.5, 1.0, 1.5, 9.0]) * 1e-6
    moved = mirrors.moved_fraction(time, leaves=0.5e-6, arrives=1.5e-6)
    np.testing.assert_allclose(moved, [0, 0, 0.5, 1, 1], atol=1e-12)
    assert np.all(np.diff(mirrors.moved_fraction(np.linspace(0, 2e-6, 99), leaves=0.5e-6, arrives=1.5e-6)) >= 0)


def test_patterns_are_counted_together_as_alone() -> None:
    packed = np.random.default_rng(1).integers(0, 256, (35, 768, 128), np.uint8)
    together = mirrors.on_counts(packed)
    assert together.shape == (35, 784)
    for counts, pattern in zip(together, packed, strict=True):
        assert np.array_equal(counts, mirrors.on_counts(pattern))


def test_mirrors_that_are_off_scatter_the_contrast_s_part_of_the_power() -> None:
    sent = mirrors.reflected(np.array([0.0, 0.5, 1.0], np.float32), 1000.0)
    assert sent[0] ** 2 == pytest.approx(1e-3)
    assert sent[2] == pytest.approx(1.0)
    assert sent[0] < sent[1] < sent[2]
