"""Rules that turn grey levels into mirrors: which pixels are bright. The rule decides results, so it has a name.

| rule | a pixel is bright where its grey level is at least |
|---|---|
| `128`, `fixed-128` | that number, 0..255 |
| `otsu` | the threshold that separates the image's own grey levels best (N. Otsu, IEEE Trans. SMC 9, 62, 1979) |
| `median-40` | the median of the image less that whole number |
| `median-0.7` | the median of the image times that fraction below 1 |
"""

import math
import re
from collections.abc import Callable
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from labctl.errors import DatasetError

LEVELS = 256
_FIXED = re.compile(r"(?:fixed-)?([0-9]{1,3})", re.ASCII)
_BELOW_MEDIAN = re.compile(r"median-([0-9]{1,3})", re.ASCII)
_OF_MEDIAN = re.compile(r"median-(0\.[0-9]{1,6})", re.ASCII)

_Threshold = Callable[[NDArray[np.uint8]], int]


def binarise(images: NDArray[np.uint8], rule: str | int) -> NDArray[np.bool_]:
    """Bright pixels of grey images.

    Args:
        images: (n, rows, columns) grey levels.
        rule: Name of a rule, or a fixed threshold.

    Returns:
        (n, rows, columns), True = bright.

    Raises:
        DatasetError: There is no such rule.
    """
    threshold = _rule(rule)[0]
    bright = np.empty(images.shape, np.bool_)
    for image, pixels in zip(images, bright, strict=True):
        np.greater_equal(image, threshold(image), out=pixels)
    return bright


def describe(rule: str | int) -> str:
    """What a rule does, in words for a record.

    Raises:
        DatasetError: There is no such rule.
    """
    return _rule(rule)[1]


def otsu_threshold(image: NDArray[np.uint8]) -> int:
    """The grey level from which on a pixel is bright by Otsu's method, 1..255 (1 for an image of one grey level).

    Of all thresholds, the one with the greatest variance between the two classes; the lowest of equals.
    """
    counts = np.bincount(image.ravel(), minlength=LEVELS).astype(np.float64)
    below = np.cumsum(counts)[:-1]
    above = image.size - below
    levels = np.cumsum(counts * np.arange(LEVELS))
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = levels[:-1] / below - (levels[-1] - levels[:-1]) / above
    between = np.where((below > 0) & (above > 0), below * above * apart**2, 0.0)
    return int(np.argmax(between)) + 1


def _rule(rule: str | int) -> tuple[_Threshold, str]:
    """The threshold of an image by `rule`, and what it does in words."""
    text = str(rule)
    if found := _FIXED.fullmatch(text):
        level = int(found[1])
        if level < LEVELS:
            return lambda _image: level, f"pixel >= {level}"
    if text == "otsu":
        return otsu_threshold, "pixel >= Otsu's threshold of the image"
    if found := _BELOW_MEDIAN.fullmatch(text):
        less = Fraction(found[1])
        return lambda image: math.ceil(_median(image) - less), f"pixel >= median of the image - {less}"
    if found := _OF_MEDIAN.fullmatch(text):
        part = Fraction(found[1])
        return lambda image: math.ceil(_median(image) * part), f"pixel >= {found[1]} x median of the image"
    raise DatasetError(
        f"no binarisation is called {text[:40]!r}: use a grey level 0..255, 'otsu', 'median-40' or 'median-0.7'"
    )


def _median(image: NDArray[np.uint8]) -> Fraction:
    """The median grey level, exact: a whole or a half."""
    ranks = np.cumsum(np.bincount(image.ravel(), minlength=LEVELS))
    lower, upper = np.searchsorted(ranks, [(image.size + 1) // 2, image.size // 2 + 1])
    return Fraction(int(lower) + int(upper), 2)
