import contextlib
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labctl.datasets.idx import parse_idx
from labctl.errors import DatasetError

ARRAYS = hnp.arrays(np.uint8, hnp.array_shapes(min_dims=1, max_dims=4, min_side=0, max_side=6))


def idx(array: np.ndarray) -> bytes:
    header = bytes([0, 0, 0x08, array.ndim]) + struct.pack(f">{array.ndim}I", *array.shape)
    return header + array.tobytes()


@given(ARRAYS)
def test_any_array_comes_back(array: np.ndarray) -> None:
    parsed = parse_idx(idx(array), "file")
    assert parsed.dtype == np.uint8
    np.testing.assert_array_equal(parsed, array)


@given(ARRAYS, st.integers(1, 20))
def test_a_file_that_lost_its_end_is_refused(array: np.ndarray, lost: int) -> None:
    content = idx(array)
    with pytest.raises(DatasetError, match="the-file"):
        parse_idx(content[: max(len(content) - lost, 0)], "the-file")


@given(st.binary(max_size=64))
def test_any_bytes_give_an_array_or_the_one_error(content: bytes) -> None:
    with contextlib.suppress(DatasetError):
        assert idx(parse_idx(content, "file")) == content


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x1f\x8b\x08\x00aaaa", "two zero bytes"),
        (bytes([0, 0, 0x0D, 1, 0, 0, 0, 0]), "type 0x0d"),
        (bytes([0, 0, 0x08, 3, 0, 0]), "header is incomplete"),
        (bytes([0, 0, 0x08, 1, 0, 0, 0, 2, 7]), "1 bytes of data"),
    ],
)
def test_the_error_says_what_is_wrong(content: bytes, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        parse_idx(content, "file")
