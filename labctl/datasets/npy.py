"""NumPy's files that may be anybody's: plain numbers only, and as many as the file really holds."""

import io
import math
import tokenize

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from labctl.errors import DatasetError, one_line

_READ_HEADER = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def parse_npy(content: bytes, name: str) -> NDArray[np.generic]:
    """The array of bool, whole or real numbers in a numpy file; it lies in `content` and cannot be written to.

    Args:
        content: The whole file.
        name: What to call it in an error.

    Raises:
        DatasetError: It is no such file, or holds another amount of numbers than its header declares.
    """
    file = io.BytesIO(content)
    try:
        shape, by_column, kind = _READ_HEADER[npy.read_magic(file)](file)
    except (ValueError, LookupError, TypeError, SyntaxError, MemoryError, RecursionError, tokenize.TokenError) as error:
        reason = one_line(error)[:200] or "its header cannot be read"
        raise DatasetError(f"{name}: is not a numpy file ({reason}): replace the file") from None
    held = len(content) - file.tell()
    lengths = all(0 <= length <= len(content) for length in shape)
    if kind.kind not in "biuf" or not lengths or kind.itemsize * math.prod(shape) != held:
        raise DatasetError(f"{name}: declares {kind} of shape {str(shape)[:80]}, but is no such array of numbers")
    return np.frombuffer(content, kind, offset=file.tell()).reshape(shape, order="F" if by_column else "C")
