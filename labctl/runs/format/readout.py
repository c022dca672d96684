"""What a readout's file says of itself: metadata as JSON, in an attribute of the file.

What is in it besides, and what is made of it, is `labctl.studies.readout_file`.
"""

import json
import math
from pathlib import Path
from typing import Any

import h5py

from labctl.errors import RunError
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS, attribute, check_plain, walked

FORMAT = "labctl-readout"
LARGEST = 1 << 30
"""Bytes of all arrays of a file, unpacked."""


def metadata_in(file: h5py.File) -> dict[str, Any]:
    """The metadata in a file that was found to be plain.

    Raises:
        ValueError, KeyError: there are none, or they are no mapping.
    """
    metadata = json.loads(attribute(file, "metadata"))
    if not isinstance(metadata, dict):
        raise ValueError("its metadata are no mapping")
    return metadata


def accuracies_of(path: Path) -> list[float]:
    """What a readout scored on the shots kept apart; nothing of a file that does not say."""
    try:
        with walked(path) as file:
            check_plain(file, LARGEST)
            score = metadata_in(file).get("accuracy")
    except (*HDF5_ERRORS, RunError):
        return []
    return [float(score)] if isinstance(score, int | float) and math.isfinite(score) else []
