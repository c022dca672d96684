"""The idx format of MNIST and its relatives: a four-byte magic number, big-endian sizes, then the elements.

Source: Y. LeCun, C. Cortes, C. J. C. Burges, "The MNIST database of handwritten digits", file format section.
"""

import math

import numpy as np
from numpy.typing import NDArray

from labctl.errors import DatasetError

UNSIGNED_BYTE = 0x08
MOST_AXES = 4


def parse_idx(content: bytes, name: str) -> NDArray[np.uint8]:
    """The array held in an (uncompressed) idx file of unsigned bytes.

    Args:
        content: The whole file.
        name: What to call it in an error.

    Returns:
        uint8 array with as many axes as the file declares; a read-only view of `content`.

    Raises:
        DatasetError: The content is not an idx file of unsigned bytes, or its length does not fit its header.
    """
    if len(content) < 4 or content[:2] != b"\0\0":
        raise DatasetError(f"{name}: not an idx file (it must start with two zero bytes): fetch it again")
    kind, axes = content[2], content[3]
    if kind != UNSIGNED_BYTE:
        raise DatasetError(f"{name}: idx elements of type 0x{kind:02x}, but only unsigned bytes (0x08) are read")
    start = 4 + 4 * axes
    if axes > MOST_AXES:
        raise DatasetError(f"{name}: an idx array of {axes} axes, at most {MOST_AXES} are read: fetch it again")
    if axes == 0 or len(content) < start:
        raise DatasetError(f"{name}: the idx header is incomplete ({len(content)} bytes, {axes} axes): fetch it again")
    shape = tuple(int(size) for size in np.frombuffer(content, ">u4", count=axes, offset=4))
    if len(content) - start != math.prod(shape) or (0 in shape and max(shape) > len(content)):
        raise DatasetError(
            f"{name}: {len(content) - start} bytes of data where the header {shape} asks for {math.prod(shape)}: "
            "fetch it again"
        )
    return np.frombuffer(content, np.uint8, offset=start).reshape(shape)
