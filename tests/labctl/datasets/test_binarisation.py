import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labctl.datasets.binarisation import binarise, describe, otsu_threshold
from labctl.errors import DatasetError

IMAGES = hnp.arrays(np.uint8, hnp.array_shapes(min_dims=3, max_dims=3, max_side=6))
RULES = ("otsu", "fixed-100", "median-40", "median-0.7", "128", 128)


@given(IMAGES, st.integers(0, 255))
def test_a_fixed_threshold_has_three_spellings(images: np.ndarray, level: int) -> None:
    for rule in (level, str(level), f"fixed-{level}"):
        np.testing.assert_array_equal(binarise(images, rule), images >= level)
        assert describe(rule) == f"pixel >= {level}"


@given(IMAGES, st.integers(0, 255))
def test_a_number_below_the_median(images: np.ndarray, less: int) -> None:
    medians = np.median(images, axis=(1, 2), keepdims=True)
    np.testing.assert_array_equal(binarise(images, f"median-{less}"), images >= medians - less)


@given(IMAGES, st.sampled_from((25, 50, 75)))
def test_a_fraction_of_the_median(images: np.ndarray, percent: int) -> None:
    medians = np.median(images, axis=(1, 2), keepdims=True)
    expected = 100 * images.astype(np.float64) >= percent * medians
    np.testing.assert_array_equal(binarise(images, f"median-{percent / 100}"), expected)


def test_a_fraction_is_exact() -> None:
    """0.7 of 90 is 63, whatever floating point makes of it."""
    image = np.array([[[62, 63, 90, 90, 90]]], np.uint8)
    assert binarise(image, "median-0.7").tolist() == [[[False, True, True, True, True]]]


@given(IMAGES)
def test_otsu_finds_the_best_of_all_thresholds(images: np.ndarray) -> None:
    def apart(image: np.ndarray, level: int) -> float:
        bright, dark = image[image >= level].astype(float), image[image < level].astype(float)
        return bright.size * dark.size * (bright.mean() - dark.mean()) ** 2 if bright.size and dark.size else 0.0

    for image, bright in zip(images, binarise(images, "otsu"), strict=True):
        chosen = otsu_threshold(image)
        np.testing.assert_array_equal(bright, image >= chosen)
        assert apart(image, chosen) >= (1 - 1e-9) * max(apart(image, level) for level in range(1, 256))


@pytest.mark.parametrize("rule", RULES)
def test_every_image_has_its_own_threshold(rule: str | int) -> None:
    images = np.random.default_rng(1).integers(0, 256, (3, 9, 9), np.uint8)
    together = binarise(images, rule)
    for image, bright in zip(images, together, strict=True):
        np.testing.assert_array_equal(binarise(image[None], rule)[0], bright)
    assert "\n" not in describe(rule)


@given(st.text(max_size=20) | st.integers())
def test_any_other_rule_is_refused_in_one_line(rule: str | int) -> None:
    with pytest.raises(DatasetError, match="'otsu'") as refused:
        describe(f"{rule}?")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("rule", ["", "256", -1, "median", "median-1.5", "median-", "fixed-", "Otsu", "100 ", "٣"])
def test_what_is_no_rule(rule: str | int) -> None:
    with pytest.raises(DatasetError, match="no binarisation is called"):
        binarise(np.zeros((1, 2, 2), np.uint8), rule)
