"""The data sets that are not part of the checkout."""

import pytest

from labctl import datasets
from labctl.errors import DatasetError


def require(name: str) -> None:
    """Leave a test out whose data set is not on this machine."""
    try:
        datasets.path(name)
    except DatasetError:
        pytest.skip(f"LABCTL_DATA does not point to {name}")
