import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labctl import datasets
from labctl.datasets import bits
from labctl.datasets.cards import bundled_directory


@given(st.data(), st.integers(0, 5))
def test_unpack_undoes_pack(data: st.DataObject, count: int) -> None:
    images = data.draw(hnp.arrays(np.bool_, (count, 28, 28)))
    rows = data.draw(hnp.arrays(np.uint16, (count,)))
    packed = bits.pack(images, rows)
    assert len(packed) == 100 * count
    unpacked, indices = bits.unpack(packed, "sample")
    np.testing.assert_array_equal(unpacked, images)
    np.testing.assert_array_equal(indices, rows)


def test_bit_order_is_that_of_the_card() -> None:
    images = np.zeros((1, 28, 28), np.bool_)
    images[0, 0, 1] = images[0, 27, 27] = True
    packed = bits.pack(images, np.array([0x0102]))
    assert packed[:3] == bytes([0x02, 0x01, 0b01000000])
    assert packed[-1] == 1


def test_a_cut_file_is_refused() -> None:
    with pytest.raises(datasets.DatasetError, match="not whole records"):
        bits.unpack(b"\0" * 150, "0.bin")


def test_the_bundled_sample_is_what_its_card_says(tmp_path: Path) -> None:
    """The files of the sample can be made again, byte for byte, from the full set."""
    if not os.environ.get("LABCTL_DATA"):
        pytest.skip("LABCTL_DATA does not point to the full MNIST files")
    full = datasets.load("mnist")
    first = slice(0, 60_000)
    assert full.images.dtype == np.uint8
    bits.write_sample(np.asarray(full.images[first], np.uint8), full.labels[first], tmp_path, (0, 1, 2, 3))
    for label in range(4):
        bundled = bundled_directory() / "mnist-0-3" / f"{label}.bin"
        assert bundled.stat().st_size <= 100_000
        assert (tmp_path / bundled.name).read_bytes() == bundled.read_bytes()
