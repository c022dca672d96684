"""A series of numbers to be predicted, kept as a numpy file: the Santa Fe laser."""

import io
import tokenize

import numpy as np
from numpy.typing import NDArray

from labctl.datasets.errors import DatasetError

MAX_VALUES = 10_000_000


def parse_series(content: bytes, name: str) -> NDArray[np.float64]:
    """The values (n,) of a numpy file that holds one series of real numbers, as a row, a column or a vector.

    Args:
        content: The whole file.
        name: What to call it in an error.

    Raises:
        DatasetError: It is not such a file.
    """
    try:
        version = np.lib.format.read_magic(file := io.BytesIO(content))
        read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[
            version
        ]
        shape, _, kind = read_header(file)
        if kind.kind not in "iuf" or not 0 < np.prod(shape, dtype=object) <= MAX_VALUES:
            raise DatasetError(f"{name}: holds {kind} of shape {shape}, not a series of numbers")
        values = np.load(io.BytesIO(content), allow_pickle=False)
    except (OSError, EOFError, ValueError, KeyError, TypeError, SyntaxError, tokenize.TokenError) as error:
        raise DatasetError(f"{name}: is not a numpy file ({' '.join(str(error).split())}): fetch it again") from None
    if values.size != max(values.shape, default=0) or not np.all(np.isfinite(values)):
        raise DatasetError(
            f"{name}: holds an array of shape {values.shape}, or numbers that are not finite: fetch it again"
        )
    return np.asarray(values, np.float64).ravel()
