import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labctl.datasets.npy import parse_npy
from labctl.errors import DatasetError

KINDS = hnp.boolean_dtypes() | hnp.integer_dtypes() | hnp.unsigned_integer_dtypes() | hnp.floating_dtypes()


def file_of(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


@given(hnp.arrays(KINDS, hnp.array_shapes(min_dims=0, min_side=0)), st.booleans())
def test_an_array_comes_back_in_either_order(array: np.ndarray, by_column: bool) -> None:
    read = parse_npy(file_of(np.asfortranarray(array) if by_column else array), "images")
    assert read.dtype == array.dtype
    np.testing.assert_array_equal(read, array)


@pytest.mark.parametrize("kind", ["O", "<U3", "|S3", "<c16", "<M8[s]", "|V4", [("a", "<f8")]])
def test_what_is_no_number_is_refused(kind: object) -> None:
    with pytest.raises(DatasetError, match=r"^images: declares .* but is no such array of numbers$"):
        parse_npy(file_of(np.zeros(3, np.dtype(kind))), "images")  # type: ignore[call-overload]


@pytest.mark.parametrize("change", [slice(None, -1), slice(None, 100)])
def test_a_file_that_is_cut_is_refused(change: slice) -> None:
    with pytest.raises(DatasetError, match=r"^images: "):
        parse_npy(file_of(np.zeros(3))[change], "images")


def test_more_than_the_header_declares_is_refused() -> None:
    with pytest.raises(DatasetError, match="declares float64 of shape"):
        parse_npy(file_of(np.zeros(3)) + bytes(8), "images")
