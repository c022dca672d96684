"""A series of numbers to be predicted, kept as a numpy file: the Santa Fe laser."""

import numpy as np
from numpy.typing import NDArray

from labctl.datasets.npy import parse_npy
from labctl.errors import DatasetError

MAX_VALUES = 10_000_000


def parse_series(content: bytes, name: str) -> NDArray[np.float64]:
    """The values (n,) of a numpy file that holds one series of real numbers, as a row, a column or a vector.

    Args:
        content: The whole file.
        name: What to call it in an error.

    Raises:
        DatasetError: It is not such a file.
    """
    values = parse_npy(content, name)
    if values.dtype.kind not in "iuf" or not 0 < values.size <= MAX_VALUES:
        raise DatasetError(f"{name}: holds {values.dtype} of shape {values.shape}, not a series of numbers")
    if values.size != max(values.shape, default=0) or not np.all(np.isfinite(values)):
        raise DatasetError(
            f"{name}: holds an array of shape {values.shape}, or numbers that are not finite: fetch it again"
        )
    return np.asarray(values, np.float64).ravel()
