"""Arrays in a file that others watch: one line of JSON, then the arrays that it names, one after the other.

All are little-endian. Readers take nothing else: it may be a stranger's file, like any in a folder of runs.
"""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

LONGEST_HEADER = 1 << 16
MOST_VALUES = 1 << 26
_TYPES = {"<f8": np.float64, "<i8": np.int64, "|i1": np.int8, "<i2": np.int16}


def encode(values: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """The file of some values that JSON has and some arrays.

    Example:
        >>> import numpy as np
        >>> from labctl.runs.live.arrays import decode, encode
        >>> decode(encode({"ports": [2, 3]}, {"peak_v": np.array([0.5, 1.0])}), ["peak_v"])
        ({'ports': [2, 3]}, {'peak_v': array([0.5, 1. ])})
    """
    little = {name: array.astype(array.dtype.newbyteorder("<"), copy=False) for name, array in arrays.items()}
    shapes = {name: [array.dtype.str, *array.shape] for name, array in little.items()}
    header = json.dumps({**values, "arrays": shapes}).encode()
    return header + b"\n" + b"".join(array.tobytes() for array in little.values())


def decode(content: bytes, names: list[str]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Values and arrays of such a file, whose arrays have these `names` in this order.

    Raises:
        ValueError, TypeError, KeyError, AttributeError, RecursionError: it is no such file.
    """
    head, _, body = content.partition(b"\n")
    if len(head) >= LONGEST_HEADER:
        raise ValueError("header")
    values = json.loads(head)
    shapes = values.pop("arrays")
    found: dict[str, NDArray[Any]] = {}
    offset = 0
    for name in names:
        kind, *shape = shapes[name]
        if not all(isinstance(size, int) and 0 <= size <= MOST_VALUES for size in shape):
            raise ValueError(shape)
        found[name] = np.frombuffer(body, np.dtype(_TYPES[kind]).newbyteorder("<"), math.prod(shape), offset)
        found[name] = found[name].reshape(shape)
        offset += found[name].nbytes
    return values, found
