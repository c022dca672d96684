"""The bundled sample: binary images as packed bits, one file a class.

A file is a plain sequence of 100-byte records: the row of the image in the source file (unsigned 16 bit,
little-endian), then 28 x 28 pixels as 98 bytes, row by row, most significant bit first.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labctl.errors import DatasetError

SIDE = 28
THRESHOLD = 128
PER_CLASS = 1000
RECORD = np.dtype([("row", "<u2"), ("pixels", np.uint8, (SIDE * SIDE // 8,))])


def pack(images: NDArray[np.bool_], rows: NDArray[np.integer]) -> bytes:
    """Records of binary images.

    Args:
        images: (n, 28, 28), True = bright.
        rows: (n,) row of each image in its source, 0..65535.
    """
    records = np.empty(len(images), RECORD)
    records["row"] = rows
    records["pixels"] = np.packbits(images.reshape(-1, SIDE * SIDE), axis=1)
    return records.tobytes()


def unpack(content: bytes, name: str) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Images (n, 28, 28) and source rows (n,) from the records that `pack` made.

    Raises:
        DatasetError: The content is not a whole number of records.
    """
    if len(content) % RECORD.itemsize:
        raise DatasetError(f"{name}: {len(content)} bytes are not whole records of {RECORD.itemsize}: restore the file")
    records = np.frombuffer(content, RECORD)
    images = np.unpackbits(records["pixels"], axis=1).astype(bool).reshape(-1, SIDE, SIDE)
    return images, records["row"].astype(np.int64)


def write_sample(
    images: NDArray[np.uint8], labels: NDArray[np.integer], folder: Path, classes: tuple[int, ...]
) -> None:
    """Write the sample's files `<class>.bin` from grey images: the first 1000 of each class, nothing picked.

    Args:
        images: (n, 28, 28) grey levels, in the order of the source.
        labels: (n,) class of each.
        folder: Existing folder to write to.
        classes: Which classes.
    """
    for label in classes:
        rows = np.flatnonzero(labels == label)[:PER_CLASS]
        (folder / f"{label}.bin").write_bytes(pack(images[rows] >= THRESHOLD, rows))
