"""NumPy's file format, for files that may be anybody's: plain numbers only, and as many as the file really holds."""

import io
import math
import tokenize

import numpy as np
from numpy.typing import NDArray

from labctl.errors import DatasetError

_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def parse_npy(content: bytes, name: str) -> NDArray[np.generic]:
    """The array of bool, whole or real numbers in a numpy file.

    Args:
        content: The whole file.
        name: What to call it in an error.

    Raises:
        DatasetError: It is no such file, or holds fewer numbers than its header declares.
    """
    try:
        version = np.lib.format.read_magic(file := io.BytesIO(content))
        shape, _, kind = _HEADERS[version](file)
        held = len(content) - file.tell()
        if kind.kind not in "biuf" or kind.itemsize * math.prod(shape) != held or max(shape, default=1) > len(content):
            raise DatasetError(f"{name}: declares {kind} of shape {str(shape)[:80]}, but is no such array of numbers")
        return np.asarray(np.load(io.BytesIO(content), allow_pickle=False))
    except (OSError, EOFError, ValueError, KeyError, TypeError, SyntaxError, tokenize.TokenError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DatasetError(f"{name}: is not a numpy file ({reason}): replace the file") from None
    except (RecursionError, MemoryError):  # of the parser of its header
        raise DatasetError(f"{name}: is not a numpy file (its header cannot be read): replace the file") from None
